"""Trains what a partly filled bin is worth while items come one by one, and puts it into the
package.

python experiments/train_online.py online-1 [--updates 4000] [--seed 0]

Writes jaxpack/weights/NAME.json and the learning curve to results/train-NAME.csv: the mean use of
the bins that were filled in every twenty updates, by the weights of the time.
"""

import argparse
import json
import os
import platform
import time
from pathlib import Path

import jax
import numpy as np
from rows import RESULTS, write_rows

import jaxpack
from jaxpack.cli import prepare_jax
from jaxpack.io.atomic import replace_file
from jaxpack.learning.online_training import OnlineConfig, init_online, online_update
from jaxpack.packing.online import SETTINGS

EVERY = 20
UPDATES = {"online-1": 1600, "online-2": 400}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("setting", choices=UPDATES)
    parser.add_argument("--updates", type=int)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    name = options.setting
    config = OnlineConfig(SETTINGS[name], options.updates or UPDATES[name])
    prepare_jax()
    state = init_online(config, jax.random.key(options.seed))
    began, rows = time.perf_counter(), []
    parts: list[tuple[float, ...]] = []
    for number in range(1, config.updates + 1):
        state, metrics = online_update(config, state)
        parts.append(tuple(map(float, metrics)))
        if number % EVERY == 0:
            loss, use, filled = np.array(parts).T
            seconds = time.perf_counter() - began
            rows.append({
                "update": number,
                "seconds": round(seconds),
                "use": round(float((use * filled).sum() / filled.sum()), 4),
                "loss": round(float(loss.mean()), 4),
            })  # fmt: skip
            print(*rows[-1].values(), flush=True)
            parts.clear()
    record = {
        "command": f"python experiments/train_online.py {name} --updates {config.updates} "
        f"--seed {options.seed}",
        "machine": f"1 {jax.devices()[0].device_kind} device, one busy core of {os.cpu_count()}, "
        f"{platform.machine()}",
        "minutes": round((time.perf_counter() - began) / 60, 1),
    }
    weights = {k: np.round(np.asarray(v, float), 5).tolist() for k, v in state.averaged.items()}
    path = Path(jaxpack.__file__).parent / "weights" / f"{name}.json"
    with replace_file(path, "w") as file:
        file.write(json.dumps(record | {"weights": weights}) + "\n")
    write_rows(RESULTS / f"train-{name}.csv", rows, tuple(rows[0]))


if __name__ == "__main__":
    main()
