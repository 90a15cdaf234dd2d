"""How fast `jaxpack stream` packs many mail orders, and what memory all its processes take.

python experiments/stream_orders.py [--orders 20000] [--packings 8] [--workers 2] [--kills 0]
                                    [--data FOLDER]

The bookshop's orders (docs/data.md) over and over, with names of their own, as one Parquet file.
With --kills they are packed once more, killed so many times on the way and begun again, and every
file that comes out is compared with that of the first time.
"""

import argparse
import csv
import hashlib
import resource
import subprocess
import sys
import tempfile
import time
from itertools import cycle, groupby, islice
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
from public_instances import BOOKSHOP, add_data_option, data_file

from jaxpack.model.job import ORIENTATIONS

ROWS = 50_000  # that are written at a time


def write_orders(path: Path, source: Path, count: int) -> None:
    with source.open(newline="") as file:
        rows = list(csv.DictReader(file))
    orders = [list(own) for _, own in groupby(rows, key=lambda row: row["ORDER"])]
    turns = {f"ROTATION_{name}": 1 for name in ORIENTATIONS}
    lines = (
        {"ORDER": f"order {number}"}
        | {name: float(row[name]) for name in ("X", "Y", "Z", "WEIGHT")}
        | {"COPIES": int(row["COPIES"])}
        | turns
        for number, own in enumerate(islice(cycle(orders), count))
        for row in own
    )
    some = pa.Table.from_pylist(list(islice(lines, ROWS)))
    with pq.ParquetWriter(path, some.schema) as writer:
        while some.num_rows:
            writer.write_table(some)
            some = pa.Table.from_pylist(list(islice(lines, ROWS)), schema=some.schema)


def family(number: int) -> list[int]:
    """A process and its children."""
    try:
        children = Path(f"/proc/{number}/task/{number}/children").read_text().split()
    except OSError:
        children = []
    return [number, *(one for child in children for one in family(int(child)))]


def memory(number: int) -> int:
    """Bytes that a process holds."""
    try:
        return int(Path(f"/proc/{number}/statm").read_text().split()[1]) * resource.getpagesize()
    except OSError:
        return 0


def run(command: list[str], killed_after: float = float("inf")) -> tuple[float, int, int]:
    """Seconds, the most bytes that all its processes held, and how it ended."""
    begun, peak = time.perf_counter(), 0
    process = subprocess.Popen(command)
    while process.poll() is None:
        peak = max(peak, sum(map(memory, family(process.pid))))
        if time.perf_counter() - begun > killed_after:
            process.kill()
        time.sleep(0.1)
    return time.perf_counter() - begun, peak, process.returncode


def digests(folder: str) -> dict[str, str]:
    """Of the bytes of every file."""
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in Path(folder).iterdir()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--orders", type=int, default=20_000)
    parser.add_argument("--packings", type=int, default=8)
    parser.add_argument("--time-limit", type=float, help="seconds instead of packings")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kills", type=int, default=0)
    add_data_option(parser)
    options = parser.parse_args()
    source, cartons = (data_file(options.data, name) for name in BOOKSHOP)
    with tempfile.TemporaryDirectory() as folder:
        orders = Path(folder) / "orders.parquet"
        write_orders(orders, source, options.orders)
        limit = ["--packings", str(options.packings)]
        if options.time_limit:
            limit = ["--time-limit", str(options.time_limit)]

        def command(out: str) -> list[str]:
            stream = [sys.executable, "-m", "jaxpack", "stream", str(orders), str(cartons), out]
            return [*stream, "--workers", str(options.workers), *limit]

        whole, again = f"{folder}/whole", f"{folder}/again"
        seconds, peak, code = run(command(whole))
        print(
            f"{options.orders:,} orders, {seconds:.1f} s, {options.orders / seconds:.0f} orders/s, "
            f"peak {peak / 2**20:,.0f} MiB, exit code {code}"
        )
        if options.kills:
            codes = [
                run(command(again), seconds / (options.kills + 1))[2] for _ in range(options.kills)
            ]
            codes.append(run(command(again))[2])
            same = digests(whole) == digests(again)
            print(f"exit codes {codes}; {'the same bytes' if same else 'other bytes'}")


if __name__ == "__main__":
    main()
