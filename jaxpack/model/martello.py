"""The bounds L1 and L2 for items without rotation in bins of one size.

2D: Martello and Vigo, Exact solution of the two-dimensional finite bin packing problem,
Management Science 44 (1998). 3D: Martello, Pisinger and Vigo, The three-dimensional bin packing
problem, Operations Research 48 (2000). An item that may be turned counts with the least extent
that it can have along each axis, and several sizes of bins as the box around all: both only weaken
the bounds. So does it to try some limits only where there are very many.
"""

import math

import numpy as np

from jaxpack.model.goods import Goods

MOST_LIMITS = 256  # of those that L2 and the one-dimensional bound try, along an axis
EXACT = 2.0**53  # floats below are whole numbers without gaps
MARGIN = 2.0**-30  # relative, far more than sums of floats are off


def at_least(need: float, capacity: float) -> int:
    """How many capacities a need takes, both whole numbers in floats; never one too many."""
    if need < EXACT / 2:
        return -(-int(need) // int(capacity))
    return math.ceil(need / capacity * (1 - MARGIN))


def sampled(values: np.ndarray, most: int) -> np.ndarray:
    """The different values, in order, or so many of them, the first and the last included."""
    values = np.unique(values)
    if len(values) <= most:
        return values
    return values[np.linspace(0, len(values) - 1, most).astype(int)]


def l1_and_l2(goods: Goods, halves: bool) -> tuple[int, int]:
    """Both bounds, the best over the axes along which rows may run.

    Args:
        goods: items and bins.
        halves: L2 also tries half a side of the bin as a limit (see `_row_bounds`), which is as
            sound and at times better. The published values try sides of items only.
    """
    if not len(goods.copies):
        return 0, 0
    # Doubled, so that half a side is whole too.
    size, room = 2 * goods.sizes.min(0), 2 * goods.rooms.max(0)
    volume = (2.0 * goods.sizes[0]).prod(1) * goods.copies
    rows = [
        _row_bounds(size, goods.copies, volume, room.tolist(), axis, halves) for axis in goods.axes
    ]
    return max(one for one, _ in rows), max(two for _, two in rows)


def _row_bounds(
    size: np.ndarray,
    copies: np.ndarray,
    volume: np.ndarray,
    room: list[int],
    axis: int,
    halves: bool,
) -> tuple[int, int]:
    """L1 and L2 of one axis: items that cannot stand side by side form rows along it.

    L1 counts the large items only, above half of the bin both ways across the row. L2 adds the
    volume of the others. For limits p and q of at most half the bin, a large item that leaves
    less than p and q beside it takes its whole length of the row from the bin, as nothing of at
    least p and q fits beside it; what is smaller than p or q and not large is ignored.

    Args:
        size: even whole numbers [n, 3].
        copies: of the rows [n].
        volume: of all copies of the rows [n].
        room: even whole numbers, the sides of the bin.
        axis: along which the rows run.
        halves: half the bin is a limit in any case, and not only where there is no other.
    """
    across = [other for other in range(3) if other != axis]
    area, length = math.prod(float(room[other]) for other in across), room[axis]
    large = np.all([2 * size[:, other] > room[other] for other in across], axis=0)
    one = one_dimensional(size[large, axis], copies[large], length)
    # Which limits let an item count is a corner of the table of all (p, q): for a large item the
    # one from `whole_row` on, for another the one up to `counted`.
    whole_row, counted, shape = [], [], []
    for other in across:
        sides, half = size[:, other], room[other] // 2
        limits = sampled(sides[sides <= half], MOST_LIMITS)
        if halves or not len(limits):
            limits = np.unique(np.append(limits, half))
        whole_row.append(np.searchsorted(limits, room[other] - sides[large], "right"))
        counted.append(np.searchsorted(limits, sides[~large], "right"))
        shape.append(len(limits) + 1)
    gain, rest = np.zeros(shape), np.zeros(shape)
    in_rows = (copies[large] * size[large, axis]).astype(float) * area
    np.add.at(gain, tuple(whole_row), in_rows - volume[large])
    np.add.at(rest, tuple(counted), volume[~large])
    gain = gain.cumsum(0).cumsum(1)[:-1, :-1]
    rest = rest[::-1, ::-1].cumsum(0).cumsum(1)[::-1, ::-1][1:, 1:]
    needed = volume[large].sum() + (gain + rest).max()
    return one, max(one, at_least(float(needed), area * length))


def one_dimensional(lengths: np.ndarray, copies: np.ndarray, room: int) -> int:
    """Bins for lengths in one dimension: L1's formula.

    Two above half the room never share a bin. What these leave, counted in length or in pieces
    of at least p, is short of what the pieces from p to half the room need.

    Args:
        lengths: int64 [n], at most the room.
        copies: int64 [n].
        room: below 2**44, so that sums of many lengths fit int64.
    """
    large = 2 * lengths > room
    beside, of_large = room - lengths[large], copies[large]
    small, of_small = lengths[~large], copies[~large]
    more, tried = 0, min(MOST_LIMITS, 1 + 2**22 // max(len(lengths), 1))
    for p in sampled(small, tried).tolist():
        wide, pieces = beside >= p, small >= p
        length = (small * of_small)[pieces].sum() - (beside * of_large)[wide].sum()
        number = of_small[pieces].sum() - (beside // p * of_large).sum()
        more = max(more, -int(-length // room), -int(-number // (room // p)))
    return int(of_large.sum()) + more
