"""Bin packing learned and solved end to end in JAX.

Everything is an order, one judge turns orders into packings: `pack(problem, instance, order)`.

Every name below is imported when it is first used, with what it needs: `import jaxpack` alone
takes no time and imports neither JAX nor anything that draws, trains or prints.
"""

from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from jaxpack.comparison import (  # noqa: I001
        Comparison as Comparison,
        Row as Row,
        compare as compare,
    )
    from jaxpack.xla.devices import use_all_cores as use_all_cores
    from jaxpack.errors import UserError as UserError
    from jaxpack.io.jobs import read_job as read_job
    from jaxpack.io.weights import load_policy as load_policy, save_policy as save_policy
    from jaxpack.packing.env import (
        Choice as Choice,
        Choices as Choices,
        Decisions as Decisions,
        Kinds as Kinds,
        State as State,
        decisions_of as decisions_of,
        observe as observe,
        positions as positions,
        reset as reset,
        step as step,
    )
    from jaxpack.packing.table import Table as Table
    from jaxpack.learning.bin_aware import BinAwareConfig as BinAwareConfig
    from jaxpack.learning.networks import NETWORKS as NETWORKS, Network as Network
    from jaxpack.learning.pointer import PointerConfig as PointerConfig
    from jaxpack.learning.pointer_network import (
        Rollout as Rollout,
        apply_value as apply_value,
        greedy_order as greedy_order,
        init_pointer as init_pointer,
        sample_order as sample_order,
        score_order as score_order,
    )
    from jaxpack.learning.presets import PRESETS as PRESETS, preset as preset
    from jaxpack.learning.recipe import Policy as Policy, TrainConfig as TrainConfig
    from jaxpack.learning.trainer import (
        TrainState as TrainState,
        init_state as init_state,
        make_train as make_train,
        train_step as train_step,
    )
    from jaxpack.model.job import (
        BinType as BinType,
        ItemType as ItemType,
        Job as Job,
        PackedBin as PackedBin,
        Placement as Placement,
        Plan as Plan,
    )
    from jaxpack.model.plan_check import (
        InvalidPlanError as InvalidPlanError,
        check_plan as check_plan,
    )
    from jaxpack.methods import (
        Method as Method,
        MethodOptions as MethodOptions,
        make_method as make_method,
    )
    from jaxpack.packing.first_fit import pack as pack
    from jaxpack.model.instances import (
        Cell as Cell,
        Distribution as Distribution,
        sample as sample,
        uniform_instance as uniform_instance,
    )
    from jaxpack.model.objectives import (
        bins_first_cost as bins_first_cost,
        bins_used as bins_used,
        compactness as compactness,
        lower_bound as lower_bound,
        paper_cost as paper_cost,
        pyramid as pyramid,
        utilisation as utilisation,
    )
    from jaxpack.model.problem import (
        Instance as Instance,
        Packing as Packing,
        Problem as Problem,
        in_orientation as in_orientation,
        make_instance as make_instance,
    )
    from jaxpack.xla.programs import tune_for_cpu as tune_for_cpu
    from jaxpack.model.packing_check import (
        InvalidPackingError as InvalidPackingError,
        check_packings as check_packings,
        violations as violations,
    )
    from jaxpack.solution import Solution as Solution, solve as solve
    from jaxpack.search.bin_by_bin import bin_by_bin as bin_by_bin, orders_found as orders_found
    from jaxpack.search.brkga import BrkgaConfig as BrkgaConfig, brkga as brkga, genetic as genetic
    from jaxpack.search.evolved import evolved as evolved
    from jaxpack.search.heuristics import (
        footprint_order as footprint_order,
        height_order as height_order,
        random_order as random_order,
        volume_order as volume_order,
    )
    from jaxpack.search.sampling import best_of as best_of, sampling as sampling
    from jaxpack.search.protocol import (
        Search as Search,
        compile_search as compile_search,
        run_for as run_for,
        run_rounds as run_rounds,
    )
else:  # the same names once more: a type checker reads neither this nor what it does
    from importlib import import_module

    _NAMES = {
        "comparison": "Comparison Row compare",
        "xla.devices": "use_all_cores",
        "errors": "UserError",
        "io.jobs": "read_job",
        "io.weights": "load_policy save_policy",
        "packing.env": (
            "Choice Choices Decisions Kinds State decisions_of observe positions reset step"
        ),
        "packing.table": "Table",
        "learning.bin_aware": "BinAwareConfig",
        "learning.networks": "NETWORKS Network",
        "learning.pointer": "PointerConfig",
        "learning.pointer_network": (
            "Rollout apply_value greedy_order init_pointer sample_order score_order"
        ),
        "learning.presets": "PRESETS preset",
        "learning.recipe": "Policy TrainConfig",
        "learning.trainer": "TrainState init_state make_train train_step",
        "model.job": "BinType ItemType Job PackedBin Placement Plan",
        "model.plan_check": "InvalidPlanError check_plan",
        "methods": "Method MethodOptions make_method",
        "packing.first_fit": "pack",
        "model.instances": "Cell Distribution sample uniform_instance",
        "model.objectives": (
            "bins_first_cost bins_used compactness lower_bound paper_cost pyramid utilisation"
        ),
        "model.problem": "Instance Packing Problem in_orientation make_instance",
        "xla.programs": "tune_for_cpu",
        "model.packing_check": "InvalidPackingError check_packings violations",
        "solution": "Solution solve",
        "search.bin_by_bin": "bin_by_bin orders_found",
        "search.brkga": "BrkgaConfig brkga genetic",
        "search.evolved": "evolved",
        "search.heuristics": "footprint_order height_order random_order volume_order",
        "search.sampling": "best_of sampling",
        "search.protocol": "Search compile_search run_for run_rounds",
    }
    _HOMES = {name: module for module, names in _NAMES.items() for name in names.split()}
    __all__ = sorted(_HOMES)

    def __getattr__(name):
        if name not in _HOMES:
            raise AttributeError(f"module 'jaxpack' has no attribute '{name}'")
        globals()[name] = value = getattr(import_module(f"jaxpack.{_HOMES[name]}"), name)
        return value

    def __dir__():
        return sorted({*globals(), *__all__})
