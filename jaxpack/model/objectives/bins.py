"""As few bins as possible, then the smallest ones: what is wanted where bins cost nothing."""

from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING, Any

from jaxpack.model.bounds import bin_bounds
from jaxpack.model.figures import bins_worth
from jaxpack.model.job import Job, Plan
from jaxpack.model.objectives.base import Objective, Placed, sum_by_bin, sum_where

if TYPE_CHECKING:
    from jaxpack.model.encoding import Stock

WEIGHT_OF_FILL = 0.5  # below 1, so that a bin less is always better


def bins_cost(xp: ModuleType, stock: "Stock", placed: Placed) -> Any:
    """Price of the used bins, then how unevenly they are filled: see `Cost`.

    To leave something out is worse than any number of bins.
    """
    real = xp.zeros(0).dtype
    volume = stock.sizes[:, 0].astype(real).prod(1) * stock.mask
    room = xp.maximum(stock.bins.astype(real).prod(1), 1)  # 0 where there is no bin
    held = sum_by_bin(xp, placed.bin, volume, len(room))
    # Of two packings in equally many bins the one with an emptier bin is nearer to one less.
    even = (held * held / room).sum() / xp.maximum(held.sum(), 1e-9)
    missing = ((placed.bin < 0) & stock.mask).sum() / stock.mask.sum()
    left_out = xp.where(missing > 0, stock.penalty * (1 + missing), 0)
    return sum_where(xp, held > 0, stock.price) + WEIGHT_OF_FILL * (1 - even) + left_out


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
    on_grid=_on_grid,
)
