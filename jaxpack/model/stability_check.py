"""Does what is packed stand? A part of the independent check of plans.

Two rules. `off_centre`: whatever is put on top, of any weight, nothing tips. The firm part of an
item's top, from the bottom up, is the convex hull of where its base lies on the floor or on firm
parts; the item's centre, with a margin, has to be over it. Weights that press on firm parts are
carried down over firm parts, so that no item turns about an edge. `unbalanced`: with the weights
that there are some forces hold every item, which is a linear program. What keeps the first rule
keeps the second.

Most items lie with all their corners on items that do so themselves, down to the floor. They are as
good as the floor, and whole numbers tell which they are. The firm parts of the others are floats,
with a tolerance for noise only: exact fractions would have ever more digits from level to level.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jaxpack.model.box_check import Boxes, Ranked
from jaxpack.model.equilibrium import lacking_moments
from jaxpack.model.polygons import Point, clipped, hull, rectangle

MARGIN = 1 / 64  # of an item's side: so far inside its firm part its centre has to be
NOISE = 1e-9  # of an item's side: more than floats lose, less than a plan could mean


class Tipping(NamedTuple):
    """A box that does not stand."""

    row: int
    axis: int  # along which it tips: 0 or 1
    amount: float  # a share, see there


class _Contacts(NamedTuple):
    """Where boxes that are not ground lie on others, by row: rectangles."""

    row: np.ndarray  # int [p]
    under: np.ndarray  # int [p], an earlier row; -1 is ground
    low: np.ndarray  # float [p, 2]
    high: np.ndarray  # float [p, 2]


def off_centre(boxes: Boxes, fixed: np.ndarray) -> Iterator[Tipping]:
    """Boxes whose centre is not inside the firm part of what they lie on, by row.

    The amount is how far it would have to move, as a share of the box's side; infinite where
    nothing firm is under the box. Only causes are named: what lies on such a box is judged as if
    all that this one touches were firm, and a box that floats counts as the floor.

    Args:
        boxes: see there. In 2D y is one layer, the same for all.
        fixed: bool [n], those that are as firm as the floor wherever they are.
    """
    return _off_centre(boxes, _contacts(boxes, fixed))


def unbalanced(boxes: Boxes, weights: np.ndarray, fixed: np.ndarray) -> Iterator[Tipping]:
    """Of every stack that no forces hold the box that lacks the largest moment.

    A stack is what hangs together above the ground. The amount is that moment as a share of the
    stack's weight times the box's side.

    Args:
        boxes: see there.
        weights: float [n], at least 0; of a box in its centre.
        fixed: see `off_centre`.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    contacts = _contacts(boxes, fixed)
    suspects = [tipping.row for tipping in _off_centre(boxes, contacts)]
    inner, count = contacts.under >= 0, len(boxes.bin)
    ends = contacts.row[inner], contacts.under[inner]
    joined = coo_array((np.ones(len(ends[0])), ends), (count, count))
    stack = connected_components(joined)[1] if suspects else np.empty(0)
    for number in np.unique(stack[suspects]).tolist():
        row, under, low, high = (leaf[stack[contacts.row] == number] for leaf in contacts)
        rows, upper = np.unique(row, return_inverse=True)
        lower = np.where(under < 0, -1, np.searchsorted(rows, under))
        middle, weight = np.array(_middle(boxes, rows)), weights[rows].astype(float)
        lacking = lacking_moments(upper, lower, np.array([low, high]), middle, weight)
        if lacking.any():
            axis, at = divmod(int(lacking.argmax()), len(rows))
            yield Tipping(int(rows[at]), axis, float(lacking[axis, at]))


def _contacts(boxes: Boxes, fixed: np.ndarray) -> _Contacts:
    """Those of the boxes that are not ground: a corner or a contact of theirs is not on ground."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order

    count = len(boxes.bin)
    lifted = np.flatnonzero((boxes.low[:, 2] > 0).astype(bool) & ~fixed)
    touching = Ranked(boxes).touching(lifted) if len(lifted) else ()
    of, under = np.hstack([np.empty((2, 0), int), *map(np.array, touching)])
    row = lifted[of]
    low = np.maximum(boxes.low[row, :2], boxes.low[under, :2])
    high = np.minimum(boxes.high[row, :2], boxes.high[under, :2])
    at_end = [low == boxes.low[row, :2], high == boxes.high[row, :2]]
    corners = np.array(at_end, int).sum(0).prod(1)  # of the upper box, that a contact has
    rows = np.unique(row)
    hanging = rows[np.bincount(row, corners, count)[rows] < 4]

    # What hangs over is no ground, nor is what rests on it: all that a node before it leads to.
    ground = np.ones(count, bool)
    if len(hanging):
        ends = np.append(under, np.full(len(hanging), count)), np.append(row, hanging)
        leads = coo_array((np.ones(len(ends[0])), ends), (count + 1, count + 1)).tocsr()
        ground[breadth_first_order(leads, count, return_predecessors=False)[1:]] = False
    kept = np.flatnonzero(~ground[row])
    kept = kept[np.argsort(row[kept], kind="stable")]
    under = np.where(ground[under], -1, under)
    return _Contacts(row[kept], under[kept], low[kept].astype(float), high[kept].astype(float))


def _off_centre(boxes: Boxes, contacts: _Contacts) -> Iterator[Tipping]:
    firm: dict[int, list[Point]] = {}
    under, lows, highs = (leaf.tolist() for leaf in contacts[1:])
    rows, starts = np.unique(contacts.row, return_index=True)
    centres, sides = (values.tolist() for values in _middle(boxes, rows))
    stops = np.append(starts, len(under))[1:].tolist()
    for row, start, stop, centre, side in zip(
        rows.tolist(), starts.tolist(), stops, centres, sides, strict=True
    ):
        noise = [NOISE * length for length in side]
        every: list[Point] = []
        points: list[Point] = []
        for low, high, other in zip(
            *(leaf[start:stop] for leaf in (lows, highs, under)), strict=True
        ):
            corners = rectangle(low, high)
            every += corners
            points += corners if other < 0 else clipped(firm[other], low, high, noise)
        firm[row] = hull(points)
        amount, axis = _overhang(firm[row], centre, side)
        if amount > NOISE:
            yield Tipping(row, axis, amount)
            firm[row] = hull(every)


def _middle(boxes: Boxes, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(centres, sides) of boxes along x and y: float [k, 2]."""
    low, high = boxes.low[rows, :2].astype(float), boxes.high[rows, :2].astype(float)
    return (low + high) / 2, high - low


def _overhang(polygon: list[Point], centre: list[float], side: list[float]) -> tuple[float, int]:
    """How far out of a polygon a centre with its margin is, as a share of the side along an axis.

    It is measured at the edge where that is most, along the axis where it is least; 0 if inside.
    """
    if not polygon:
        return np.inf, 0
    points = [((x - centre[0]) / side[0], (y - centre[1]) / side[1]) for x, y in polygon]
    worst = 0.0, 0
    for axis in (0, 1):  # the edges of a single point say nothing
        ends = [point[axis] for point in points]
        worst = max(worst, (MARGIN + max(min(ends), -max(ends)), axis))
    for (ax, ay), (bx, by) in zip(points, points[1:] + points[:1], strict=True):
        across = abs(by - ay), abs(bx - ax)
        missing = MARGIN * sum(across) - (ax * by - ay * bx)
        if missing > 0:
            worst = max(worst, (missing / max(across), int(across[1] > across[0])))
    return worst
