"""As cheap bins as possible: what is wanted as soon as one of them has a cost."""

from functools import partial

from jaxpack.model.bounds import bin_bounds
from jaxpack.model.figures import bins_worth, total_cost
from jaxpack.model.objectives.base import Objective
from jaxpack.model.objectives.bins import bins_cost

PARTS = ("cost", "bins", "volume")
PRICE = Objective(
    minimised="least cost, then the fewest bins, then the least volume of bins",
    worth=partial(bins_worth, PARTS),
    bound=partial(bin_bounds, PARTS),
    measure=total_cost,
    cost=bins_cost,
    parts=PARTS,
    fills=True,
)
