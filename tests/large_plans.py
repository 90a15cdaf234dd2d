"""Plans of any number of items, each with its job: for what grows with them."""

import itertools
from dataclasses import replace

import numpy as np

from jaxpack.model.job import BinType, ItemType, Job, PackedBin, Placement, Plan


def column(count, order=range):
    """A stack of `count` sheets."""
    job = Job((ItemType((10, 10, 1), count),), (BinType((10, 10, count)),))
    places = tuple(Placement(0, "XYZ", (0, 0, z)) for z in order(count))
    return job, Plan((PackedBin(0, places),))


def cubes(edge, bins=1):
    """Full bins of `edge` cubes each way."""
    job = Job((ItemType((10, 10, 10), edge**3 * bins),), (BinType((edge * 10,) * 3),))
    corners = itertools.product(range(0, edge * 10, 10), repeat=3)
    places = tuple(Placement(0, "XYZ", (x, y, z)) for z, y, x in corners)
    return job, Plan((PackedBin(0, places),) * bins)


def backwards(count):
    """A stack of sheets, the highest first."""
    return column(count, lambda count: reversed(range(count)))


def heap(count):
    """Everything in one place."""
    job, plan = column(count)
    places = tuple(replace(put, corner=(0, 0, 0)) for put in plan.bins[0].placements)
    return job, Plan((PackedBin(0, places),))


def fine(count):
    """Sides of up to 2**30 units, each item on the floor of a row of its own."""
    random = np.random.default_rng(0)
    sides = np.round(random.uniform(100, 200, (count, 3)), 3)
    items = tuple(ItemType(tuple(side)) for side in sides.tolist())
    ends = np.cumsum(sides[:, 0])
    places = tuple(
        Placement(item, "XYZ", (x, 0, 0)) for item, x in enumerate([0.0, *ends[:-1].tolist()])
    )
    return Job(items, (BinType((1e6, 1e6, 1e6)),)), Plan((PackedBin(0, places),))
