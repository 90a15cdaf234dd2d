"""The policies of a range on other item counts, sides and bins, without retraining.

python experiments/transfer.py 2d|3d [INSTANCES]     (10 and 15 minutes on one core)

Writes results/transfer-DIM.csv: in every cell the policy, greedy, beside the best fixed order;
where it has no fewer bins, also with a search of 16 draws.
"""

import sys

from rows import RESULTS, rounded, write_rows

from jaxpack import (
    Cell,
    Comparison,
    Distribution,
    MethodOptions,
    compare,
    load_policy,
    make_method,
    preset,
)
from jaxpack.cli import prepare_jax

ITEMS = (20, 40, 80, 200)
FIXED = ("volume", "footprint", "height")
# (bin, sides): the sides vary in bins of 10, the bins with sides 1-5.
PLACES = [(10, (1, 5)), (10, (2, 5)), (10, (1, 8)), (8, (1, 5)), (12, (1, 5)), (20, (1, 5))]

WIDTH, DRAWS = 4, 1  # of the search, which has four rounds


def row_of(dimension: str, items: int, bin: int, sides: tuple[int, int], instances: int) -> dict:
    problem = preset(f"bin-aware-{dimension}").problem.resized((bin,) * 3, sides[1])
    cell = Cell(problem.bin, Distribution(items, *sides))
    policy = load_policy(f"bin-aware-{dimension}-range")
    kinds = cell.distribution.kinds(problem)
    options = MethodOptions(policy=policy, kinds=kinds, width=WIDTH, draws=DRAWS)
    comparison = Comparison(problem, instances=instances, batch=min(instances, 128))

    def run(name: str):
        return compare(comparison, name, make_method(name, problem, options), [cell])[0]

    fixed = [run(name) for name in FIXED]
    best = min(fixed, key=lambda row: (row.bins, -row.compactness))
    ours = run("bin-aware")
    row = {
        "items": items,
        "bin": bin,
        "sides": f"{sides[0]}-{sides[1]}",
        "bins": ours.bins,
        "compactness": ours.compactness,
        "best_sort": best.method,
        "sort_bins": best.bins,
        "sort_compactness": max(row.compactness for row in fixed),
        "lower_bound": ours.lower_bound,
        "instances": instances,
        "seed": comparison.seed,
        "ms_per_instance": ours.ms_per_instance,
        "search_bins": None,
        "search_compactness": None,
    }
    if ours.bins >= best.bins:
        found = run("bin-aware-search")
        row |= {"search_bins": found.bins, "search_compactness": found.compactness}
    return row


def main() -> None:
    prepare_jax()
    dimension, *rest = sys.argv[1:]
    instances = int(rest[0]) if rest else 128
    rows = []
    for bin, sides in PLACES:
        for items in ITEMS:
            rows.append(row_of(dimension, items, bin, sides, instances))
            print(rounded(rows[-1]))
            write_rows(RESULTS / f"transfer-{dimension}.csv", rows)


if __name__ == "__main__":
    main()
