"""Latency and throughput of `jaxpack serve`, and whether it bears what should not be sent to it.

pip install 'jaxpack[serve]' httpx
python experiments/serve_load.py [--seconds 60] [--clients 20] [--workers 2] [--data FOLDER]
python experiments/serve_load.py --soak --seconds 300

Starts the service; clients send orders of at most 20 units in a closed loop, made ones or, with
--data, the bookshop's. With --soak some requests are malformed, oversized or slow, every plan is
read again and checked, and memory is looked at. Prints a table; exits 1 where anything is wrong.
"""

import argparse
import asyncio
import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from public_instances import BOOKSHOP, data_file

from jaxpack.io.jobs import job_from_columns
from jaxpack.io.plans import read_plan_json
from jaxpack.model.plan_check import check_plan

UNITS = 20
WAYS = {f"ROTATION_{way}": 1 for way in ("XYZ", "YXZ", "ZYX", "YZX", "XZY", "ZXY")}
CARTONS = [
    {"X": x, "Y": y, "Z": z} for x, y, z in ((200, 150, 100), (310, 230, 160), (600, 400, 300))
]
ODD = {  # bodies that should not be sent -> status of the answer
    b"{": 400,
    b'{"items": [{"X": NaN}]}': 400,
    b'{"a":' * 5000 + b"1" + b"}" * 5000: 400,
    b'{"items": [{"X": 1, "Y": "a", "Z": 1}], "bins": [{"X": 9, "Y": 9, "Z": 9}]}': 422,
    b'{"items": [{"X": 1e999, "Y": 1, "Z": 1}], "bins": [{"X": 9, "Y": 9, "Z": 9}]}': 422,
    b'{"items": 5, "bins": [[[[]]]]}': 422,
    b'"' + b"x" * 2**21 + b'"': 413,
}
SOAK = (0.05, 0.02)  # shares of requests that are odd, and of those that are slow


def made(seed: int) -> Iterator[dict[str, Any]]:
    """Orders of a few small items, such as are sent by mail."""
    random = np.random.default_rng(seed)
    while True:
        items, left = [], min(UNITS, int(random.geometric(0.25)))
        while left > 0:
            copies = min(left, int(random.geometric(0.8)))
            sides = np.clip(random.lognormal((4.6, 4.9, 3.6), 0.5), 8, 290).astype(int).tolist()
            items.append({**dict(zip("XYZ", sides, strict=True)), "COPIES": copies, **WAYS})
            left -= copies
        yield {"items": items, "bins": CARTONS}


def bookshop(folder: Path, seed: int) -> Iterator[dict[str, Any]]:
    """Those of its orders that are not too large, again and again."""
    import csv

    rows: list[list[dict[str, Any]]] = []
    for name in BOOKSHOP:
        with data_file(folder, name).open(newline="") as file:
            rows.append(list(csv.DictReader(file)))
    orders: dict[str, list[dict[str, Any]]] = {}
    for row in rows[0]:
        orders.setdefault(row.pop("ORDER"), []).append(row | WAYS)
    small = [own for own in orders.values() if sum(int(row["COPIES"]) for row in own) <= UNITS]
    bins = [row | {"COST": 1} for row in rows[1]]
    random = np.random.default_rng(seed)
    while True:
        yield {"items": small[int(random.integers(len(small)))], "bins": bins}


def wrong_with(order: dict[str, Any], answer: bytes) -> str:
    """What is wrong with the plan of an order; "" if nothing."""
    job = job_from_columns(order["items"], order["bins"])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.json"
        path.write_bytes(answer)
        try:
            check_plan(job, read_plan_json(path, job))
        except Exception as error:
            return f"{type(error).__name__}: {error}"
    return ""


def memory() -> dict[int, float]:
    """MiB of every process of the service, by its number."""
    done = subprocess.run(["ps", "-eo", "pid,ppid,rss"], capture_output=True, text=True)
    rows = [list(map(int, line.split())) for line in done.stdout.splitlines()[1:]]
    mine = {SERVICE.pid}
    return {pid: rss / 1024 for pid, parent, rss in rows if pid in mine or parent in mine}


