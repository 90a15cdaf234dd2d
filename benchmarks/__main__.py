"""python -m benchmarks [SECTION ...]: every section prints one table and writes one csv.

Sections: placement, training, genetic, sweeps, growth, online, check. All if none is named. And,
only if named, `exact`, which reads public instances, and `accelerator`, for a GPU. Each has a
process of its own: after others in one process it is slower.
"""

import subprocess
import sys
from importlib import import_module

from jaxpack.xla.devices import use_all_cores
from jaxpack.xla.programs import tune_for_cpu

SECTIONS = ("placement", "training", "genetic", "sweeps", "growth", "online", "check")


def main() -> None:
    chosen = sys.argv[1:] or SECTIONS
    for name in chosen:
        if name not in (*SECTIONS, "exact", "accelerator"):
            raise SystemExit(f"unknown section '{name}': choose from {', '.join(SECTIONS)}")
    if len(chosen) == 1:
        use_all_cores()
        tune_for_cpu()
        import_module(f"benchmarks.{chosen[0]}").main()
        return
    for name in chosen:
        if code := subprocess.run([sys.executable, "-m", "benchmarks", name]).returncode:
            raise SystemExit(code)


if __name__ == "__main__":
    main()
