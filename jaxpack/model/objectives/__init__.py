"""What can be wanted of a packing, in one table."""

import math
from collections.abc import Callable
from dataclasses import replace

from jaxpack.errors import UserError
from jaxpack.model.bounds import Bounds
from jaxpack.model.job import Job, Plan
from jaxpack.model.numbers import show
from jaxpack.model.objectives.base import Cost, Objective, Placed
from jaxpack.model.objectives.bins import BINS
from jaxpack.model.objectives.height import HEIGHT
from jaxpack.model.objectives.paper import PAPER
from jaxpack.model.objectives.price import PRICE
from jaxpack.model.objectives.value import VALUE
from jaxpack.model.rules import Rules

__all__ = [
    "OBJECTIVES",
    "Cost",
    "Objective",
    "Placed",
    "bounds",
    "gap",
    "grid_costs",
    "named",
    "objective_of",
]

OBJECTIVES: dict[str, Objective] = {
    "bins": BINS,
    "price": PRICE,
    "value": VALUE,
    "height": HEIGHT,
    "paper": PAPER,
}
"""Name -> objective; whoever adds one can name it wherever one is chosen."""


def named(name: str) -> Objective:
    """The objective of orders with that name.

    Raises:
        UserError: there is none.
    """
    known = [other for other, one in OBJECTIVES.items() if one.of_orders]
    if name not in known:
        raise UserError(f"objective {show(name)}: choose {', '.join(known[:-1])} or {known[-1]}")
    return OBJECTIVES[name]


def grid_costs(called: str = "objective", chosen: str | None = None) -> dict[str, Callable]:
    """Name -> cost of the objectives of instances, see `Objective.on_grid`.

    Args:
        called: what the UserError calls the name.
        chosen: a name that has to be among them.

    Raises:
        UserError: where it is not.
    """
    costs = {name: one.on_grid for name, one in OBJECTIVES.items() if one.on_grid}
    if chosen is not None and chosen not in costs:
        raise UserError(f"{called} {show(chosen)}: choose {' or '.join(costs)}")
    return costs


def objective_of(job: Job) -> Objective:
    """What is wanted of a plan for the job; where it does not say, it is as its bins have costs.

    Raises:
        UserError: there is no such objective.
    """
    return named(job.objective or ("price" if job.priced else "bins"))


def bounds(job: Job, seconds: float | None = None, rules: Rules = Rules()) -> Bounds:
    """Below which no plan's worth is, by rules of which the overhang counts: `Objective.bound`."""
    goal = objective_of(job)
    job = goal.prepared(job, rules)
    if rules.overhang:
        kinds = (
            replace(kind, limits=replace(kind.limits, overhang=rules.overhang)) for kind in job.bins
        )
        job = replace(job, bins=tuple(kinds))
    return goal.bound(job, seconds)


def gap(job: Job, plan: Plan, bounds: Bounds) -> float | None:
    """How far a plan is above the least that is possible, at most: 0.05 is 5 %.

    Of the objective's measure, below the most if that is maximised. Infinite where the least may
    be nothing; None where items are left out that should not be, as the bounds are for all of them.
    """
    goal = objective_of(job)
    if len(plan.left_out) > bounds.unfit and not goal.leaves_out:
        return None
    found = goal.measure(job, plan)
    if found >= bounds.best if goal.maximised else found <= bounds.best:
        return 0.0
    return abs(found / bounds.best - 1) if bounds.best else math.inf
