"""What bins and items count to a packer: numbers about 1."""

import math

import numpy as np

from jaxpack.model.bands import least_rate
from jaxpack.model.exact import exact
from jaxpack.model.figures import profit_of
from jaxpack.model.job import Job
from jaxpack.model.knapsack import most_profit
from jaxpack.model.objectives import objective_of


def bin_prices(job: Job, items: np.ndarray) -> np.ndarray:
    """Of every bin type, float64: what is minimised first, 1 on average, and a little of the rest.

    What comes later, see `Objective.parts`, counts less than a bin in all.

    Args:
        job: as it is packed.
        items: int [N], index in its items of every copy.
    """
    volume = np.asarray([math.prod(kind.size) for kind in job.bins])
    load = sum(math.prod(job.items[n].size) for n in items.tolist())
    few = max(1.0, load / volume.max())
    little = 0.2 / few
    cost = _costs(job, items, volume / load)
    each = {"cost": cost, "bins": np.ones(len(cost)), "volume": volume}
    first, *later = (each[part] for part in objective_of(job).parts)
    prices: np.ndarray = first / min(first[first > 0], default=1.0)
    for part in later:
        prices = prices + little * (part / max(part.max(), 1e-300))
    return prices


def _costs(job: Job, items: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """What a bin of each type costs that is full, without what its load costs in every bin.

    Args:
        job, items: see `bin_prices`.
        shares: float64 [types], how much of the volume of all items fills it.
    """
    if not job.by_load:
        return np.array([float(kind.price_of()) for kind in job.bins])
    weight, rate = sum(job.items[n].weight for n in items.tolist()), least_rate(job)
    costs = []
    for kind, share in zip(job.bins, shares.tolist(), strict=True):
        held = exact(min(weight, weight * share, kind.max_weight))
        costs.append(float(kind.price_of(held) - rate * held))
    return np.array(costs)


def item_profits(job: Job) -> np.ndarray:
    """Of every item type, float32; see `Stock.profit`."""
    if "PROFIT" not in objective_of(job).obeys:
        return np.zeros(len(job.items), np.float32)
    most, _, _ = most_profit(job)
    return np.array([float(profit_of(item) / (most or 1)) for item in job.items], np.float32)
