"""Bin packing learned and solved end to end in JAX.

Everything is an order, one judge turns orders into packings: `pack(problem, instance, order)`.
"""

from jaxpack.comparison import Cell, Comparison, Row, compare
from jaxpack.errors import UserError
from jaxpack.files.weights import Policy, load_policy, save_policy
from jaxpack.learning.pointer import (
    PointerConfig,
    Rollout,
    apply_value,
    greedy_order,
    init_pointer,
    sample_order,
    score_order,
)
from jaxpack.learning.presets import PRESETS, preset
from jaxpack.learning.trainer import (
    TrainConfig,
    TrainState,
    init_state,
    make_train,
    train_step,
)
from jaxpack.methods import MethodOptions, make_method
from jaxpack.packing.first_fit import pack
from jaxpack.packing.instances import Distribution, sample, uniform_instance
from jaxpack.packing.metrics import (
    bins_first_cost,
    bins_used,
    compactness,
    lower_bound,
    paper_cost,
    pyramid,
    utilisation,
)
from jaxpack.packing.problem import Instance, Packing, Problem, make_instance
from jaxpack.packing.validate import InvalidPackingError, check_packings, violations
from jaxpack.solvers.brkga import BrkgaConfig, brkga
from jaxpack.solvers.heuristics import footprint_order, height_order, random_order, volume_order
from jaxpack.solvers.sampling import best_of

__all__ = [
    "PRESETS",
    "BrkgaConfig",
    "Cell",
    "Comparison",
    "Distribution",
    "Instance",
    "InvalidPackingError",
    "MethodOptions",
    "Packing",
    "PointerConfig",
    "Policy",
    "Problem",
    "Rollout",
    "Row",
    "TrainConfig",
    "TrainState",
    "UserError",
    "apply_value",
    "best_of",
    "bins_first_cost",
    "bins_used",
    "brkga",
    "check_packings",
    "compactness",
    "compare",
    "footprint_order",
    "greedy_order",
    "height_order",
    "init_pointer",
    "init_state",
    "load_policy",
    "lower_bound",
    "make_instance",
    "make_method",
    "make_train",
    "pack",
    "paper_cost",
    "preset",
    "pyramid",
    "random_order",
    "sample",
    "sample_order",
    "save_policy",
    "score_order",
    "train_step",
    "uniform_instance",
    "utilisation",
    "violations",
    "volume_order",
]
