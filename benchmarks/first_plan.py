"""Seconds from process start to the first plan, without and with the compilation cache.

python benchmarks/first_plan.py

The 60 cartons of experiments/data on their pallet, and 1,000 items of 200 random types, turned
upright, on the same pallet: three times each in one empty cache folder, until the first line that
names a plan. The last column is the most memory that the processes of a job held.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

DATA = Path(__file__).parent.parent / "experiments" / "data"
LIMIT = "60"  # seconds that a job may take


def write_thousand(path: Path, seed: int = 1) -> None:
    """200 types of boxes with sides in whole centimetres, five of each."""
    random = np.random.default_rng(seed)
    rows = ["X,Y,Z,COPIES,WEIGHT,ROTATION_XYZ,ROTATION_YXZ,NAME"]
    for number in range(200):
        x, y, z = random.integers(10, 41, 3) * 10
        rows.append(f"{x},{y},{z},5,{random.integers(1, 10)},1,1,type-{number}")
    path.write_text("\n".join(rows) + "\n")


def first_plan(items: Path, cache: Path) -> tuple[float, str]:
    """(seconds until a plan is there, what the door says of it)."""
    command = [sys.executable, "-m", "jaxpack.solve", str(items), str(DATA / "pallet.csv")]
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(cache)}
    start = time.perf_counter()
    with subprocess.Popen(
        [*command, "--time-limit", LIMIT], env=environment, stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL, text=True,
    ) as process:  # fmt: skip
        for line in process.stderr or ():
            if "bins" in line:
                seconds = time.perf_counter() - start
                process.terminate()
                process.communicate()
                return seconds, line.strip()
    raise SystemExit(f"{items}: no plan")


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        thousand = Path(folder) / "thousand.csv"
        write_thousand(thousand)
        for items in (DATA / "cartons.csv", thousand):
            for name in ("cold", "warm", "warm again"):
                seconds, line = first_plan(items, Path(folder) / f"cache-{items.stem}")
                most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
                print(f"{items.stem}, {name}: {seconds:.1f} s ({line}), {most:.2f} GiB")


if __name__ == "__main__":
    main()
