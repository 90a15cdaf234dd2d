"""What a method makes of 0.01, 0.1, 1 and 10 seconds per instance: one figure per dimension.

python experiments/quality_time.py 2d|3d [SECONDS ...]     (6 minutes each)

Random orders, BRKGA from the sorts, BRKGA from the policy's orders, samples of the policy and its
search get the same wall time on the same instances, fewer where the budget is long. The sizes
of populations and beams grow with the budget, so that every search has rounds to run.
Writes results/quality-time-DIM.csv and .png; given budgets, runs those and keeps the other rows.
"""

import sys
from dataclasses import replace

import matplotlib
from rows import RESULTS, read_rows, rounded, write_rows

from jaxpack import Cell, Comparison, MethodOptions, compare, make_method, preset
from jaxpack.cli import prepare_jax
from jaxpack.search.breeding import BrkgaConfig

matplotlib.use("Agg")
import matplotlib.pyplot as plt

# Seconds per instance: instances, (width, draws) of the search and the generations between its
# rounds, population of BRKGA in all.
BUDGETS = {
    "2d": {
        0.01: (256, 1, 2, 10, 20),
        0.1: (64, 1, 4, 20, 50),
        1.0: (16, 4, 8, 40, 100),
        10.0: (4, 8, 16, 80, 200),
    },
    "3d": {
        0.01: (256, 4, 1, 1, 16),
        0.1: (64, 2, 4, 1, 50),
        1.0: (16, 8, 16, 20, 100),
        10.0: (4, 16, 32, 40, 200),
    },
}
METHODS = ("random orders", "brkga", "brkga-seeded", "bin-aware samples", "bin-aware-search")


def row_of(dimension: str, name: str, seconds: float) -> dict:
    count, width, draws, breeding, population = BUDGETS[dimension][seconds]
    recipe = preset(f"bin-aware-{dimension}")
    problem = recipe.problem
    options = MethodOptions(
        brkga=BrkgaConfig(population),
        kinds=recipe.kinds,
        width=width,
        draws=draws,
        breeding=breeding,
        time_limit=seconds,
    )
    named = {"random orders": f"best-of-{2 * population}"}
    named["bin-aware samples"] = f"bin-aware-best-of-{width * draws}"
    # The best of N goes on drawing, N at a time, until the time is up.
    method = replace(make_method(named.get(name, name), problem, options), seconds=seconds)
    comparison = Comparison(problem, instances=count, batch=min(count, 64))
    row = compare(comparison, name, method, [Cell(problem.bin, recipe.distribution)])[0]
    names = ("compactness", "pyramid", "bins", "lower_bound", "instances")
    spent = row.ms_per_instance / 1000
    return {"method": name, "seconds": seconds, "spent": spent} | {
        field: getattr(row, field) for field in names
    }


def draw(dimension: str, rows: list[dict]) -> None:
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for name in METHODS:
        ours = [row for row in rows if row["method"] == name]
        times = [row["seconds"] for row in ours]
        above = [row["bins"] - row["lower_bound"] for row in ours]
        axes[0].plot(times, above, marker="o", label=name)
        axes[1].plot(times, [row["compactness"] for row in ours], marker="o", label=name)
    axes[0].set_ylabel("bins above the volume bound")
    axes[1].set_ylabel("compactness C")
    for axis in axes:
        axis.set_xscale("log")
        axis.set_xlabel("seconds per instance, one core")
        axis.grid(alpha=0.3)
    lines, names = axes[0].get_legend_handles_labels()
    figure.legend(lines, names, loc="outside lower center", ncols=len(names))
    figure.suptitle(f"{dimension.upper()}: quality against time")
    figure.savefig(RESULTS / f"quality-time-{dimension}.png", dpi=120)


def main() -> None:
    prepare_jax()
    dimension, *chosen = sys.argv[1:]
    path = RESULTS / f"quality-time-{dimension}.csv"
    rows: dict[tuple[float, str], dict] = {}
    for line in read_rows(path) if chosen else ():
        values = {key: float(value) for key, value in line.items() if key != "method"}
        rows[values["seconds"], line["method"]] = {"method": line["method"]} | values
    for seconds in map(float, chosen or BUDGETS[dimension]):
        for name in METHODS:
            row = rows[seconds, name] = row_of(dimension, name, seconds)
            print(rounded(row))
            write_rows(path, (rows[key] for key in sorted(rows)))
    draw(dimension, list(rows.values()))


if __name__ == "__main__":
    main()
