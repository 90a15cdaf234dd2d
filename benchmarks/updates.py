"""An update of the paper's recipes beside an older state: processor time, and memory.

python -m benchmarks.updates --older CHECKOUT [--pairs 5]             (five minutes)

CHECKOUT is this project before its gradient was written anew, such as
`git worktree add ../before abe3813`. Either state in turn, in a process of its own on one device:
20 updates, one a call and all in one as in training, the least of all pairs and the median of the
pairs' ratios. What is compiled is not counted.
"""

import argparse
import json
import statistics
import subprocess
import sys
from pathlib import Path

from benchmarks.timing import report

RUN = """
import json, resource, sys, time
import jax
from jaxpack.learning.presets import preset
from jaxpack.learning.trainer import init_state, train_chunk

config, times = preset(sys.argv[1]), {}
for size in (1, 20):
    state, _ = train_chunk(config, init_state(config, jax.random.key(0)), size)
    jax.block_until_ready(state)
    begun = time.process_time()
    for _ in range(20 // size):
        state, _ = train_chunk(config, state, size)
    jax.block_until_ready(state)
    times[size] = (time.process_time() - begun) / 20 * 1000
memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(json.dumps([times[1], times[20], memory]))
"""
WHAT = ("one update a call, ms", "20 updates a call, ms an update", "most memory, MiB")


def measured(checkout: Path, recipe: str) -> list[float]:
    """The figures of `WHAT`."""
    run = subprocess.run(
        [sys.executable, "-c", RUN, recipe],
        cwd=checkout,  # where `-c` looks for modules first
        check=True,
        capture_output=True,
        text=True,
    )
    figures: list[float] = json.loads(run.stdout.splitlines()[-1])
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--older", type=Path, required=True, help="a checkout of an older state")
    parser.add_argument("--pairs", type=int, default=5)
    options = parser.parse_args()
    states = options.older.resolve(), Path(__file__).parents[1].resolve()
    rows = []
    for recipe in ("paper-2d", "paper-3d"):
        runs = [[measured(state, recipe) for state in states] for _ in range(options.pairs)]
        for row, what in enumerate(WHAT):
            column = [(old[row], new[row]) for old, new in runs]
            before, after = (min(some) for some in zip(*column, strict=True))
            rows.append(
                {
                    "recipe": recipe,
                    "what": what,
                    "before": before,
                    "now": after,
                    "before / now": before / after,
                    "median": statistics.median(old / new for old, new in column),
                }
            )
            print(rows[-1], flush=True)
    report("updates", rows)


if __name__ == "__main__":
    main()
