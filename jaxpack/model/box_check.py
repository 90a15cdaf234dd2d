"""Are boxes packed by the rules? The core of the independent checks, of plans and of the grid.

It shares nothing with what packs: it knows no height map and compares the boxes of a bin as boxes,
in whole numbers, exactly. A box is lowered straight onto its place when its turn comes, so that no
box that was loaded earlier, and shares a part of its footprint, may reach higher than its bottom.
Or it comes in through a door, along x, and none that was loaded earlier may stand on its way.
"""

from collections.abc import Iterator, Sequence
from enum import StrEnum
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from jaxpack.model.pairs import best, pairs, tree_of


class Rule(StrEnum):
    """What can be broken, in the order in which it is reported of a bin."""

    UNKNOWN = "unknown"  # an entry names nothing that there is; no other rule is looked at then
    ORDER = "order"  # the loading order is not one
    COUNT = "count"  # copies of an item: too many, or not all packed or left out
    COPIES = "copies"  # more bins of a type than there are
    EMPTY_BIN = "empty bin"
    ORIENTATION = "orientation"  # one that the item may not have
    WEIGHT = "weight"  # over the limit of the bin
    OUTSIDE = "outside"  # of the bin
    OVERLAP = "overlap"  # with an item that was loaded earlier
    GAP = "gap"  # too near to an item that was loaded earlier
    BLOCKED = "blocked"  # from above or from the door, by an item that was loaded earlier
    FLOATING = "floating"  # on nothing at all
    SUPPORT = "support"  # on too little
    CENTRE = "centre"  # not over what carries it
    STATIC = "static"  # its stack is not in equilibrium
    ON_FLOOR = "on floor"  # it is not, but has to be
    STACKABLE = "stackable"  # it lies on an item that nothing may lie on
    STACK_ID = "stack id"  # it lies on an item of another one
    HEAVY_BELOW = "heavy below"  # it lies on a lighter item
    STACK = "stack"  # more items are over and under it than may be
    WEIGHT_ABOVE = "weight above"  # more rests on it than may
    STOP = "stop"  # an item that is unloaded later is in its way
    ITEMS = "items"  # more in a bin than may be
    APART = "apart"  # from an item in the same bin
    BALANCE = "balance"  # the centre of mass is too far from the middle of the floor
    GROUP = "group"  # in several bins, and fits one


RANK = {rule: rank for rank, rule in enumerate(Rule)}


class Boxes(NamedTuple):
    """Boxes as they lie in their bins. Rows are in loading order, within each bin."""

    bin: np.ndarray  # int [n]; only boxes of equal numbers meet
    low: np.ndarray  # int64 or Python's whole numbers [n, 3]; the floor is at z = 0
    high: np.ndarray  # likewise; above `low` along every axis
    room: np.ndarray  # likewise, the far corner of the box's bin


class Finding(NamedTuple):
    """A rule that a box breaks."""

    rule: Rule
    row: int
    other: int = -1  # the row that it meets; of FLOATING the highest under it, -1 is the floor
    axis: int = 2  # of OUTSIDE; the others are about z
    share: Fraction = Fraction(0)  # of its base that is supported


def misplaced(
    boxes: Boxes,
    support: Fraction,
    inclusive: bool,
    reach: Sequence[int] = (0, 0, 0),
    door: bool = False,
) -> Iterator[Finding]:
    """The rules from OUTSIDE to SUPPORT that are broken but GAP, by rule.

    Of a box that meets several earlier ones only the one that was loaded first is named. Whether
    it is supported is looked at only if nothing is in its way.

    Args:
        boxes: see there.
        support: share of a box's base that has to lie on boxes that were loaded earlier and end
            where it begins, or on the floor. With 0 any touch is enough.
        inclusive: exactly that share is enough; otherwise it has to be more, or all of it.
        reach: how far boxes may be outside along x, y and z. The floor ends where the bin does.
        door: whether boxes come in along x, from beyond the far end, and not from above.
    """
    if not len(boxes.bin):
        return
    outside = (boxes.low < -np.array(reach)) | (boxes.high > boxes.room + np.array(reach))
    for row, axis in np.argwhere(outside.astype(bool)).tolist():
        yield Finding(Rule.OUTSIDE, row, axis=axis)

    ranked = Ranked(boxes)
    every = np.arange(len(boxes.bin))
    if not door:
        every = every[ranked.first(every, [*ranked.plane, (ranked.bottom, ranked.top)]) >= 0]
    into = ranked.first(every, [*ranked.plane, *ranked.level])
    way = ranked.beyond if door else [*ranked.plane, (ranked.top - 1, ranked.bottom)]
    for rule, others in ((Rule.OVERLAP, into), (Rule.BLOCKED, ranked.first(every, way))):
        met = others >= 0
        for row, other in zip(every[met].tolist(), others[met].tolist(), strict=True):
            yield Finding(rule, row, other)

    bottom = boxes.low[:, 2]
    resting = (bottom > 0).astype(bool)
    if any(reach):
        resting |= _over_edges(boxes) & (bottom == 0).astype(bool)
    resting[every[into >= 0] if door else every] = False
    lifted = np.flatnonzero(resting)
    area, base = _supported(boxes, ranked, lifted)
    floating = area == 0
    for row, other in zip(
        lifted[floating].tolist(), ranked.highest_below(lifted[floating]).tolist(), strict=True
    ):
        yield Finding(Rule.FLOATING, row, other)
    for at in np.flatnonzero((area < base) & ~floating).tolist():
        share = Fraction(int(area[at]), int(base[at]))
        if share < support or (share == support and not inclusive):
            yield Finding(Rule.SUPPORT, int(lifted[at]), share=share)


