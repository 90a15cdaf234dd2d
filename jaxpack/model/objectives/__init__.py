"""What can be wanted of a packing, in one table."""

import math

from jaxpack.errors import UserError
from jaxpack.model.bounds import Bounds
from jaxpack.model.job import Job, Plan
from jaxpack.model.objectives.base import Cost, Objective, Placed
from jaxpack.model.objectives.bins import BINS
from jaxpack.model.objectives.paper import PAPER
from jaxpack.model.objectives.price import PRICE

__all__ = ["OBJECTIVES", "Cost", "Objective", "Placed", "bounds", "gap", "objective_of"]

OBJECTIVES: dict[str, Objective] = {"bins": BINS, "price": PRICE, "paper": PAPER}


def objective_of(job: Job) -> Objective:
    """What is wanted of a plan for the job; where it does not say, it is as its bins have costs.

    Raises:
        UserError: there is no such objective, or it is not for such jobs.
    """
    name = job.objective or ("price" if job.priced else "bins")
    known = [other for other, one in OBJECTIVES.items() if one.of_orders]
    if name not in known:
        raise UserError(f"objective '{name}': choose {', '.join(known[:-1])} or {known[-1]}")
    return OBJECTIVES[name]


def bounds(job: Job, seconds: float | None = None) -> Bounds:
    """Below which no plan's worth is: see `Objective.bound`."""
    return objective_of(job).bound(job, seconds)


def gap(job: Job, plan: Plan, bounds: Bounds) -> float | None:
    """How far a plan is above the least that is possible, at most: 0.05 is 5 %.

    Of what is minimised. Infinite where that may be nothing; None where items that fit are left
    out, as the bounds are for all of them.
    """
    if len(plan.left_out) > bounds.unfit:
        return None
    found = objective_of(job).measure(job, plan)
    if found <= bounds.best:
        return 0.0
    return found / bounds.best - 1 if bounds.best else math.inf
