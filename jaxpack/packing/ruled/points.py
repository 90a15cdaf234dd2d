"""Corner points of a bin that is being loaded: few of all the places that there are.

After the extreme points of Crainic, Perboli & Tadei (2008): an item may begin on top of another one
and beside it, along x or y; and where it gets to from there when it is pushed along the other of
both, up to the next box or the wall.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from jaxpack.model.asked import ANY

if TYPE_CHECKING:
    from jaxpack.packing.ruled.load import Load

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

    def lowest(self, size: np.ndarray, most: int) -> np.ndarray:
        """int64 [3, C], the lowest points with so much room, or those farthest from the door;
        but what nobody has taken in a long time comes last.

        Args:
            size: int64 [3], units.
            most: of them.
        """
        some = np.flatnonzero((self.free >= size[:, None]).all(0))
        x, y, z = self.at[:, some]
        tired = self.looks[some] // LOOKS
        some = some[np.lexsort((y, z, x, tired) if self.door else (x, y, z, tired))[:most]]
        self.looks[some] += 1
        points: np.ndarray = self.at[:, some]
        return points

    def add(self, box: int) -> None:
        """Takes note of a box that the load has: of its points, and of those that it covers."""
        room, covered = self._ahead(self.at, slice(box, box + 1))
        kept = ~covered
        self.free = np.minimum(self.free, room)[:, kept]
        self.at, self.looks = self.at[:, kept], self.looks[kept]
        load, flat = self.load, self.load.loading.flat
        (x, y), z, rest = self._line(load.low[:2, box]).tolist(), int(load.low[2, box]), load.rest
        right, back = self._ends(slice(box, box + 1))[:, 0].tolist()
        points = {(x, y, int(rest[box])), (right, y, z), (right, self._pushed(1, box, right), z)}
        if not flat:
            points |= {(x, back, z), (self._pushed(0, box, back), back, z)}
        self._note(points)

    def _pushed(self, axis: int, box: int, line: int) -> int:
        """Where what begins beside a box gets to when it is pushed along an axis, on a line."""
        load, boxes = self.load, slice(1, self.load.count)
        if axis and load.loading.flat:
            return 0
        side, z, ends = 1 - axis, load.low[2, box], self._ends(boxes)
        there = (load.low[side, boxes] <= line) & (line < ends[side])
        there &= (load.low[2, boxes] <= z) & (z < load.rest[boxes])
        there &= ends[axis] <= load.low[axis, box]
        return int(ends[axis, there].max(initial=self._line(load.near[axis])))

    def _line(self, start: Any) -> Any:
        """The first line of the grid from there on."""
        return -(-start // self.load.step) * self.load.step

    def _ends(self, boxes: slice) -> np.ndarray:
        """int64 [2, B], where the next item may begin along x and along y."""
        load = self.load
        gaps = load.asked.gap * (np.arange(len(load.rest))[boxes] >= load.fixed)
        ends: np.ndarray = self._line(load.high[:2, boxes] + gaps)
        return ends

    def _ahead(self, at: np.ndarray, boxes: slice) -> tuple[np.ndarray, np.ndarray]:
        """(int64 [3, P], how far it is along each axis to the first of these boxes, very far if
        none is in the way; bool [P], whether one is where the point is, or above it if what comes
        is lowered).
        """
        load = self.load
        low, rest = load.low[:, None, boxes], load.rest[boxes]
        x, y = (low[:2] <= at[:2, :, None]) & (at[:2, :, None] < self._ends(boxes)[:, None])
        level = (at[2][:, None] < rest) & ((low[2] <= at[2][:, None]) | (not self.door))
        room = low - at[:, :, None]
        room[:2] -= load.asked.gap * (np.arange(len(load.rest))[boxes] >= load.fixed)
        ahead = (room >= 0) & [y & level, x & level, x & y]
        return np.where(ahead, room, ANY).min(2, initial=ANY), (x & y & level).any(1)

    def _note(self, points: set[tuple[int, int, int]]) -> None:
        """Takes these as well, each let down onto what is below it, where there is room."""
        load, n = self.load, self.load.count
        at = np.array(sorted(points)).T
        ground = at[:2, :, None]
        over = ((load.low[:2, None, :n] <= ground) & (ground < load.high[:2, None, :n])).all(0)
        at[2] = np.where(over & (load.rest[:n] <= at[2][:, None]), load.rest[:n], 0).max(1)
        room, covered = self._ahead(at, slice(0, n))
        free = np.minimum(room, np.array([*load.far, load.room[2]])[:, None] - at)
        new = (free > 0).all(0) & ~covered
        new &= ~(at[:, :, None] == self.at[:, None]).all(0).any(1)
        self.at = np.concatenate([self.at, at[:, new]], 1)
        self.free = np.concatenate([self.free, free[:, new]], 1)
        self.looks = np.concatenate([self.looks, np.zeros(int(new.sum()), np.int64)])
