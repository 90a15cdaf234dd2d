"""The third surface: a bin without a grid in NumPy, for what cannot wait for a compiler.

A bin is a map of heights between lines: those along which items end, across the bin from wall to
wall. The placements are those of `top_faces`, to the unit; the time of one grows with the number
of cells between the lines, not with cells times items.
"""

from collections import defaultdict
from collections.abc import Callable
from itertools import product

import numpy as np

from jaxpack.model.rules import before_centre
from jaxpack.packing.firm import held
from jaxpack.packing.lines import Lines, blocks_of, covered, pitch, whole_items, windows_of
from jaxpack.packing.rules import RULES, Positions, Rule

Place = tuple[int, int, int]
Sides = tuple[int, int, int]
Place4 = tuple[int, int, int, int]
Window = tuple[np.ndarray, np.ndarray]

NOWHERE = np.iinfo(np.int64).max
"""The resting height where an item is not allowed."""
AT_ONCE = 2**19  # numbers in a table of many items at once


class TopMap:
    """What lies in one bin, seen from above."""

    def __init__(self, room: Sides, flat: bool = False, step: int = 1, firm: bool = False) -> None:
        """An empty bin.

        Args:
            room: length, width, height of the bin, units.
            flat: 2D, where nothing ever lies behind anything.
            step: units; corners along x and y are multiples of it.
            firm: whether items carry only where they are carried, see `Rules.stability`.
        """
        self.room = room
        self.flat = flat
        corner = np.array([True, False])
        self.x, self.y = (Lines(np.array([0, side]), corner, step) for side in room[:2])
        self.top = np.zeros((1, 1), np.int64)  # of every cell
        self.firm = np.ones((1, 1), bool) if firm else None  # whether it carries what lies on it
        # By height of the tops: near x, far x, near y, far y of what carries.
        self.firm_at = defaultdict[int, list[Place4]](list)
        self.boxes = list[tuple[Place, Sides]]()  # corner and sides of what lies in it

    def lowest(self, size: Sides, needed: int, stop: Callable[[], bool]) -> Place | None:
        """Minimum z, then y, then x, of the places where an item may stand; None if there is none.

        Args:
            size: length, width, height of the item, units.
            needed: area of its footprint that must lie on what is at its resting height.
            stop: asked between one height and the next; none of those left is looked at then.
        """
        length, width, height = size
        near_x, far_x = windows_of(self.x, length)
        near_y, far_y = windows_of(self.y, width)
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
                enough = carried >= needed
                if self.firm is not None:
                    windows = (near_x[columns], far_x[columns]), (near_y[rows], far_y[rows])
                    enough &= self._held(level & self.firm, windows, size)
                here[np.ix_(rows, columns)] &= enough
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
        near_x, far_x = windows_of(self.x, size[0])
        near_y, far_y = windows_of(self.y, size[1])
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
            across, along = slice(column, column + 1), slice(row, row + 1)
            windows = (near_x[across], far_x[across]), (near_y[along], far_y[along])
            carried = _carried(level, self.x, *windows[0], size[0])
            carried = _carried(carried.T, self.y, *windows[1], size[1])
            enough = carried >= needed
            if self.firm is not None:
                enough &= self._held(level & self.firm, windows, size)
            if not z[row, column] or enough[0, 0]:
                return int(x[0, column]), int(y[row, 0]), int(z[row, column])
        return None

    def _held(self, solid: np.ndarray, windows: tuple[Window, Window], size: Sides) -> np.ndarray:
        """Whether each quarter of a base has solid cells beyond its centre, see `firm`: [Y, X].

        Args:
            solid: bool [X, Y], the cells that carry.
            windows: of the bases, along x and along y.
            size: of the item.
        """
        count = np.zeros((solid.shape[0] + 1, solid.shape[1] + 1), np.int64)
        count[1:, 1:] = solid.cumsum(0).cumsum(1)
        halves = []
        for lines, (near, far), side in zip((self.x, self.y), windows, size, strict=False):
            before, start = before_centre(side), lines.at[near]
            until = np.searchsorted(lines.at, start + before, "right")
            since = np.searchsorted(lines.at, start + side - before, "left") - 1
            halves.append(((near, until), (since, far)))
        held = np.ones((len(windows[1][0]), len(windows[0][0])), bool)
        for (a, b), (c, d) in product(*halves):
            c, d = c[:, None], d[:, None]
            held &= count[b, d] - count[a, d] - count[b, c] + count[a, c] > 0
        return held

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
            near_x, far_x, long_x, out_x = blocks_of(self.x, sizes[some, 0])
            near_y, far_y, long_y, out_y = blocks_of(self.y, sizes[some, 1])
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
        level = self.top == z if self.firm is None else (self.top == z) & self.firm
        first, last = np.searchsorted(self.x.at, [x, x + length], "left")
        front, back = np.searchsorted(self.y.at, [y, y + width], "left")
        along = whole_items(self.x, level[first:, front:back].all(1), first, length)
        if not along:
            return 0, 0
        last = np.searchsorted(self.x.at, x + (along - 1) * pitch(self.x, length) + length, "left")
        rows = whole_items(self.y, level[first:last, front:].all(0), front, width)
        return along, 1 if self.flat else rows

    def place(self, size: Sides, corner: Place, along: int = 1, rows: int = 1) -> np.ndarray:
        """Puts items of one size side by side, from a corner on: along x, then along y.

        Returns:
            int64 [along * rows, 3], their corners in that order.
        """
        x = corner[0] + np.arange(along) * pitch(self.x, size[0])
        y = corner[1] + np.arange(rows) * pitch(self.y, size[1])
        base = corner[0], corner[0] + size[0], corner[1], corner[1] + size[1]
        carries = (
            base if self.firm is None or len(x) * len(y) > 1 else self._carries(base, corner[2])
        )
        self.x, old_x = self.x.with_ends(x, size[0])
        old_y = np.zeros(1, int)
        if not self.flat:
            self.y, old_y = self.y.with_ends(y, size[1])
        self.top = self.top[old_x[:, None], old_y]
        inside_x, inside_y = (
            covered(lines, starts, side)
            for lines, starts, side in ((self.x, x, size[0]), (self.y, y, size[1]))
        )
        self.top[inside_x[:, None] & inside_y] = corner[2] + size[2]
        places = np.empty((rows, along, 3), np.int64)
        places[..., 0], places[..., 1], places[..., 2] = x, y[:, None], corner[2]
        flat = places.reshape(-1, 3)
        self.boxes += [((a, b, c), size) for a, b, c in flat.tolist()]
        if self.firm is not None:
            self.firm = self.firm[old_x[:, None], old_y]
            self.firm[inside_x[:, None] & inside_y] = False
            moved = [(a - corner[0], b - corner[1]) for a, b, _ in flat.tolist()]
            these = [
                (carries[0] + a, carries[1] + a, carries[2] + b, carries[3] + b) for a, b in moved
            ]
            self.firm_at[corner[2] + size[2]] += these
            sure_x, sure_y = (
                covered(lines, starts + near, far - near)
                for lines, starts, near, far in (
                    (self.x, x, carries[0] - corner[0], carries[1] - corner[0]),
                    (self.y, y, carries[2] - corner[1], carries[3] - corner[1]),
                )
            )
            self.firm[sure_x[:, None] & sure_y] = True
        return flat

    def _carries(self, base: Place4, z: int) -> Place4:
        """What carries of the top of an item that stands there; see `firm.held`."""
        if not z:
            return base
        under = np.array(self.firm_at[z], np.int64).T[:, :, None]
        ends = tuple(np.array([end]) for end in base)
        there = np.ones((under.shape[1], 1), bool)
        found = held(np, lambda rows: rows.min(0), ends, tuple(under), there, np.dtype("int64"))
        a, b, c, d = (int(end[0]) for end in found)
        return a, b, c, d


def _overlap(start: np.ndarray, end: np.ndarray, near: int, far: int) -> np.ndarray:
    """How long two stretches run side by side."""
    return np.maximum(np.minimum(end, far) - np.maximum(start, near), 0).astype(np.float64)


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
