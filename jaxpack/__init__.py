"""Bin packing learned and solved end to end in JAX.

The public names stand in `__init__.pyi`, one a line. Each is imported when it is first used, with
what it needs: `import jaxpack` alone takes no time and imports neither JAX nor anything that draws,
trains or prints.
"""

from importlib import import_module
from pathlib import Path

__version__ = "0.1.0"

_LINES = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8").splitlines()
_HOMES = {line.split()[3]: line.split()[1] for line in _LINES if line.startswith("from ")}
__all__ = sorted(_HOMES)

# Public until 0.1; here for one release more.
_MOVED = {
    "jaxpack.comparison": "Row",
    "jaxpack.learning.bin_aware": "BinAwareConfig",
    "jaxpack.learning.pointer": "PointerConfig",
    "jaxpack.learning.pointer_network": (
        "Rollout apply_value greedy_order init_pointer sample_order score_order"
    ),
    "jaxpack.learning.presets": "PRESETS",
    "jaxpack.learning.trainer": "TrainState init_state train_step",
    "jaxpack.methods": "Method",
    "jaxpack.model.instances": "uniform_instance",
    "jaxpack.model.metrics": (
        "bins_first_cost bins_used compactness lower_bound paper_cost pyramid utilisation"
    ),
    "jaxpack.model.packing_check": "InvalidPackingError violations",
    "jaxpack.model.problem": "in_orientation",
    "jaxpack.packing.env": "Kinds",
    "jaxpack.search.bin_by_bin": "bin_by_bin orders_found",
    "jaxpack.search.breeding": "BrkgaConfig",
    "jaxpack.search.brkga": "brkga genetic",
    "jaxpack.search.evolved": "evolved",
    "jaxpack.search.heuristics": "footprint_order height_order random_order volume_order",
    "jaxpack.search.protocol": "Search compile_search run_for run_rounds",
    "jaxpack.search.sampling": "best_of sampling",
}


def __getattr__(name):
    if name in _HOMES:
        globals()[name] = value = getattr(import_module(_HOMES[name]), name)
        return value
    for home, names in _MOVED.items():
        if name in names.split():
            import warnings

            what = f"jaxpack.{name} will go with the next release: import it from {home}"
            warnings.warn(what, DeprecationWarning, stacklevel=2)
            return getattr(import_module(home), name)
    raise AttributeError(f"module 'jaxpack' has no attribute '{name}'")


def __dir__():
    return sorted({*globals(), *__all__})