async def client(
    number: int, url: str, options: argparse.Namespace, end: float, seen: list, checks: Any
) -> None:
    """One that waits for each answer before it asks again."""
    random = np.random.default_rng(1000 + number)
    orders = bookshop(options.data, number) if options.data else made(number)
    odd = list(ODD.items())
    headers = {"Content-Type": "application/json"}
    async with httpx.AsyncClient(base_url=url, timeout=60, headers=headers) as http:
        while time.perf_counter() < end:
            order, kind = next(orders), random.random() if options.soak else 1.0
            expected, what = 200, "order"
            body = json.dumps(order).encode()
            if kind < SOAK[0]:
                body, expected = odd[int(random.integers(len(odd)))]
                what = "odd"
            elif kind < sum(SOAK):
                body = json.dumps(order | {"options": {"time_limit": 1.0}}).encode()
                what = "slow"
            begun = time.perf_counter()
            answer = await http.post("/v1/solve", content=body)
            seconds = time.perf_counter() - begun
            wrong = "" if answer.status_code == expected else f"{answer.status_code} for {expected}"
            if options.soak and answer.status_code == 200:
                loop = asyncio.get_running_loop()
                wrong = wrong or await loop.run_in_executor(
                    checks, wrong_with, order, answer.content
                )
            seen.append((what, answer.status_code, seconds, wrong))


async def until_ready(url: str) -> None:
    async with httpx.AsyncClient(base_url=url) as http:
        for _ in range(120):
            if (await http.get("/readyz")).status_code == 200:
                return
            await asyncio.sleep(0.5)
    raise SystemExit("the service is not ready after a minute")


async def watch(rows: list[dict[int, float]], every: float) -> None:
    while True:
        rows.append(memory())
        await asyncio.sleep(every)


async def load(url: str, options: argparse.Namespace, checks: Any) -> int:
    """Prints what was measured; the number of things that went wrong."""
    await until_ready(url)
    seen: list[tuple[str, int, float, str]] = []
    resident: list[dict[int, float]] = []
    watching = asyncio.create_task(watch(resident, options.seconds / 20))
    begun = time.perf_counter()
    end = begun + options.seconds
    await asyncio.gather(
        *(client(n, url, options, end, seen, checks) for n in range(options.clients))
    )
    seconds = time.perf_counter() - begun
    watching.cancel()
    print(f"{len(seen)} requests, {len(seen) / seconds:.0f} a second, {options.clients} clients")
    for what in dict.fromkeys(row[0] for row in seen):
        times = np.array([row[2] for row in seen if row[0] == what]) * 1000
        p50, p95 = np.percentile(times, (50, 95))
        rate = len(times) / seconds
        print(f"{what:8} {rate:6.1f} a second, p50 {p50:6.1f} ms, p95 {p95:6.1f} ms")
    print("statuses", dict(Counter(row[1] for row in seen)))
    for pid in resident[0]:
        own = [row[pid] for row in resident if pid in row]
        print(f"process {pid}: MiB {', '.join(f'{mib:.0f}' for mib in own)}")
    wrong = Counter(row[3] for row in seen if row[3])
    print("wrong", dict(wrong) or "nothing")
    return sum(wrong.values())


def main() -> None:
    global SERVICE
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--clients", type=int, default=20)
    parser.add_argument("--workers", type=int, default=None)
    parser.add_argument("--data", type=Path, default=None)
    parser.add_argument("--soak", action="store_true")
    options = parser.parse_args()
    command = [sys.executable, "-m", "jaxpack", "serve", "--port", "0"]
    if options.soak:
        command += ["--kept", str(2**21)]  # full soon: from then on memory should not grow
    if options.workers:
        command += ["--workers", str(options.workers)]
    SERVICE = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        assert SERVICE.stderr
        url = SERVICE.stderr.readline().split(",")[0]
        with ProcessPoolExecutor(1, get_context("spawn")) as checks:
            wrong = asyncio.run(load(url, options, checks))
    finally:
        SERVICE.terminate()
        code = SERVICE.wait(60)
    print("exit code", code)
    sys.exit(bool(wrong or code))


if __name__ == "__main__":
    main()
