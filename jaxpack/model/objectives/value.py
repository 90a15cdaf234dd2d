"""The greatest value of what is packed: bins hold the best subset, and the rest is left out."""

from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from jaxpack.model.bounds import Bounds
from jaxpack.model.figures import bins_worth, plan_profit, profit_of
from jaxpack.model.job import Job, Plan
from jaxpack.model.knapsack import cheapest, most_profit
from jaxpack.model.objectives.base import Objective, Placed, sum_by_bin

if TYPE_CHECKING:
    from jaxpack.model.encoding import Stock

STEEP = 8.0  # cost of all that the bins can hold: a change then costs about as much as for `bins`
OF_BINS = 1e-4  # of the price of the bins: least, where equal values are in more of them


def _worth(job: Job, plan: Plan) -> tuple[Fraction | int, ...]:
    return -plan_profit(job, plan), *bins_worth(VALUE.parts, job, plan)[1:]


def _bound(job: Job, seconds: float | None) -> Bounds:
    most, few, goods = most_profit(job)
    worth = -most, *cheapest(VALUE.parts, goods.kinds, few)
    return Bounds(0, 0.0, goods.unfit, worth, float(most))


def _value(job: Job, plan: Plan) -> float:
    return float(plan_profit(job, plan))


def _total(job: Job) -> float:
    return float(sum(profit_of(item) * item.copies for item in job.items))


def _cost(stock: "Stock", placed: Placed) -> np.ndarray:
    """1 less the share of what the bins can hold at best, by volume: see `Cost`."""
    value = (placed.bin >= 0) @ stock.profit.astype(float)
    used = sum_by_bin(placed.bin, stock.mask * 1.0, len(stock.price)) > 0
    return STEEP * (1 - value) + OF_BINS * (used @ stock.price.astype(float))


VALUE = Objective(
    minimised="greatest value, then the fewest bins, then the least volume of bins",
    worth=_worth,
    bound=_bound,
    measure=_value,
    cost=_cost,
    figure="value",
    total=_total,
    maximised=True,
    leaves_out=True,
    fills=True,
    obeys=("PROFIT",),
)
