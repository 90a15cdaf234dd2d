"""Whether a time limit is kept: 300 random jobs of a second each while something else has a core,
with an empty compilation cache.

python -m benchmarks.time_limits [--jobs 300] [--limit 1] [--seed 0]     (8 minutes)

2D and 3D, 1 to 3,000 rows, numbers of 1 to 17 digits, copies, weights, several types of bins, with
costs and without. Every plan is checked by the independent check. Then: what this process and its
children use of the CPU in the second after the last one. Writes results/time_limits.csv.
"""

import argparse
import multiprocessing
import os
import tempfile
import time

import numpy as np
import psutil

import jaxpack
from benchmarks.timing import report
from jaxpack.model.job import FLAT_TURNED, MOST_ITEMS, ORIENTATIONS, BinType, ItemType, Job


def busy() -> None:
    """Keeps a core from doing anything else."""
    while True:
        pass


def random_job(seed: int) -> Job:
    """One of the jobs."""
    random = np.random.default_rng(seed)
    dimension = int(random.integers(2, 4))
    rows = int(np.exp(random.uniform(0, np.log(3000))))
    digits = int(random.integers(1, 18))

    def number(low: float, high: float) -> float:
        return float(f"{random.uniform(low, high):.{digits}g}")

    side = 10.0 ** random.uniform(0, 4)
    least = random.choice([0.02, 0.1, 0.3])
    names = FLAT_TURNED if dimension == 2 else tuple(ORIENTATIONS)
    ways = names[: int(random.integers(1, len(names) + 1))]
    weighs = random.random() < 0.5
    several = random.random() < 0.3
    flat = slice(1, 2) if dimension == 2 else slice(0, 0)

    def sides(low: float, high: float) -> tuple[float, ...]:
        three = [max(number(low * side, high * side), 1e-9) for _ in range(3)]
        three[flat] = [1.0] * len(three[flat])
        return tuple(three)

    most = int(random.choice([1, 1, 3, 20]))
    items = tuple(
        ItemType(
            sides(least, 0.6),
            int(random.integers(1, most + 1)),
            number(0.1, 30) if weighs else 0.0,
            ways,
        )
        for _ in range(rows)
    )
    limit = number(200, 2000) if weighs and random.random() < 0.7 else float("inf")
    costs = [number(1, 9) if random.random() < 0.5 else None for _ in range(3)]
    bins = tuple(
        BinType(sides(0.9, 1.1) if n else sides(1.0, 1.0), costs[n], None, limit)
        for n in range(1 + 2 * several)
    )
    assert sum(item.copies for item in items) <= MOST_ITEMS
    return Job(items, bins, dimension, f"random-{seed}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=300)
    parser.add_argument("--limit", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    cache = tempfile.TemporaryDirectory(prefix="jaxpack-")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = cache.name  # of the process that compiles
    other = multiprocessing.get_context("spawn").Process(target=busy, daemon=True)
    other.start()
    rows = []
    for number in range(options.jobs):
        job = random_job(options.seed * 10_000 + number)
        begun = time.perf_counter()
        found = jaxpack.solve(job, time_limit=options.limit, skip_unfit=True)
        took = time.perf_counter() - begun
        jaxpack.check_plan(job, found.plan)
        assert found.gap is None or found.gap >= 0
        row = {"job": job.name, "dimension": job.dimension, "rows": len(job.items)}
        row |= {"items": job.count, "bins": found.figures.bins, "bound": found.bound}
        rows.append(row | {"end": found.end.name, "seconds": round(took, 3)})
        if took > options.limit + 0.5:
            print(rows[-1], flush=True)
    me = psutil.Process()
    everyone = [me, *(one for one in me.children(recursive=True) if one.pid != other.pid)]
    before = sum(sum(one.cpu_times()[:2]) for one in everyone)
    time.sleep(1)
    after = sum(sum(one.cpu_times()[:2]) for one in everyone) - before
    other.terminate()
    times = np.sort([row["seconds"] for row in rows])
    summary = {"jobs": len(rows), "limit, s": options.limit, "median, s": np.median(times)}
    summary |= {"longest, s": times[-1], "over by 1 s": int((times > options.limit + 1).sum())}
    report("time_limits", [summary | {"CPU in the second after, s": round(after, 2)}])


if __name__ == "__main__":
    main()
