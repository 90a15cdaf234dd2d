"""From the user's units to whole numbers and back: what the kernel computes with is exact."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from jaxpack.loading.exact import exact
from jaxpack.loading.job import Job

FINEST = 46_000
"""A bin has at most so many units a side: areas of footprints then fit int32."""
HEAVIEST = 1_000_000_000  # units of weight: sums of a bin's weights stay within int32


@dataclass(frozen=True)
class Units:
    """The lengths and weights of a job as whole numbers of units."""

    length: Fraction  # the user's length per unit
    weight: Fraction
    exact: bool  # whether every size is a whole number of units; else items are rounded up


def units_of(job: Job, resolution: float | None = None) -> Units:
    """The coarsest units in which every size is whole, or the finest that the kernel takes.

    Args:
        resolution: the unit of length to round to instead, the paper's grid.
    """
    sizes = [exact(side) for size in _all_sizes(job) for side in size]
    longest = max(exact(side) for bin in job.bins for side in bin.size)
    whole = _common(sizes)
    if resolution is not None:
        length = exact(resolution)
    elif longest / whole <= FINEST:
        length = whole
    else:
        length = longest / FINEST
    weights = [exact(item.weight) for item in job.items if item.weight]
    limits = [exact(bin.max_weight) for bin in job.bins if math.isfinite(bin.max_weight)]
    weight = _common(weights + limits) if weights and limits else Fraction(1)
    weight = max([weight, *(number / HEAVIEST for number in limits)])
    return Units(length, weight, all((side / length).denominator == 1 for side in sizes))


def in_units(values: Iterable[float], unit: Fraction, up: bool) -> np.ndarray:
    """Whole numbers of units, rounded up (items) or down (bins): int64 of the values' length."""
    ratios = [exact(value) / unit for value in values]
    return np.asarray([math.ceil(r) if up else math.floor(r) for r in ratios], np.int64)


def _all_sizes(job: Job) -> list[tuple[float, ...]]:
    sizes = [item.size for item in job.items] + [bin.size for bin in job.bins]
    return [(x, z) if job.dimension == 2 else (x, y, z) for x, y, z in sizes]


def _common(numbers: list[Fraction]) -> Fraction:
    """The largest fraction of which all numbers are whole multiples."""
    scale = math.lcm(*(number.denominator for number in numbers))
    return Fraction(math.gcd(*(int(number * scale) for number in numbers)), scale)