def _over_edges(boxes: Boxes) -> np.ndarray:
    """Which boxes reach out over the floor, seen from above."""
    over = (boxes.low < 0) | (boxes.high > boxes.room)
    return np.asarray(over[:, :2].astype(bool).any(axis=1))


def _supported(boxes: Boxes, ranked: "Ranked", rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(area of their bases that lies on others or the floor, area of their bases) of these rows."""
    low, high, room = boxes.low[:, :2], boxes.high[:, :2], boxes.room[:, :2]
    reach = max((int(abs(ends).max()) for ends in (low, high)), default=0)
    if len(low) * (2 * reach) ** 2 >= 2**62:  # sums of areas beyond 64 bits
        low, high, room = (leaf.astype(object) for leaf in (low, high, room))
    sides = high[rows] - low[rows]
    on_floor = np.maximum(np.minimum(high[rows], room[rows]) - np.maximum(low[rows], 0), 0)
    area = on_floor[:, 0] * on_floor[:, 1] * (boxes.low[rows, 2] == 0)
    for of, under in ranked.touching(rows):
        shared = np.minimum(high[rows[of]], high[under]) - np.maximum(low[rows[of]], low[under])
        np.add.at(area, of, shared[:, 0] * shared[:, 1])
    return area, sides[:, 0] * sides[:, 1]


Limit = tuple[np.ndarray, np.ndarray]
"""(a, b): of a row i it is asked that a[i] < b[j] for a row j."""


class Ranked:
    """Where boxes begin and end as ranks, which compare as the lengths do, and their tree."""

    def __init__(self, boxes: Boxes) -> None:
        # Ranks among the lengths along all axes are ranks along each.
        low, high = _ranks(np.array([boxes.low, boxes.high]))
        (x_low, y_low, bottom), (x_high, y_high, top) = low.T, high.T
        centres = [x_low + x_high, y_low + y_high, bottom + top]
        self.order = _neighbours(boxes.bin, centres)
        # Bins beside each other along x: boxes of different bins share nothing.
        start = boxes.bin.astype(np.int64) * (int(x_high.max()) + 1)
        x_low, x_high = _ranks(np.array([start + x_low, start + x_high]))
        self.bottom, self.top = bottom, top
        self.turn = np.arange(len(bottom), dtype=np.int32)
        bin = _ranks(boxes.bin)
        across: list[Limit] = [(y_low, y_high), (-y_high, -y_low)]
        self.plane: list[Limit] = [(x_low, x_high), (-x_high, -x_low), *across]
        """That two share a part of their footprints."""
        self.level: list[Limit] = [(bottom, top), (-top, -bottom)]
        """That there is a height at which both are."""
        self.beyond: list[Limit] = [
            *((bin - 1, bin), (-bin - 1, -bin), (x_high - 1, x_low)),
            *(*across, *self.level),
        ]
        """That j stands where i comes through on its way along x, from the far end."""

    def first(self, rows: np.ndarray, limits: list[Limit], earlier: bool = True) -> np.ndarray:
        """The first loaded j, only of those that were loaded earlier, that keeps all limits.

        -1 where there is none.
        """
        least = self.turn if earlier else np.full_like(self.turn, len(self.turn))
        return self._best(rows, [(-least, -self.turn), *limits])

    def highest_below(self, rows: np.ndarray) -> np.ndarray:
        """Of what was loaded earlier and ends under these rows; -1 is the floor."""
        floor, earlier = np.full_like(self.bottom, -1), (-self.turn, -self.turn)
        under = -self.bottom - 1, -self.top
        return self._best(rows, [(floor, self.top), earlier, *self.plane, under])

    def touching(
        self, rows: np.ndarray, earlier: bool = True
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """(places in `rows`, what lies directly under them) in blocks."""
        limits = [*self.plane, (self.bottom - 1, self.top), (-self.bottom - 1, -self.top)]
        if earlier:
            limits.append((-self.turn, -self.turn))
        asked, given = zip(*limits, strict=True)
        return pairs(np.array(asked)[:, rows], tree_of(np.array(given), self.order))

    def _best(self, rows: np.ndarray, limits: list[Limit]) -> np.ndarray:
        if not len(rows):
            return rows
        asked, given = zip(*limits, strict=True)
        return best(np.array(asked)[:, rows], tree_of(np.array(given), self.order), 0)


def _ranks(values: np.ndarray) -> np.ndarray:
    """int32 of the values' shape: 0 for the least, equal for what is equal."""
    ranks: np.ndarray = np.unique(values, return_inverse=True)[1]
    return ranks.reshape(values.shape).astype(np.int32)


_SPREAD = np.array([sum((n >> bit & 1) << 3 * bit for bit in range(10)) for n in range(1024)])
"""A number of ten bits with two zeros after each of them."""


def _neighbours(bins: np.ndarray, centres: list[np.ndarray]) -> np.ndarray:
    """The rows, bin by bin, along a curve through space on which neighbours are near (Morton's)."""
    code = bins.astype(np.int64) << 30
    for axis, centre in enumerate(centres):
        code += _SPREAD[centre.astype(np.int64) * 1023 // max(int(centre.max()), 1)] << axis
    return np.argsort(code, kind="stable")
