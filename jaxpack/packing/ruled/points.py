"""Corner points of a bin that is being loaded: few of all the places that there are.

After the extreme points of Crainic, Perboli & Tadei (2008): an item may begin on top of another one
and beside it, along x or y; and where it gets to from there when it is pushed along the other of
both, up to the next box or the wall.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from jaxpack.packing.ruled.load import Load

FEW = 48  # points that an item is offered
LOOKS = 64  # times that a point is offered before all others have their turn


class Points:
    """P points, and how far it is from each to the next box or the end of the room, straight on."""

    def __init__(self, load: "Load") -> None:
        """Those of all that is there; what comes later is added."""
        self.load, self.door = load, bool(load.loading.rules.door)
        self.at, self.free = np.zeros((3, 0), np.int64), np.zeros((3, 0), np.int64)
        self.looks = np.zeros(0, np.int64)
        self._note({(*load.near.tolist(), 0)})
        for box in range(1, load.count):
            self.add(box)

    def lowest(self, size: np.ndarray) -> np.ndarray:
        """int64 [3, C], the lowest points with so much room, or those farthest from the door;
        but what nobody has taken in a long time comes last.

        Args:
            size: int64 [3], units.
        """
        some = np.flatnonzero((self.free >= size[:, None]).all(0))
        x, y, z = self.at[:, some]
        tired = self.looks[some] // LOOKS
        some = some[np.lexsort((y, z, x, tired) if self.door else (x, y, z, tired))[:FEW]]
        self.looks[some] += 1
        points: np.ndarray = self.at[:, some]
        return points

    def add(self, box: int) -> None:
        """Takes note of a box that the load has: of its points, and of those that it covers."""
        load, gap = self.load, self.load.asked.gap * (box >= self.load.fixed)
        low, rest = load.low[:, box], int(load.rest[box])
        end = self._line(load.high[:2, box] + gap)
        along = [(low[axis] <= self.at[axis]) & (self.at[axis] < end[axis]) for axis in (0, 1)]
        level = (self.at[2] < rest) & ((self.at[2] >= low[2]) | (not self.door))
        room = low[:, None] - [[gap], [gap], [0]] - self.at
        ahead = (room >= 0) & [along[1] & level, along[0] & level, along[0] & along[1]]
        self.free[ahead] = np.minimum(room, self.free)[ahead]
        kept = ~(along[0] & along[1] & level)
        self.at, self.free, self.looks = self.at[:, kept], self.free[:, kept], self.looks[kept]
        (x, y), (right, back), z = self._line(low[:2]).tolist(), end.tolist(), int(low[2])
        points = {(x, y, rest), (right, y, z), (right, self._pushed(1, box, right), z)}
        if not load.loading.flat:
            points |= {(x, back, z), (self._pushed(0, box, back), back, z)}
        self._note(points)

    def _pushed(self, axis: int, box: int, line: int) -> int:
        """Where what begins beside a box gets to when it is pushed along an axis, on a line."""
        load, n = self.load, self.load.count
        if axis and load.loading.flat:
            return 0
        side, z = 1 - axis, load.low[2, box]
        there = (load.low[side, 1:n] <= line) & (line < load.high[side, 1:n])
        there &= (load.low[2, 1:n] <= z) & (z < load.rest[1:n])
        ends = load.high[axis, 1:n] + load.asked.gap
        there &= ends <= load.low[axis, box]
        end = int(ends[there].max(initial=load.near[axis]))
        return int(self._line(end))

    def _line(self, start: Any) -> Any:
        """The first line of the grid from there on."""
        return -(-start // self.load.step) * self.load.step

    def _note(self, points: set[tuple[int, int, int]]) -> None:
        """Takes these as well, each let down onto what is below it, where there is room."""
        load, n = self.load, self.load.count
        at = np.array(sorted(points)).T
        low, high, rest = load.low[:, None, :n], load.high[:, None, :n], load.rest[:n]
        inside = (low <= at[:, :, None]) & (at[:, :, None] < high)
        over = inside[0] & inside[1]
        at[2] = np.where(over & (rest <= at[2][:, None]), rest, 0).max(1)
        level = (at[2][:, None] < rest) & ((low[2] <= at[2][:, None]) | (not self.door))
        room = low - at[:, :, None]
        room[:2, :, load.fixed :] -= load.asked.gap
        ahead = (room >= 0) & [inside[1] & level, inside[0] & level, over]
        ends = np.array([[load.far[0]], [load.far[1]], [load.room[2]]]) - at
        free = np.minimum(ends, np.where(ahead, room, ends[:, :, None]).min(2))
        new = (free > 0).all(0) & ~(over & level).any(1)
        new &= ~(at[:, :, None] == self.at[:, None]).all(0).any(1)
        self.at = np.concatenate([self.at, at[:, new]], 1)
        self.free = np.concatenate([self.free, free[:, new]], 1)
        self.looks = np.concatenate([self.looks, np.zeros(int(new.sum()), np.int64)])
