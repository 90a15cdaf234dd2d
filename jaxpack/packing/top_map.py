"""The third surface: a bin without a grid in NumPy, for what cannot wait for a compiler.

A bin is a map of heights between lines: those along which items end, across the bin from wall to
wall. The placements are those of `top_faces`, to the unit; the time of one grows with the number
of cells between the lines, not with cells times items.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jaxpack.packing.rules import RULES, Positions, Rule

Place = tuple[int, int, int]
Sides = tuple[int, int, int]

NOWHERE = np.iinfo(np.int64).max
"""The resting height where an item is not allowed."""
AT_ONCE = 2**19  # numbers in a table of many items at once


@dataclass
class Lines:
    """Where cells begin along one axis: ascending, from 0 to the far wall."""

    at: np.ndarray  # int64 [C + 1], units; C cells lie between
    corner: np.ndarray  # bool [C + 1], whether items may stand there with their near edge
    step: int  # units, of which corners are multiples

    def with_ends(self, starts: np.ndarray, length: int) -> tuple["Lines", np.ndarray]:
        """With the near and far edges of items, and the old cell that each new one is part of."""
        wall = self.at[-1]
        ends = starts + length
        stands = -(-ends // self.step) * self.step
        at = np.unique(np.concatenate([self.at, starts, ends, stands[stands <= wall]]))
        corner = np.isin(at, np.concatenate([self.at[self.corner], stands]))
        return Lines(at, corner, self.step), np.searchsorted(self.at, at[:-1], "right") - 1


class TopMap:
    """What lies in one bin, seen from above."""

    def __init__(self, room: Sides, flat: bool = False, step: int = 1) -> None:
        """An empty bin.

        Args:
            room: length, width, height of the bin, units.
            flat: 2D, where nothing ever lies behind anything.
            step: units; corners along x and y are multiples of it.
        """
        self.room = room
        self.flat = flat
        corner = np.array([True, False])
        self.x, self.y = (Lines(np.array([0, side]), corner, step) for side in room[:2])
        self.top = np.zeros((1, 1), np.int64)  # of every cell
        self.boxes = list[tuple[Place, Sides]]()  # corner and sides of what lies in it

    def lowest(self, size: Sides, needed: int, stop: Callable[[], bool]) -> Place | None:
        """Minimum z, then y, then x, of the places where an item may stand; None if there is none.

        Args:
            size: length, width, height of the item, units.
            needed: area of its footprint that must lie on what is at its resting height.
            stop: asked between one height and the next; none of those left is looked at then.
        """
        length, width, height = size
        near_x, far_x = _windows(self.x, length)
        near_y, far_y = _windows(self.y, width)
        if not len(near_x) or not len(near_y) or height > self.room[2]:
            return None
        z = _window_maxima(_window_maxima(self.top, near_x, far_x).T, near_y, far_y)  # [Y, X]
        while (least := int(z.min())) <= self.room[2] - height:
            here = z == least
            if least:
                rows, columns = np.flatnonzero(here.any(1)), np.flatnonzero(here.any(0))
                level = self.top == least
                carried = _carried(level, self.x, near_x[columns], far_x[columns], length)
                carried = _carried(carried.T, self.y, near_y[rows], far_y[rows], width)
                here[np.ix_(rows, columns)] &= carried >= needed
            if here.any():
                row, column = divmod(int(here.argmax()), here.shape[1])
                return int(self.x.at[near_x[column]]), int(self.y.at[near_y[row]]), least
            if stop():
                return None
            z[z == least] = NOWHERE
        return None

    def first(self, rule: Rule, size: Sides, needed: int, stop: Callable[[], bool]) -> Place | None:
        """The position that a rule prefers of those where an item may stand; see `lowest`."""
        if rule is RULES["lowest"]:
            return self.lowest(size, needed, stop)
        near_x, far_x = _windows(self.x, size[0])
        near_y, far_y = _windows(self.y, size[1])
        if not len(near_x) or not len(near_y) or size[2] > self.room[2]:
            return None
        z = _window_maxima(_window_maxima(self.top, near_x, far_x).T, near_y, far_y)  # [Y, X]
        x, y = self.x.at[near_x][None], self.y.at[near_y][:, None]
        at = Positions(
            x, y, z, size, self.room,
            lambda: self._contact(x, y, z, size), lambda: self._waste(x, y, z, size),
        )  # fmt: skip
        inside = z <= self.room[2] - size[2]
        keys = [np.broadcast_to(key, z.shape)[inside] for key in (x, y, *reversed(rule(at)))]
        for place in np.flatnonzero(inside)[np.lexsort(keys)].tolist():
            row, column = divmod(place, len(near_x))
            if stop():
                return None
            level = self.top == z[row, column]
            some = slice(column, column + 1)
            carried = _carried(level, self.x, near_x[some], far_x[some], size[0])
            some = slice(row, row + 1)
            carried = _carried(carried.T, self.y, near_y[some], far_y[some], size[1])
            if not z[row, column] or carried[0, 0] >= needed:
                return int(x[0, column]), int(y[row, 0]), int(z[row, column])
        return None

    def _contact(self, x: np.ndarray, y: np.ndarray, z: np.ndarray, size: Sides) -> np.ndarray:
        """Area of an item's sides at walls and at other items, as in `top_faces`."""
        (length, width, height), (room_x, room_y, _) = size, self.room
        walls_x = 1.0 * (x == 0) + (x + length == room_x)
        walls_y = 1.0 * (y == 0) + (y + width == room_y)
        sums = walls_x * width * height + walls_y * length * height + 0.0 * z
        for low, sides in self.boxes:
            near, far = np.array(low), np.array(low) + sides
            touch_x = (far[0] == x) * 1.0 + (near[0] == x + length)
            touch_y = (far[1] == y) * 1.0 + (near[1] == y + width)
            along = _overlap(z, z + height, near[2], far[2])
            sums += along * touch_x * _overlap(y, y + width, near[1], far[1])
            sums += along * touch_y * _overlap(x, x + length, near[0], far[0])
        return sums

    def _waste(self, x: np.ndarray, y: np.ndarray, z: np.ndarray, size: Sides) -> np.ndarray:
        """Volume below an item that no item fills, as in `top_faces`."""
        empty = 1.0 * z * size[0] * size[1]
        for low, sides in self.boxes:
            area = _overlap(x, x + size[0], low[0], low[0] + sides[0])
            empty -= sides[2] * area * _overlap(y, y + size[1], low[1], low[1] + sides[1])
        return empty

    def have_room(self, sizes: np.ndarray) -> np.ndarray:
        """Which of many items come to rest below the ceiling anywhere, carried or not.

        Args:
            sizes: int64 [I, 3], units.

        Returns:
            bool [I]; all of them where the map has too many cells to look at them at once.
        """
        maxima = self._block_maxima()
        if maxima is None:
            return np.ones(len(sizes), bool)
        found = np.zeros(len(sizes), bool)
        corners = self.x.corner.sum() * self.y.corner.sum()
        for some in np.array_split(np.arange(len(sizes)), 1 + len(sizes) * corners // AT_ONCE):
            near_x, far_x, long_x, out_x = _blocks(self.x, sizes[some, 0])
            near_y, far_y, long_y, out_y = _blocks(self.y, sizes[some, 1])
            x, y = np.s_[:, :, None], np.s_[:, None]
            z = maxima[long_x[x], long_y[y], near_x[x], near_y[y]]
            for one, other in ((near_x, far_y), (far_x, near_y), (far_x, far_y)):
                np.maximum(z, maxima[long_x[x], long_y[y], one[x], other[y]], out=z)
            z[out_x[x] | out_y[y]] = NOWHERE
            found[some] = z.min((1, 2), initial=NOWHERE) <= self.room[2] - sizes[some, 2]
        return found

    def _block_maxima(self) -> np.ndarray | None:
        """Maxima over blocks of 2^i by 2^j cells from every cell on: [i, j, X, Y]."""
        long, wide = (int(cells).bit_length() for cells in self.top.shape)
        if self.top.size * long * wide > AT_ONCE:
            return None
        maxima = np.zeros((long, wide, *self.top.shape), np.int64)
        for i in range(long):
            row = self.top if not i else _doubled(maxima[i - 1, 0], 1 << (i - 1))
            maxima[i, 0] = row
            for j in range(1, wide):
                row = _doubled(row.T, 1 << (j - 1)).T
                maxima[i, j] = row
        return maxima

    def alike_beside(self, size: Sides, corner: Place) -> tuple[int, int]:
        """How many items of one size make full rows along x, and how many rows along y, on what is
        level with the corner: (0, 0) if not even the first lies on level ground.
        """
        (x, y, z), (length, width, _) = corner, size
        level = self.top == z
        first, last = np.searchsorted(self.x.at, [x, x + length], "left")
        front, back = np.searchsorted(self.y.at, [y, y + width], "left")
        along = _whole(self.x, level[first:, front:back].all(1), first, length)
        if not along:
            return 0, 0
        last = np.searchsorted(self.x.at, x + (along - 1) * _pitch(self.x, length) + length, "left")
        rows = _whole(self.y, level[first:last, front:].all(0), front, width)
        return along, 1 if self.flat else rows

    def place(self, size: Sides, corner: Place, along: int = 1, rows: int = 1) -> np.ndarray:
        """Puts items of one size side by side, from a corner on: along x, then along y.

        Returns:
            int64 [along * rows, 3], their corners in that order.
        """
        x = corner[0] + np.arange(along) * _pitch(self.x, size[0])
        y = corner[1] + np.arange(rows) * _pitch(self.y, size[1])
        self.x, old_x = self.x.with_ends(x, size[0])
        if not self.flat:
            self.y, old_y = self.y.with_ends(y, size[1])
            self.top = self.top[old_x[:, None], old_y]
        else:
            self.top = self.top[old_x]
        inside_x, inside_y = (
            _covered(lines, starts, side)
            for lines, starts, side in ((self.x, x, size[0]), (self.y, y, size[1]))
        )
        self.top[inside_x[:, None] & inside_y] = corner[2] + size[2]
        places = np.empty((rows, along, 3), np.int64)
        places[..., 0], places[..., 1], places[..., 2] = x, y[:, None], corner[2]
        flat = places.reshape(-1, 3)
        self.boxes += [((a, b, c), size) for a, b, c in flat.tolist()]
        return flat


def _overlap(start: np.ndarray, end: np.ndarray, near: int, far: int) -> np.ndarray:
    """How long two stretches run side by side."""
    return np.maximum(np.minimum(end, far) - np.maximum(start, near), 0).astype(np.float64)


def _pitch(lines: Lines, length: int) -> int:
    return -(-length // lines.step) * lines.step


def _windows(lines: Lines, length: int) -> tuple[np.ndarray, np.ndarray]:
    """The cells from .. to (not included) that an item covers, for every corner it fits at."""
    near = np.flatnonzero(lines.corner & (lines.at + length <= lines.at[-1]))
    return near, np.searchsorted(lines.at, lines.at[near] + length, "left")


def _blocks(lines: Lines, lengths: np.ndarray) -> tuple[np.ndarray, ...]:
    """(near, far, long, outside) [I, C] of every corner: two blocks of 2^long cells, from the cells
    near and far on, are the window of an item, unless it is outside.
    """
    corner = np.flatnonzero(lines.corner)
    ends = lines.at[corner] + lengths[:, None]
    outside = ends > lines.at[-1]
    last = np.searchsorted(lines.at, np.minimum(ends, lines.at[-1]), "left")
    near = np.broadcast_to(np.minimum(corner, len(lines.at) - 2), ends.shape)
    long = np.frexp(np.maximum(last - near, 1))[1] - 1
    return near, np.maximum(last - (1 << long), 0), long, outside


def _doubled(maxima: np.ndarray, block: int) -> np.ndarray:
    """Maxima of blocks of rows twice as long; those over the edge are as they were."""
    doubled = maxima.copy()
    np.maximum(maxima[:-block], maxima[block:], out=doubled[:-block])
    return doubled


def _window_maxima(values: np.ndarray, near: np.ndarray, far: np.ndarray) -> np.ndarray:
    """Maxima of rows near .. far: [windows, columns], by doubling."""
    long = np.frexp(far - near)[1] - 1  # the power of two that is not longer than the window
    maxima = np.empty((len(near), values.shape[1]), values.dtype)
    doubled = values
    for power in range(int(long.max()) + 1):
        mine = np.flatnonzero(long == power)
        if len(mine):
            maxima[mine] = np.maximum(doubled[near[mine]], doubled[far[mine] - (1 << power)])
        doubled = np.maximum(doubled[: -(1 << power)], doubled[1 << power :])
    return maxima


def _carried(
    level: np.ndarray, lines: Lines, near: np.ndarray, far: np.ndarray, length: int
) -> np.ndarray:
    """Sums of rows times their widths under every window, its last cell in part."""
    cell = level * np.diff(lines.at)[:, None]
    until = np.zeros((len(cell) + 1, cell.shape[1]), np.int64)
    np.cumsum(cell, axis=0, out=until[1:])
    beyond = lines.at[far] - (lines.at[near] + length)
    under: np.ndarray = until[far] - until[near] - level[far - 1] * beyond[:, None]
    return under


def _whole(lines: Lines, level: np.ndarray, first: int, length: int) -> int:
    """How many items fit side by side on level cells from the first on."""
    end = len(level) if level.all() else int(level.argmin())
    free = int(lines.at[first + end] - lines.at[first]) - length
    return free // _pitch(lines, length) + 1 if free >= 0 else 0


def _covered(lines: Lines, starts: np.ndarray, length: int) -> np.ndarray:
    """bool [C], whether one of the items lies on the cell."""
    item = np.searchsorted(starts, lines.at[:-1], "right") - 1
    covered: np.ndarray = (item >= 0) & (lines.at[:-1] < starts[item] + length)
    return covered
