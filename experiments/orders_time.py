"""What real orders take of bins in 0.1, 0.3, 1, 3 and 10 seconds each: one figure per set.

pip install 'jaxpack[peers]'
python experiments/orders_time.py [--only bookshop|ivancic|bed-bpp] [--data FOLDER] (20 minutes)

Every twentieth mail order, Ivancic's 47 and five pallets of BED-BPP; jaxpack with more than half of
every base carried, and PackingSolver's box solver, which knows no support. Adds a row per set,
method and time to results/orders-time.csv, leaving out those that are there, and draws
results/orders-time-SET.png. Best on a quiet machine, with programs compiled (`jaxpack warm`).
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
from peers import in_whole_numbers, kinds_for, room_for
from public_instances import (
    BED_BPP,
    IVANCIC,
    add_data_option,
    data_file,
    read_bookshop,
    read_ivancic,
)
from rows import RESULTS, read_rows, write_rows

from jaxpack.io.jobs import read_job
from jaxpack.model.job import Job
from jaxpack.search.portfolio import SolveOptions, solve_job
from jaxpack.search.record import Progress

matplotlib.use("Agg")
import matplotlib.pyplot as plt

SECONDS = (0.1, 0.3, 1.0, 3.0, 10.0)
SETS: dict[str, Callable[[Path], list[Job]]] = {
    "bookshop": lambda data: list(map(in_whole_numbers, read_bookshop(data)[::20])),
    "ivancic": lambda data: read_ivancic(data_file(data, IVANCIC)),
    "bed-bpp": lambda data: list(map(in_whole_numbers, read_job(data_file(data, BED_BPP)))),
}


def ours(job: Job, seconds: float) -> tuple[int, int]:
    """(bins, items left out), until no plan has fewer bins or the time is up."""

    def least(found: Progress) -> bool:
        return found.bins <= found.bounds.bins

    found = solve_job(job, SolveOptions(seconds), progress=least)
    return found.bins, len(found.plan.left_out)


def packingsolver(job: Job, seconds: float) -> tuple[int, int]:
    """(bins, items left out) of PackingSolver."""
    from packingsolver3d import Instance, Objective, box

    one = len(job.bins) == 1
    rooms = [replace(room_for(replace(job, bins=(room,)), 1), cost=1) for room in job.bins]
    what = Objective.BIN_PACKING if one else Objective.VARIABLE_SIZED_BIN_PACKING
    result = box.solve(Instance(rooms, kinds_for(job, 1), what), time_limit=seconds)
    packed = sum(len(each.placements) * each.copies for each in result.bins)
    items = sum(item.copies for item in job.items)
    return sum(each.copies for each in result.bins), items - packed


METHODS = {"jaxpack": ours, "packingsolver3d": packingsolver}


def row_of(name: str, jobs: list[Job], method: str, seconds: float) -> dict[str, Any]:
    """Sums over a set."""
    bins, left_out, began = 0, 0, time.perf_counter()
    for job in jobs:
        used, missing = METHODS[method](job, seconds)
        bins, left_out = bins + used, left_out + missing
    spent = round((time.perf_counter() - began) / len(jobs), 3)
    about = {"set": name, "method": method, "seconds": seconds, "orders": len(jobs)}
    return about | {"bins": bins, "left_out": left_out, "spent": spent}


def draw(name: str, rows: list[dict[str, Any]]) -> None:
    """The figure of a set."""
    figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
    for method in METHODS:
        mine = [row for row in rows if (row["set"], row["method"]) == (name, method)]
        mine.sort(key=lambda row: float(row["seconds"]))
        whole = [row for row in mine if int(row["left_out"]) == 0]
        axis.plot(
            [float(row["seconds"]) for row in whole],
            [int(row["bins"]) for row in whole],
            marker="o",
            label=method + (", no support" if method != "jaxpack" else ", more than half carried"),
        )
    axis.set_xscale("log")
    axis.set_xticks(SECONDS, [f"{seconds:g}" for seconds in SECONDS])
    axis.set_xlabel("seconds per order, two cores")
    axis.set_ylabel("bins of all orders")
    axis.yaxis.get_major_locator().set_params(integer=True)
    axis.grid(alpha=0.3)
    axis.legend()
    axis.set_title(f"{name}: {rows[0]['orders'] if rows else 0} orders")
    figure.savefig(RESULTS / f"orders-time-{name}.png", dpi=120)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_data_option(parser)
    parser.add_argument("--only", default="", choices=("", *SETS))
    options = parser.parse_args()
    path = RESULTS / "orders-time.csv"
    rows: list[dict[str, Any]] = [*read_rows(path)]
    done = {(row["set"], row["method"], float(row["seconds"])) for row in rows}
    for name, read in SETS.items():
        if options.only not in ("", name):
            continue
        jobs = read(options.data)
        for seconds in SECONDS:
            for method in METHODS:
                if (name, method, seconds) in done:
                    continue
                rows.append(row_of(name, jobs, method, seconds))
                print(rows[-1], flush=True)
                write_rows(path, rows)
        draw(name, [row for row in rows if row["set"] == name])


if __name__ == "__main__":
    main()
