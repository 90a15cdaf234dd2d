"""What an objective is: one value that says all that follows from what a packing is to be good for.

A new one is an `Objective` in a file of its own, and an entry of the table in `__init__`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np

from jaxpack.errors import UserError
from jaxpack.model.bounds import Bounds
from jaxpack.model.job import Job, Plan
from jaxpack.model.numbers import fault
from jaxpack.model.rules import Rules

if TYPE_CHECKING:
    from jaxpack.model.encoding import Stock


class Placed(NamedTuple):
    """P packings as a search has them, in NumPy; rows are those of the stock."""

    bin: np.ndarray  # int32 [P, N], index of `Stock.bins`, -1 for what is left out and for padding
    corner: np.ndarray  # int32 [P, N, 3], units
    size: np.ndarray  # int32 [P, N, 3], units, as the item lies


Cost = Callable[["Stock", Placed], np.ndarray]
"""(the job, packings) -> what each of them costs, about 1 for each bin: float64 [P]."""


def _on_a_grid_alone(*_: Any) -> NoReturn:
    raise UserError("objective: it is one of instances on a grid, not of orders")


def _with_heights(job: Job, rules: Rules) -> Job:
    for number, kind in enumerate(job.bins):
        if kind.open:
            what = "the height is open: give one, or choose the objective height"
            raise fault(kind.where or f"bin {number}", what)
    return job


@dataclass(frozen=True)
class Objective:
    """What is wanted of a packing.

    An objective of orders needs all the functions but `on_grid`, one of instances on a grid that
    alone.
    """

    minimised: str  # once all that must be packed is, in words
    worth: Callable[[Job, Plan], tuple[Fraction | int, ...]] = _on_a_grid_alone
    """Exactly, of two plans of a job the smaller is the better."""
    bound: Callable[[Job, float | None], Bounds] = _on_a_grid_alone
    """(job, seconds, see `bin_bounds`) -> below which no plan's worth is."""
    measure: Callable[[Job, Plan], float] = _on_a_grid_alone
    """The number that the gap is of, in the user's units; its bound is `Bounds.best`."""
    cost: Cost = _on_a_grid_alone
    """What a search minimises: a number that says of unequal packings more than the worth does."""
    parts: tuple[str, ...] = ("bins", "volume")
    """What of the used bins counts, the most important first: see `figures.parts_of`."""
    prepared: Callable[[Job, Rules], Job] = _with_heights
    """The job as it is packed by rules; UserError where it is not one for this objective."""
    figure: str = ""
    """What tables call the measure; none where it is among the figures of every plan."""
    total: Callable[[Job], float] | None = None
    """What the measure would be if nothing were left out."""
    maximised: bool = False  # the measure, which is otherwise minimised
    leaves_out: bool = False  # items that fit may be left out, and bins without COPIES are one
    fills: bool = False  # bins may be filled one after the other, by the value of what is in them
    open_bin: bool = False  # there is one bin, its height may be open, and plans say theirs
    obeys: tuple[str, ...] = ()  # columns of items that other objectives refuse: PROFIT
    on_grid: Callable[..., Any] | None = None
    """(instance, packing, alpha, beta) -> float32[], a cost; see `jaxpack.model.metrics`."""

    @property
    def of_orders(self) -> bool:
        """Whether orders can be packed for it."""
        return self.worth is not _on_a_grid_alone


def sum_by_bin(bin: np.ndarray, amount: np.ndarray, bins: int) -> np.ndarray:
    """What the items of each bin come to: float64 [P, bins].

    Args:
        bin: int [P, N], -1 for what is in none.
        amount: [N].
        bins: how many there may be.
    """
    lane, item = np.nonzero(bin >= 0)
    slot = lane * bins + bin[lane, item]
    return np.bincount(slot, amount[item], len(bin) * bins).reshape(-1, bins)


def left_out_cost(stock: "Stock", placed: Placed, penalty: float) -> np.ndarray:
    """Where something is left out the penalty, up to twice as much if all is: float64 [P]."""
    missing = ((placed.bin < 0) & stock.mask).sum(1) / stock.mask.sum()
    return np.where(missing > 0, penalty * (1 + missing), 0)
