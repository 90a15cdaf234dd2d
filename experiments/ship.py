"""Puts the policy of a finished run into the package, with where it comes from beside it.

python experiments/ship.py RUN bin-aware-2d

Writes jaxpack/weights/NAME.npz and .json, and the run's learning curve to results/train-NAME.csv.
"""

import json
import os
import platform
import sys
from pathlib import Path

import jax
from rows import RESULTS, write_rows

from jaxpack import preset
from jaxpack.errors import UserError
from jaxpack.io.runs import RunConfig, read_lines, read_policy, read_run
from jaxpack.io.weights import save_policy, shipped_policies

ROOT = Path(__file__).parent.parent
COLUMNS = ("kind", "update", "cost", "compactness", "pyramid", "bins", "entropy")


def command_of(config: RunConfig) -> str:
    """The command that made a run: the preset, the seed and what differs from the preset."""
    recipe, base = config.train, preset(config.preset)
    command = f"python -m jaxpack.train {config.preset} --seed {config.seed}"
    for name in ("train_instances", "batch", "epochs", "learning_rate", "average",
                 "learner", "discount", "entropy", "clip", "samples", "alpha", "loss_steps",
                 "halves"):  # fmt: skip
        if getattr(recipe, name) != getattr(base, name):
            command += f" --{name.replace('_', '-')} {getattr(recipe, name)}"
    if config.start_from:
        command += f" --start-from {config.start_from}"
    for name in ("hidden", "input_centre", "input_scale"):
        ours, theirs = (getattr(one.policy, name, None) for one in (recipe, base))
        if ours != theirs:
            command += f" --{name.replace('_', '-')} {ours}"
    return command + f" --checkpoint-every {config.checkpoint_every}"


def main() -> None:
    run, name = Path(sys.argv[1]), sys.argv[2]
    config, lines = read_run(run), read_lines(run)
    chunks = [line for line in lines if "validation" not in line]
    if not chunks or chunks[-1]["update"] != config.train.updates:
        raise UserError(f"{run}: not at its end; go on with --resume {run}")
    rows = [
        {"kind": "validation" if "validation" in line else "train"}
        | line
        | line.get("validation", {})
        for line in lines
    ]
    write_rows(RESULTS / f"train-{name}.csv", rows, COLUMNS)
    provenance = {
        "command": command_of(config),
        "seed": config.seed,
        "machine": f"1 {jax.devices()[0].device_kind} device, one core of "
        f"{os.cpu_count()}, {platform.machine()}",
        "minutes": round(chunks[-1]["seconds"] / 60, 1),
    }
    weights = ROOT / "jaxpack" / "weights"
    if config.start_from in shipped_policies():  # the one it began with may be the one it replaces
        provenance["started_from"] = json.loads((weights / f"{config.start_from}.json").read_text())
    save_policy(weights / f"{name}.npz", read_policy(run), provenance)
    print(provenance["command"], provenance["minutes"])


if __name__ == "__main__":
    main()
