"""Seconds from process start to the first plan, without and with the compilation cache.

python benchmarks/first_plan.py     (3 minutes)

The 60 cartons of examples/order.csv on their pallet, and 1,000 items of 200 random types, turned
upright, on the same pallet: until the first line that names a plan in an empty cache folder, then
a whole job, which fills it, then once more until the first plan. Memory is the most that any of
the processes so far held.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

EXAMPLES = Path(__file__).parent.parent / "examples"
LIMIT = 40  # seconds that a job may take


def write_thousand(path: Path, seed: int = 1) -> None:
    """200 types of boxes with sides in whole centimetres, five of each."""
    random = np.random.default_rng(seed)
    rows = ["X,Y,Z,COPIES,WEIGHT,ROTATION_XYZ,ROTATION_YXZ,NAME"]
    for number in range(200):
        x, y, z = random.integers(10, 41, 3) * 10
        rows.append(f"{x},{y},{z},5,{random.integers(1, 10)},1,1,type-{number}")
    path.write_text("\n".join(rows) + "\n")


def plans(items: Path, cache: Path, whole: bool) -> tuple[float, str]:
    """(seconds until the first plan is there, or all is done; what the door says of the plan)."""
    command = [sys.executable, "-m", "jaxpack.solve", str(items), str(EXAMPLES / "pallet.csv")]
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(cache)}
    start, last = time.perf_counter(), ""
    with subprocess.Popen(
        [*command, "--time-limit", str(LIMIT)], env=environment, stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL, text=True,
    ) as process:  # fmt: skip
        for line in process.stderr or ():
            if "bins" in line:
                last = line.strip()
                if not whole:
                    break
        seconds = time.perf_counter() - start
        process.terminate()
        process.communicate()
    if not last:
        raise SystemExit(f"{items}: no plan")
    return seconds, last


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        thousand = Path(folder) / "thousand.csv"
        write_thousand(thousand)
        for items in (EXAMPLES / "order.csv", thousand):
            cache = Path(folder) / f"cache-{items.stem}"
            for name, whole in (("first, cold", False), ("whole", True), ("first, warm", False)):
                seconds, line = plans(items, cache, whole)
                most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
                print(f"{items.stem}, {name}: {seconds:.1f} s ({line}), {most:.2f} GiB")


if __name__ == "__main__":
    main()
