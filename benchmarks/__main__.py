"""python -m benchmarks [SECTION ...]: every section prints one table and writes one csv.

Sections: placement, training, genetic, sweeps, growth. All if none is named. And `accelerator`, for
a GPU, only if named.
"""

import sys
from importlib import import_module

from jaxpack.devices import use_all_cores
from jaxpack.packing.programs import compile_loops_whole

SECTIONS = ("placement", "training", "genetic", "sweeps", "growth")


def main() -> None:
    use_all_cores()
    compile_loops_whole()
    chosen = sys.argv[1:] or SECTIONS
    for name in chosen:
        if name not in (*SECTIONS, "accelerator"):
            raise SystemExit(f"unknown section '{name}': choose from {', '.join(SECTIONS)}")
        import_module(f"benchmarks.{name}").main()


if __name__ == "__main__":
    main()
