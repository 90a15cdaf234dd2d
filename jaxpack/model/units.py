"""From the user's units to whole numbers and back: what the kernel computes with is exact."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from jaxpack.model.exact import exact
from jaxpack.model.job import FINEST, Job
from jaxpack.model.rules import Rules


@dataclass(frozen=True)
class Units:
    """The lengths and weights of a job as whole numbers of units; nothing is rounded."""

    length: Fraction  # the user's length per unit
    weight: Fraction
    step: int = 1  # positions along x and y are multiples of so many units


def units_of(job: Job, resolution: float | None = None, rules: Rules = Rules()) -> Units:
    """The coarsest units in which every size and every weight is whole, and gap and overhang too.

    Under `Rules.balance` they are halved until a load that is shifted can come to the middle.

    Args:
        job: what is packed.
        resolution: the length of which positions are to be multiples; any position if not given.
        rules: they and the resolution must be `fine_enough`.
    """
    weights = [exact(item.weight) for item in job.items if item.weight]
    limits = [exact(bin.max_weight) for bin in job.bins if 0 < bin.max_weight < math.inf]
    weight = common(weights + limits) if weights or limits else Fraction(1)
    grid = () if resolution is None else (exact(resolution),)
    length = common([job.unit, *rules.lengths, *grid])
    if rules.balance is not None and not grid:
        longest = max(exact(side) for kind in job.bins for side in kind.size)
        least = min(exact(kind.size[axis]) for kind in job.bins for axis in job.axes[:-1])
        enough = max(exact(rules.balance) * least / 2, 2 * longest / FINEST)
        length /= 2 if length / 2 >= longest / FINEST else 1
        while length > enough:
            length /= 2
    return Units(length, weight, int(grid[0] / length) if grid else 1)


def fine_enough(job: Job, *lengths: float) -> bool:
    """Whether multiples of these lengths too are whole numbers of units that the kernel takes."""
    longest = max(exact(side) for bin in job.bins for side in bin.size)
    return longest / common([job.unit, *map(exact, lengths)]) <= FINEST


def in_units(values: Iterable[float], unit: Fraction) -> np.ndarray:
    """Whole numbers of units: int64 of the values' length.

    Args:
        values: multiples of the unit.
        unit: see `Units`.
    """
    known: dict[float, int] = {}
    values = list(values)
    for value in set(values):
        top, bottom = exact(value).as_integer_ratio()
        known[value], rest = divmod(top * unit.denominator, bottom * unit.numerator)
        assert not rest, f"{value} is no multiple of {unit}"
    return np.asarray([known[value] for value in values], np.int64)


def common(numbers: list[Fraction]) -> Fraction:
    """The largest fraction of which all numbers are whole multiples."""
    scale = math.lcm(*(number.denominator for number in numbers))
    whole = (number.numerator * (scale // number.denominator) for number in numbers)
    return Fraction(math.gcd(*whole), scale)
