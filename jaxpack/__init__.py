"""Bin packing learned and solved end to end in JAX.

Everything is an order, one judge turns orders into packings: `pack(problem, instance, order)`.
"""

from jaxpack.comparison import Comparison, Row, compare
from jaxpack.devices import use_all_cores
from jaxpack.errors import UserError
from jaxpack.files.jobs import read_job
from jaxpack.files.weights import load_policy, save_policy
from jaxpack.learning.beam import beam_orders
from jaxpack.learning.bin_aware import (
    BinState,
    Candidates,
    Kinds,
    candidates,
    order_of,
    orientations_of,
    reset,
    step,
)
from jaxpack.learning.bin_network import BinAwareConfig
from jaxpack.learning.pointer import (
    PointerConfig,
    Rollout,
    apply_value,
    greedy_order,
    init_pointer,
    sample_order,
    score_order,
)
from jaxpack.learning.policies import greedy_orders, init_policy, sample_orders
from jaxpack.learning.presets import PRESETS, preset
from jaxpack.learning.recipe import Policy, TrainConfig
from jaxpack.learning.rollout import choose_orders
from jaxpack.learning.trainer import (
    TrainState,
    init_state,
    make_train,
    train_step,
)
from jaxpack.loading.job import BinType, ItemType, Job, PackedBin, Placement, Plan
from jaxpack.loading.validate import InvalidPlanError, check_plan
from jaxpack.methods import Method, MethodOptions, make_method
from jaxpack.packing.first_fit import pack
from jaxpack.packing.instances import Cell, Distribution, sample, uniform_instance
from jaxpack.packing.metrics import (
    bins_first_cost,
    bins_used,
    compactness,
    lower_bound,
    paper_cost,
    pyramid,
    utilisation,
)
from jaxpack.packing.problem import Instance, Packing, Problem, in_orientation, make_instance
from jaxpack.packing.programs import tune_for_cpu
from jaxpack.packing.validate import InvalidPackingError, check_packings, violations
from jaxpack.solution import Solution, solve
from jaxpack.solvers.bin_by_bin import bin_by_bin, orders_found
from jaxpack.solvers.brkga import BrkgaConfig, brkga, genetic
from jaxpack.solvers.evolved import evolved
from jaxpack.solvers.heuristics import footprint_order, height_order, random_order, volume_order
from jaxpack.solvers.sampling import best_of, sampling
from jaxpack.solvers.search import Search, compile_search, run_for, run_rounds

__all__ = [
    "PRESETS",
    "BinAwareConfig",
    "BinState",
    "BinType",
    "BrkgaConfig",
    "Candidates",
    "Cell",
    "Comparison",
    "Distribution",
    "Instance",
    "InvalidPackingError",
    "InvalidPlanError",
    "ItemType",
    "Job",
    "Kinds",
    "Method",
    "MethodOptions",
    "PackedBin",
    "Packing",
    "Placement",
    "Plan",
    "PointerConfig",
    "Policy",
    "Problem",
    "Rollout",
    "Row",
    "Search",
    "Solution",
    "TrainConfig",
    "TrainState",
    "UserError",
    "apply_value",
    "beam_orders",
    "best_of",
    "bin_by_bin",
    "bins_first_cost",
    "bins_used",
    "brkga",
    "candidates",
    "check_packings",
    "check_plan",
    "choose_orders",
    "compactness",
    "compare",
    "compile_search",
    "evolved",
    "footprint_order",
    "genetic",
    "greedy_order",
    "greedy_orders",
    "height_order",
    "in_orientation",
    "init_pointer",
    "init_policy",
    "init_state",
    "load_policy",
    "lower_bound",
    "make_instance",
    "make_method",
    "make_train",
    "order_of",
    "orders_found",
    "orientations_of",
    "pack",
    "paper_cost",
    "preset",
    "pyramid",
    "random_order",
    "read_job",
    "reset",
    "run_for",
    "run_rounds",
    "sample",
    "sample_order",
    "sample_orders",
    "sampling",
    "save_policy",
    "score_order",
    "solve",
    "step",
    "train_step",
    "tune_for_cpu",
    "uniform_instance",
    "use_all_cores",
    "utilisation",
    "violations",
    "volume_order",
]
