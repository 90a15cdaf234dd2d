"""As few bins as possible, then the smallest ones: what is wanted where bins cost nothing."""

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxpack.model.bounds import bin_bounds
from jaxpack.model.figures import bins_worth
from jaxpack.model.job import Job, Plan
from jaxpack.model.objectives.base import Objective, Placed, left_out_cost, sum_by_bin

if TYPE_CHECKING:
    from jaxpack.model.encoding import Stock

WEIGHT_OF_FILL = 0.5  # below 1, so that a bin less is always better


def bins_cost(stock: "Stock", placed: Placed) -> np.ndarray:
    """Price of the used bins, then how unevenly they are filled: see `Cost`.

    To leave something out is worse than any number of bins.
    """
    volume = stock.sizes[:, 0].astype(float).prod(1) * stock.mask
    room = np.maximum(stock.bins.astype(float).prod(1), 1)  # 0 where there is no bin
    held = sum_by_bin(placed.bin, volume, len(room))
    # Of two packings in equally many bins the one with an emptier bin is nearer to one less.
    even = (held * held / room).sum(1) / np.maximum(held.sum(1), 1e-9)
    left_out = left_out_cost(stock, placed, stock.penalty)
    return (held > 0) @ stock.price.astype(float) + WEIGHT_OF_FILL * (1 - even) + left_out


def _bins(job: Job, plan: Plan) -> float:
    return float(len(plan.bins))


def _on_grid(*packing: Any) -> Any:
    from jaxpack.model.metrics import bins_first_cost  # JAX, which orders can do without

    return bins_first_cost(*packing)


PARTS = ("bins", "volume")
BINS = Objective(
    minimised="fewest bins, then the least volume of bins",
    worth=partial(bins_worth, PARTS),
    bound=partial(bin_bounds, PARTS),
    measure=_bins,
    cost=bins_cost,
    parts=PARTS,
    fills=True,
    on_grid=_on_grid,
)
