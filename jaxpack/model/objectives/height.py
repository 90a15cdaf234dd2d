"""The least height of everything in one bin, whose own height is a limit or open."""

from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from jaxpack.errors import UserError
from jaxpack.model.bounds import Bounds, least_height
from jaxpack.model.exact import exact
from jaxpack.model.job import BinType, Job, Plan
from jaxpack.model.objectives.base import Objective, Placed, left_out_cost
from jaxpack.model.rules import Rules

if TYPE_CHECKING:
    from jaxpack.model.encoding import Stock

STEEP = 8.0  # cost of the height that the volume needs, as for the value: 1 % is 0.08
OF_LEVEL = 0.1  # of that, what is low beside the highest counts


def _prepared(job: Job, rules: Rules) -> Job:
    """With one bin, as high as the items all on top of each other where it is open."""
    if (there := sum(kind.copies != 0 for kind in job.bins)) != 1:
        raise UserError(f"objective height: {there} types of bins; give one bin")

    gaps = exact(rules.spacing(job.dimension)[2]) * sum(item.copies for item in job.items)
    pile = float(exact(job.pile) + gaps)

    def closed(kind: BinType) -> BinType:
        x, y, z = kind.size
        copies = 0 if kind.copies == 0 else 1
        return replace(kind, size=(x, y, pile if kind.open else z), copies=copies)

    bins = tuple(map(closed, job.bins))
    return job if bins == job.bins else replace(job, bins=bins)


def _height(job: Job, plan: Plan) -> float:
    return max((job.room(packed)[2] for packed in plan.bins), default=0.0)


def _worth(job: Job, plan: Plan) -> tuple[Fraction | int, ...]:
    return len(plan.left_out), exact(_height(job, plan))


def _bound(job: Job, seconds: float | None) -> Bounds:
    least, goods = least_height(job, seconds)
    some = int(least > 0)
    return Bounds(some, 0.0, goods.unfit, (goods.unfit, least), float(least))


def _cost(stock: "Stock", placed: Placed) -> np.ndarray:
    """Height, then how high the items are on average, in heights that the volume needs: see `Cost`.

    To leave something out is worse than any height.
    """
    volume = stock.sizes[:, 0].astype(float).prod(1) * stock.mask
    length, width, height = stock.bins.astype(float).max(0)
    needed = volume.sum() / (length * width)
    top = np.where(placed.bin < 0, 0, placed.corner[..., 2] + placed.size[..., 2])
    level = top @ volume / volume.sum()
    left_out = left_out_cost(stock, placed, 2 * height)
    return STEEP * (top.max(1) + OF_LEVEL * level + left_out) / needed


HEIGHT = Objective(
    minimised="least height",
    worth=_worth,
    bound=_bound,
    measure=_height,
    cost=_cost,
    prepared=_prepared,
    figure="height",
    open_bin=True,
)
