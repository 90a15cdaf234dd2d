"""What the rules of loads and of stability cost those who ask for none, beside an older state.

python -m benchmarks.rules_off --older CHECKOUT [--pairs 5]           (ten minutes)

CHECKOUT is this project before it had them, such as `git worktree add ../before 7f3861b`. Whole
commands with equal work (packings, instances), of either state in turn; CPU seconds, the least of
all pairs and the median of the pairs' ratios. The first pair compiles and is not counted.
"""

import argparse
import csv
import os
import random
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.timing import report

WAYS = ("XYZ", "YXZ", "ZYX", "YZX", "XZY", "ZXY")
METHODS = "height,best-of-200,brkga,bin-aware,bin-aware-beam-4,bin-aware-search"
DECODER = """
import jax, jax.numpy as jnp, numpy as np
from jaxpack import Instance, Problem, pack
problem = Problem((600, 400, 400), inclusive=False, surface="faces", most=40)
draw = np.random.default_rng(0)
sizes = jnp.asarray(draw.integers(40, 250, (64, 80, 3)), jnp.int32)
bins = jnp.tile(jnp.asarray([problem.bin], jnp.int32), (64, 1))
decode = jax.jit(jax.vmap(lambda *leaves: pack(problem, Instance(*leaves[:-1]), leaves[-1])))
for _ in range(4):
    orders = jnp.asarray(draw.permuted(np.tile(np.arange(80), (64, 1)), axis=1), jnp.int32)
    decode(sizes, jnp.ones((64, 80), bool), bins, orders).bin.block_until_ready()
"""
COMMANDS = {
    "300 orders": ["-m", "jaxpack", "solve", "orders.csv", "bins.csv", "--packings", "8"],
    "the decoder without a grid": ["-c", DECODER],
    "the grid": [
        *("-m", "jaxpack", "evaluate", "bin-aware-3d", "--methods", METHODS, "--instances", "100"),
    ],
}


def write_orders(folder: Path) -> None:
    """Of up to six types and six copies of each, in cartons of 400 and 600 mm."""
    draw = random.Random(0)
    (folder / "bins.csv").write_text("X,Y,Z,NAME\n600,400,400,large\n400,300,300,small\n")
    with (folder / "orders.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["ORDER", "X", "Y", "Z", "COPIES", *(f"ROTATION_{way}" for way in WAYS)])
        for order in range(300):
            for _ in range(draw.randint(3, 6)):
                sides = [draw.randint(40, 250) for _ in "XYZ"]
                table.writerow([order, *sides, draw.randint(1, 6), *(1 for _ in WAYS)])


def seconds(checkout: Path, command: list[str], folder: Path) -> float:
    """CPU seconds of a command and its processes."""
    caches = folder / checkout.name
    environment = os.environ | {"PYTHONPATH": str(checkout), "XDG_CACHE_HOME": str(caches)}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, *command],
        cwd=folder,
        env=environment,
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--older", type=Path, required=True, help="a checkout of an older state")
    parser.add_argument("--pairs", type=int, default=5)
    options = parser.parse_args()
    older, today = options.older.resolve(), Path(__file__).parents[1].resolve()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_orders(folder)
        for what, command in COMMANDS.items():
            off = ["--stability", "share"] if "solve" in command else []
            pairs = []
            for _ in range(options.pairs + 1):
                before = seconds(older, command, folder)
                pairs.append((before, seconds(today, [*command, *off], folder)))
            before, after = (min(some) for some in zip(*pairs[1:], strict=True))
            rows.append(
                {
                    "command": what,
                    "before, CPU s": before,
                    "rules off, CPU s": after,
                    "ratio": after / before,
                    "median ratio": statistics.median(new / old for old, new in pairs[1:]),
                }
            )
            print(rows[-1], flush=True)
    report("rules_off", rows)


if __name__ == "__main__":
    main()
