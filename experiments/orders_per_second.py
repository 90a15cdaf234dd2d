"""Cartons against orders a second: the mail orders in one call, beside py3dbp.

python experiments/orders_per_second.py [--seconds 4,7,10,20,36] [--every 20] [--older CHECKOUT]
                                                                                 (three minutes)

Each row is `jaxpack solve` in a process of its own, on all cores, from its start to the files that
it wrote; nothing of it is compiled, so the first run is as fast as any. py3dbp packs every so many
of the orders, one after the other on one core, into the largest carton; its row has its own orders
a second, and what it would use of all orders if it used as many more as on these. So does an older
state of this project, if a checkout of it is given, which has each of the orders alone for two
seconds. Writes results/orders-per-second.csv and .png.
"""

import argparse
import csv
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from public_instances import BOOKSHOP, add_data_option, data_file, read_bookshop
from rows import RESULTS, rounded, write_rows

from jaxpack.model.job import ORIENTATIONS
from jaxpack.search.portfolio import SolveOptions
from jaxpack.search.wave import pack_wave


def write_orders(data: Path, folder: Path) -> tuple[Path, Path]:
    """The orders and the cartons as `jaxpack solve` takes them: turned in all ways."""
    orders, cartons = (data_file(data, name) for name in BOOKSHOP)
    ways = [f"ROTATION_{way}" for way in ORIENTATIONS]
    with orders.open(newline="") as source, (folder / "orders.csv").open("w", newline="") as file:
        rows, table = csv.reader(source), csv.writer(file, lineterminator="\n")
        table.writerow([*next(rows), *ways])
        table.writerows([*row, *("1" for _ in ways)] for row in rows)
    return folder / "orders.csv", cartons


def packed(data: Path, seconds: float) -> dict[str, Any]:
    """One call for all orders."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        orders, cartons = write_orders(data, folder)
        tables = [folder / "placements.csv", folder / "figures.csv"]
        begun = time.perf_counter()
        subprocess.run(
            [
                *(sys.executable, "-m", "jaxpack.solve", orders, cartons),
                *("--time-limit", str(seconds), "--placements", tables[0], "--figures", tables[1]),
            ],
            check=True,
            capture_output=True,
        )
        wall = time.perf_counter() - begun
        figures = [*csv.DictReader(tables[1].read_text().splitlines())]
    bins, bound = (sum(int(row[name]) for row in figures) for name in ("BINS", "BOUND"))
    what = f"jaxpack, {seconds:g} s"
    return {
        "packer": what, "orders": len(figures), "cartons": bins, "bound": bound,
        "seconds": wall, "orders_per_second": len(figures) / wall,
    }  # fmt: skip


def py3dbp_row(data: Path, every: int) -> dict[str, Any]:
    """What py3dbp uses of some of the orders, and in which time."""
    from py3dbp import Bin, Item, Packer

    jobs = read_bookshop(data)
    some, total = jobs[::every], 0
    begun = time.perf_counter()
    for job in some:
        room = max(job.bins, key=lambda kind: kind.size[0] * kind.size[1] * kind.size[2])
        packer = Packer()
        for number, item in enumerate(job.items):
            for _ in range(item.copies):
                packer.add_item(Item(number, *item.size, item.weight))
        for number in range(job.count):
            packer.add_bin(Bin(number, *room.size, room.max_weight))
        packer.pack(bigger_first=True, distribute_items=True)
        total += sum(bool(one.items) for one in packer.bins)
    wall = time.perf_counter() - begun
    ours = sum(found.bins for found in pack_wave(some, SolveOptions(packings=8)))
    print(f"of {len(some)} orders: py3dbp {total} cartons, jaxpack {ours} with 8 packings each")
    return {
        "packer": "py3dbp", "orders": len(some), "cartons": total / len(some) * len(jobs),
        "bound": "", "seconds": wall, "orders_per_second": len(some) / wall,
    }  # fmt: skip


ALONE = """
import sys
import jaxpack
orders = sys.argv[2:]
print(sum(len(jaxpack.solve(one, sys.argv[1], time_limit=2.0).plan.bins) for one in orders))
"""


def older_row(data: Path, every: int, checkout: Path) -> dict[str, Any]:
    """What an older state uses of some of the orders, one after the other in one process."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        orders, cartons = write_orders(data, folder)
        with orders.open(newline="") as source:
            header, *rows = csv.reader(source)
        order = header.index("ORDER")
        names = [*dict.fromkeys(row[order] for row in rows)]
        some = names[::every]
        for one in some:
            with (folder / f"{one}.csv").open("w", newline="") as file:
                mine = [header, *(row for row in rows if row[order] == one)]
                csv.writer(file).writerows([*row[:order], *row[order + 1 :]] for row in mine)
        begun = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-c", ALONE, cartons, *(folder / f"{one}.csv" for one in some)],
            env=os.environ | {"PYTHONPATH": str(checkout)},
            cwd=checkout,
            check=True,
            capture_output=True,
            text=True,
        )
        wall = time.perf_counter() - begun
    return {
        "packer": "jaxpack before", "orders": len(some),
        "cartons": int(done.stdout) / len(some) * len(names), "bound": "", "seconds": wall,
        "orders_per_second": len(some) / wall,
    }  # fmt: skip


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """The curve."""
    figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    ours = [row for row in rows if row["packer"].startswith("jaxpack, ")]
    axes.plot(
        [row["orders_per_second"] for row in ours], [row["cartons"] for row in ours], "o-",
        label="jaxpack solve, two cores",
    )  # fmt: skip
    for row in rows:
        if row not in ours:
            axes.plot(row["orders_per_second"], row["cartons"], "s", label=row["packer"])
    axes.set(xscale="log", xlabel="orders a second", ylabel="cartons for all orders")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_data_option(parser)
    parser.add_argument("--seconds", default="4,7,10,20,36")
    parser.add_argument("--every", type=int, default=20)
    parser.add_argument("--older", type=Path, help="a checkout of an older state")
    options = parser.parse_args()
    rows = []
    for seconds in map(float, options.seconds.split(",")):
        rows.append(packed(options.data, seconds))
        print(rounded(rows[-1]), flush=True)
    rows.append(py3dbp_row(options.data, options.every))
    print(rounded(rows[-1]))
    if options.older:
        rows.append(older_row(options.data, 5 * options.every, options.older.resolve()))
        print(rounded(rows[-1]))
    write_rows(RESULTS / "orders-per-second.csv", map(rounded, rows))
    draw(rows, RESULTS / "orders-per-second.png")


if __name__ == "__main__":
    main()
