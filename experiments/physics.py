"""Do plans stand? Those of every rule of stability, loaded item by item under gravity.

pip install 'jaxpack[physics]'
python experiments/physics.py [--count 100] [--workers 2] [--only TEXT] [--data FOLDER]

So many made orders, mail orders and pallets of 33 cartons, packed with four packings each by every
rule: a quarter of an hour a rule on one core. Adds a row per order and rule to results/physics.csv,
leaving out those that are there, and writes results/physics.md, the sums by set and rule. An item
has moved if one of its corners is displaced by more than a centimetre.
"""

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from public_instances import BED_BPP, add_data_option, data_file, read_bookshop
from rows import RESULTS, read_rows, write_rows

import jaxpack
from jaxpack import BinType, ItemType, Job
from jaxpack.io.jobs import read_job
from jaxpack.model.job import UPRIGHT
from jaxpack.model.physics import simulate

RULES: dict[str, dict[str, Any]] = {
    "at least half": {"stability": "share", "inclusive": True},
    "more than half": {"stability": "share"},
    "centre": {"stability": "centre"},
    "static": {"stability": "static"},
}
"""Name -> what `jaxpack.solve` is told."""
ORDERS = 100  # of each set
PACKINGS = 4  # tried in each order: the second and later ones are searched for
CENTIMETRE = 10.0  # all lengths are in millimetres
ITEMS = 33  # of a pallet and of a made order
LEAST_ITEMS = 6  # of a mail order: of fewer hardly anything stands on anything


def made() -> Iterator[Job]:
    """Boxes of any sides and weights, ten kinds an order, in a crate of a pallet's floor."""
    rng = np.random.default_rng(0)
    for number in range(ORDERS):
        kinds = tuple(
            ItemType(tuple(map(float, sides)), 1 + extra, float(weight), UPRIGHT)
            for sides, weight, extra in zip(
                rng.integers(100, 500, (10, 3)),
                rng.integers(1, 25, 10),
                rng.multinomial(ITEMS - 10, [0.1] * 10).tolist(),
                strict=True,
            )
        )
        yield Job(kinds, (BinType((1200.0, 800.0, 1600.0)),), name=f"made {number}")


def mail(data: Path) -> Iterator[Job]:
    """Orders of the bookshop."""
    orders = [
        job for job in read_bookshop(data) if sum(item.copies for item in job.items) >= LEAST_ITEMS
    ]
    yield from orders[:: len(orders) // ORDERS][:ORDERS]


def pallets(data: Path) -> Iterator[Job]:
    """Cartons of BED-BPP's five orders, drawn anew: sides and weights that there are."""
    orders = read_job(data_file(data, BED_BPP))
    cartons = [item for job in orders for item in job.items]
    (pallet,) = {kind for job in orders for kind in job.bins if kind.size[:2] == (1200, 800)}
    rng = np.random.default_rng(1)
    for number in range(ORDERS):
        drawn = rng.choice(len(cartons), 12, replace=False).tolist()
        counts = 1 + rng.multinomial(ITEMS - 12, [1 / 12] * 12)
        kinds = tuple(
            ItemType(cartons[one].size, count, cartons[one].weight, UPRIGHT, cartons[one].name)
            for one, count in zip(drawn, counts.tolist(), strict=True)
        )
        yield Job(kinds, (pallet,), name=f"pallet {number}")


def row_of(name: str, job: Job, rule: str) -> dict[str, Any]:
    """What became of one order that was packed by one rule."""
    plan = jaxpack.solve(job, packings=PACKINGS, **RULES[rule]).plan
    found = simulate(job, plan, walls=name == "mail")  # cartons have them, and pallets have none
    moved = found.distance > CENTIMETRE
    about = {"set": name, "order": job.name, "rule": rule, "bins": len(plan.bins)}
    figures = {"items": len(moved), "moved": int(moved.sum())}
    return about | figures | {"farthest": round(float(found.distance.max(initial=0)), 2)}


def write_table(path: Path, rows: list[dict[str, Any]]) -> None:
    """The sums by set and rule, as Markdown."""
    lines = ["| set | rule | plans | of these something moved | items | moved | bins |"]
    lines.append("|---|---|---|---|---|---|---|")
    for name in dict.fromkeys(row["set"] for row in rows):
        for rule in RULES:
            of = [row for row in rows if (row["set"], row["rule"]) == (name, rule)]
            sums = [sum(int(row[key]) for row in of) for key in ("items", "moved", "bins")]
            fallen = sum(int(row["moved"]) > 0 for row in of)
            if of:
                lines.append(
                    "| " + " | ".join(map(str, (name, rule, len(of), fallen, *sums))) + " |"
                )
    path.write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_data_option(parser)
    parser.add_argument("--count", type=int, default=ORDERS, help="orders of each set")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--only", default="", help="rules with this in their names")
    options = parser.parse_args()
    sets = {"pallets": pallets(options.data), "mail": mail(options.data), "made": made()}
    orders = [(name, job) for name, jobs in sets.items() for job in list(jobs)[: options.count]]
    path = RESULTS / "physics.csv"
    rows: list[dict[str, Any]] = [*read_rows(path)]
    done = {(row["order"], row["rule"]) for row in rows}
    rules = [rule for rule in RULES if options.only in rule]
    work = [
        (name, job, rule) for name, job in orders for rule in rules if (job.name, rule) not in done
    ]
    with ProcessPoolExecutor(options.workers, get_context("spawn")) as pool:
        for one in as_completed([pool.submit(row_of, *each) for each in work]):
            rows.append(one.result())
            print(rows[-1], flush=True)
            write_rows(path, rows)
    write_table(RESULTS / "physics.md", rows)


if __name__ == "__main__":
    main()
