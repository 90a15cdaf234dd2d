"""The paper's recipes, run as a user runs them, timed from outside; makes the shipped weights.

python experiments/train_paper.py 2d  (5 minutes on two cores)
python experiments/train_paper.py 3d  (17 minutes or less on two cores)

Writes results/train-DIM.csv (the run's metrics, a line per 250 updates, and its validations),
results/train-DIM.txt (its final table, wall time and peak memory) and jaxpack/weights.
"""

import os
import platform
import resource
import subprocess
import sys
import time
from pathlib import Path

import jax
from rows import write_rows

from jaxpack.io.atomic import replace_file
from jaxpack.io.runs import read_lines, read_policy
from jaxpack.io.weights import save_policy

ROOT = Path(__file__).parent.parent
RESULTS = Path(__file__).parent / "results"


def train(dimension: str) -> tuple[Path, float, float]:
    """Runs the door: (run folder, minutes, peak memory in GiB)."""
    run = ROOT / "runs" / f"train-paper-{dimension}"
    command = ["-m", "jaxpack.train", f"paper-{dimension}", "--seed", "0", "--run", str(run)]
    start = time.perf_counter()
    subprocess.run([sys.executable, *command], check=True, cwd=ROOT)
    minutes = (time.perf_counter() - start) / 60
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
    return run, minutes, peak


def write_metrics(path: Path, run: Path) -> None:
    names = ("update", "epoch", "cost", "compactness", "pyramid", "bins", "entropy", "critic_loss")
    rows = [
        {"kind": "validation"} | record | record["validation"]
        if "validation" in record
        else {"kind": "train"} | record
        for record in read_lines(run)
        if "validation" in record or record["update"] % 250 == 0
    ]
    write_rows(path, rows, ("kind", *names))


def main() -> None:
    (dimension,) = sys.argv[1:]
    run, minutes, peak = train(dimension)
    RESULTS.mkdir(exist_ok=True)
    write_metrics(RESULTS / f"train-{dimension}.csv", run)
    machine = f"{jax.device_count()} {jax.devices()[0].device_kind} device, "
    machine += f"{len(os.sched_getaffinity(0))} cores, {platform.machine()}"
    command = f"python -m jaxpack.train paper-{dimension} --seed 0"
    with replace_file(RESULTS / f"train-{dimension}.txt") as file:
        file.write((run / "table.txt").read_text())
        file.write(f"\n{command}\n{minutes:.1f} minutes, {peak:.2f} GiB at most, {machine}\n")
    provenance = {"command": command, "seed": 0, "machine": machine, "minutes": round(minutes, 1)}
    weights = ROOT / "jaxpack" / "weights" / f"pointer-{dimension}.npz"
    save_policy(weights, read_policy(run), provenance)


if __name__ == "__main__":
    main()
