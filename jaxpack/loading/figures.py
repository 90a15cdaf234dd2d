"""What a plan amounts to, and what no plan can do without: bins, fill, weight, cost, bounds.

Bounds count the items that fit some bin: the others are left out of every plan.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain

import numpy as np

from jaxpack.loading.exact import common_scale, exact
from jaxpack.loading.job import ItemType, Job, PackedBin, Plan, Sides


@dataclass(frozen=True)
class PlanFigures:
    """The figures of one plan, in the units of its job."""

    bins: int
    utilisation: float  # volume of the items / volume of the bins; 0 without bins
    weight: float  # of all packed items
    cost: float  # of all used bins
    left_out: int  # items that were not packed


def plan_figures(job: Job, plan: Plan) -> PlanFigures:
    """The figures of a valid plan: `check_plan` is not repeated here."""
    weights = [job.items[put.item].weight for packed in plan.bins for put in packed.placements]
    room = sum(_volume(job.bins[packed.bin].size) for packed in plan.bins)
    packed_volume = sum(_packed_volume(job, packed) for packed in plan.bins)
    return PlanFigures(
        bins=len(plan.bins),
        utilisation=float(packed_volume / room) if room else 0.0,
        weight=math.fsum(weights),
        cost=total_cost(job, plan),
        left_out=len(plan.left_out),
    )


def fill(job: Job, packed: PackedBin) -> float:
    """Volume of the items in a bin / volume of the bin."""
    return float(_packed_volume(job, packed) / _volume(job.bins[packed.bin].size))


def total_cost(job: Job, plan: Plan) -> float:
    """What the used bins cost together."""
    return float(sum(exact(job.bins[packed.bin].price) for packed in plan.bins))


def lower_bound(job: Job) -> int:
    """Bins that every plan needs that leaves out no item that fits: the best of the bounds."""
    return max(volume_bound(job), weight_bound(job), martello_bounds(job, halves=True)[1])


def volume_bound(job: Job) -> int:
    """Bins until their volumes, the largest first, hold the volume of the items."""
    total = sum((_volume(item.size) * item.copies for item in _fitting(job)), Fraction(0))
    return _fewest(total, [(_volume(kind.size), kind.copies) for kind in job.bins])


def weight_bound(job: Job) -> int:
    """The same for the weight, and that two items above half the limit share no bin.

    0 if a bin has no limit.
    """
    limit = max(kind.max_weight for kind in job.bins)
    items = [item for item in _fitting(job) if item.weight > 0]
    if limit == math.inf or not items:
        return 0
    total = sum((exact(item.weight) * item.copies for item in items), Fraction(0))
    fewest = _fewest(total, [(exact(kind.max_weight), kind.copies) for kind in job.bins])
    scale = 2 * common_scale([limit, *(item.weight for item in items)])
    weights = [int(exact(item.weight) * scale) for item in items for _ in range(item.copies)]
    return max(fewest, _one_dimensional(np.array(weights, object), int(exact(limit) * scale)))


def cost_bound(job: Job) -> float:
    """A cost below that of every plan that leaves out no item that fits.

    The volume of the items at the cheapest cost per volume, as many bins of each kind as there
    are, the last one in part; or `lower_bound` of the cheapest bins.
    """
    cheapest = sorted(job.bins, key=lambda kind: exact(kind.price) / _volume(kind.size))
    rest = sum((_volume(item.size) * item.copies for item in _fitting(job)), Fraction(0))
    by_volume = Fraction(0)
    for kind in cheapest:
        bins = rest / _volume(kind.size)
        bins = bins if kind.copies is None else min(bins, Fraction(kind.copies))
        by_volume += bins * exact(kind.price)
        rest -= bins * _volume(kind.size)
    by_number, count = Fraction(0), lower_bound(job)
    for kind in sorted(job.bins, key=lambda kind: kind.price):
        bins_of_it = count if kind.copies is None else min(count, kind.copies)
        by_number += bins_of_it * exact(kind.price)
        count -= bins_of_it
    return float(max(by_volume, by_number))


def martello_bounds(job: Job, halves: bool = False) -> tuple[int, int]:
    """The bounds L1 and L2 for items without rotation in bins of one size.

    2D: Martello and Vigo, Exact solution of the two-dimensional finite bin packing problem,
    Management Science 44 (1998). 3D: Martello, Pisinger and Vigo, The three-dimensional bin
    packing problem, Operations Research 48 (2000). An item that may be turned counts with the
    least extent that it can have along each axis, and several sizes of bins as the box around
    all: both only weaken the bounds.

    Args:
        job: items and bins.
        halves: L2 also tries half a side of the bin as a limit (see `_row_bounds`), which is as
            sound and at times better. The published values try sides of items only.
    """
    items = _fitting(job)
    if not items:
        return 0, 0
    sizes = [*(item.size for item in items), *(kind.size for kind in job.bins)]
    scale = 2 * common_scale(chain.from_iterable(sizes))

    def whole(sides: Iterable[float]) -> list[int]:
        return [int(exact(side) * scale) for side in sides]  # even: half a side is whole too

    room = whole(max(kind.size[axis] for kind in job.bins) for axis in range(3))
    copies = [item.copies for item in items]
    safe = sum(copies) * math.prod(room) < 2**62
    dtype: type = np.int64 if safe else object
    size: np.ndarray = np.array([whole(_least_extents(item, job)) for item in items], dtype)
    volume: np.ndarray = np.array([math.prod(whole(item.size)) for item in items], dtype)
    size, volume = np.repeat(size, copies, axis=0), np.repeat(volume, copies)
    axes = (0, 1, 2) if job.dimension == 3 else (0, 2)  # along the dummy axis a row is one item
    rows = [_row_bounds(size, volume, room, axis, halves) for axis in axes]
    return max(one for one, _ in rows), max(two for _, two in rows)


def _row_bounds(
    size: np.ndarray, volume: np.ndarray, room: list[int], axis: int, halves: bool
) -> tuple[int, int]:
    """L1 and L2 of one axis: items that cannot stand side by side form rows along it.

    L1 counts the large items only, above half of the bin both ways across the row. L2 adds the
    volume of the others. For limits p and q of at most half the bin, a large item that leaves
    less than p and q beside it takes its whole length of the row from the bin, as nothing of at
    least p and q fits beside it; what is smaller than p or q and not large is ignored.

    Args:
        size: even whole numbers [n, 3].
        volume: of the items [n].
        room: even whole numbers, the sides of the bin.
        axis: along which the rows run.
        halves: half the bin is a limit in any case, and not only where there is no other.
    """
    across = [other for other in range(3) if other != axis]
    area, length = math.prod(room[other] for other in across), room[axis]
    large = np.all([2 * size[:, other] > room[other] for other in across], axis=0)
    one = _one_dimensional(size[large, axis], length)
    # Which limits let an item count is a corner of the table of all (p, q): for a large item the
    # one from `whole_row` on, for another the one up to `counted`.
    whole_row, counted, shape = [], [], []
    for other in across:
        sides, half = size[:, other], room[other] // 2
        limits = np.unique(sides[sides <= half])
        if halves or not len(limits):
            limits = np.unique(np.append(limits, half))
        whole_row.append(np.searchsorted(limits, room[other] - sides[large], "right"))
        counted.append(np.searchsorted(limits, sides[~large], "right"))
        shape.append(len(limits) + 1)
    gain, rest = np.zeros(shape, size.dtype), np.zeros(shape, size.dtype)
    np.add.at(gain, tuple(whole_row), size[large, axis] * area - volume[large])
    np.add.at(rest, tuple(counted), volume[~large])
    gain = gain.cumsum(0).cumsum(1)[:-1, :-1]
    rest = rest[::-1, ::-1].cumsum(0).cumsum(1)[::-1, ::-1][1:, 1:]
    needed = int(volume[large].sum()) + int((gain + rest).max())
    return one, max(one, -(-needed // (area * length)))


def _one_dimensional(lengths: np.ndarray, room: int) -> int:
    """Bins for lengths (whole numbers [n]) in one dimension: L1's formula.

    Two above half the room never share a bin. What these leave, counted in length or in pieces
    of at least p, is short of what the pieces from p to half the room need.
    """
    large, small = lengths[2 * lengths > room], lengths[2 * lengths <= room]
    more = 0
    for p in set(small.tolist()):
        beside, pieces = large[large <= room - p], small[small >= p]
        length = pieces.sum() - (room - beside).sum()
        number = len(pieces) - ((room - beside) // p).sum()
        more = max(more, -int(-length // room), -int(-number // (room // p)))
    return len(large) + more


def _fewest(amount: Fraction, bins: list[tuple[Fraction, int | None]]) -> int:
    """How many of these (capacity, copies) hold an amount; all of them if it is too much."""
    count = 0
    for capacity, copies in sorted(bins, key=lambda kind: kind[0], reverse=True):
        if amount <= 0 or capacity <= 0:
            break
        full = math.ceil(amount / capacity)
        taken = full if copies is None else min(full, copies)
        count += taken
        amount -= taken * capacity
    return count


def _fitting(job: Job) -> list[ItemType]:
    """The items that some bin can hold."""
    return [item for item in job.items if item.copies > 0 and any(_ways_to_fit(item, job))]


def _ways_to_fit(item: ItemType, job: Job) -> Iterator[Sides]:
    """Extents of an item along x, y and z, in the orientations that fit some bin."""
    for orientation in item.orientations:
        turned = item.turned(orientation)
        for kind in job.bins:
            inside = all(side <= room for side, room in zip(turned, kind.size, strict=True))
            if inside and item.weight <= kind.max_weight:
                yield turned
                break


def _least_extents(item: ItemType, job: Job) -> Iterator[float]:
    return (min(sides) for sides in zip(*_ways_to_fit(item, job), strict=True))


def _volume(size: Sides) -> Fraction:
    return math.prod((exact(side) for side in size), start=Fraction(1))


def _packed_volume(job: Job, packed: PackedBin) -> Fraction:
    volumes = (_volume(job.items[put.item].size) for put in packed.placements)
    return sum(volumes, Fraction(0))
