"""The surface without a grid: a bin as the heights between the edges of what lies in it.

Lengths are whole units as fine as wanted: a placement costs by the number of edges in the bin and
not by its resolution. The rule is the height map's: an item comes down from above, rests on the
highest face under its footprint, and enough of the footprint must lie on faces of exactly that
height. An item may stand with its near edges at 0 and at the far edges of those already there.

A line is a coordinate at which items may stand, in the order in which it came; `heights` has the
height just beyond every pair of lines. As every face begins at a line, and ends at one or (with
corners on a grid of `step`) a little before one that nothing stands between, the highest face under
a footprint is the highest of these numbers within it. Loops go over tiles of the lines that are in
use, in the batch member that has most: what is reserved but unused costs memory only.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.model.problem import MOST_UNITS
from jaxpack.packing.firm import QUARTERS, beyond, held
from jaxpack.packing.rules import Positions, Rule
from jaxpack.packing.surface import Triple, before, least_first
from jaxpack.packing.tiles import AT_ONCE, TILE, Tile, Tiles, highest, indices, row_at
from jaxpack.xla.programs import largest_of, least

SHORT = MOST_UNITS
"""Units a side, of which sums fit int16."""
FACE_BITS = 2
FACES = 1 << FACE_BITS  # looked at together


class Faces(NamedTuple):
    """What lies in one bin. X and Y are the most lines, M the most items, both rounded up."""

    x: Array  # dtype [X, B], units; far away if not in use
    y: Array  # dtype [Y, B]
    used_x: Array  # int32 [B], lines in use
    used_y: Array
    heights: Array  # dtype [X, Y, B], just beyond a line along x and one along y
    boxes: tuple[Array, ...]  # dtype [M, B] each: near x, far x, near y, far y, bottom, top
    firm: tuple[
        Array, ...
    ]  # dtype [M, B] each: near x, far x, near y, far y of what carries; or ()
    used: Array  # int32 [B], boxes in use
    across: Array  # dtype [X, Y, B], room for what `candidates` finds out
    z: Array


@dataclass(frozen=True)
class TopFaces:
    """The surface of bins in whole units: see `jaxpack.packing.surface`.

    Areas have the type of `needed`, int32 or int64, and must fit it; where that is int64, all of
    this has to be traced with x64 enabled, for which every other type is written out.
    """

    most: int  # items that a bin can hold
    flat: bool = False  # 2D
    short: bool = False  # no side is longer than `SHORT`: lengths have 16 bits
    step: int = 1  # units, of which corners along x and y are multiples
    firm: bool = False  # whether items carry only where they are carried, see `Rules.stability`

    @property
    def dtype(self) -> np.dtype:
        """int16 or int32."""
        return np.dtype("int16" if self.short else "int32")

    def empty(self, room: Triple) -> Faces:
        """See `Surface.empty`."""
        batch, dtype = room[0].shape[0], self.dtype
        X = _rounded(self.most + 1, AT_ONCE)
        Y = 1 if self.flat else X
        x, y = (
            jnp.full((lines, batch), np.iinfo(dtype).max, dtype).at[0].set(0) for lines in (X, Y)
        )
        one, nothing = jnp.ones(batch, jnp.int32), jnp.zeros((X, Y, batch), dtype)
        column, none = jnp.zeros((_rounded(self.most, FACES), batch), dtype), jnp.zeros_like(one)
        boxes, firm = (column,) * 6, (column,) * (4 if self.firm else 0)
        return Faces(x, y, one, one, nothing, boxes, firm, none, nothing, nothing)

    def candidates(
        self, state: Faces, size: Triple, needed: Array, room: Triple, wanted: Array
    ) -> tuple["Corners", Faces]:
        """Every pair of lines, of a bin that is not full."""
        wanted &= state.used < self.most
        lines_x, lines_y = (
            jnp.where(wanted, used, 0).max() for used in (state.used_x, state.used_y)
        )
        tiles = Tiles(lines_x, lines_y, 1 if self.flat else TILE, len(wanted))
        across = highest(tiles, 0, state.heights, state.x, size[0], state.across)
        state = state._replace(across=across)
        if self.flat:
            return Corners(tiles, state, across, size, needed, room, wanted), state
        z = highest(tiles, 1, across, state.y, size[1], state.z)
        return Corners(tiles, state, z, size, needed, room, wanted), state._replace(z=z)

    def place(
        self, state: Faces, size: Triple, corner: Triple, fits: Array, room: Triple, opens: Array
    ) -> Faces:
        """See `Surface.place`."""
        start = jnp.stack(corner)
        end = start + jnp.stack(size)
        x, used_x, new_x, pred_x = self._with_line(state.x, state.used_x, end[0], fits, room[0])
        y, used_y, new_y, pred_y = self._with_line(state.y, state.used_y, end[1], fits, room[1])
        if self.flat:
            y, used_y, new_y = state.y, state.used_y, jnp.full_like(new_y, -1)
        tiles = Tiles(used_x.max(), used_y.max(), 1 if self.flat else TILE, len(fits))
        # A new line's ground is that of the line before it, as far as it reached.
        row = row_at(tiles.lines_x, state.x, pred_x, state.heights, axis=0)
        column = row_at(tiles.lines_y, state.y, pred_y, state.heights, axis=1)
        both = jnp.where(state.y == pred_y, row, self.dtype.type(0)).max(0)
        column = jnp.where(indices(x) == new_x, both, column)

        def tile(at: Tile, heights: Array) -> Array:
            there_x, i = tiles.x(x, at), at[0] + indices(tiles.x(x, at))
            there_y, j = tiles.y(y, at), at[1] + indices(tiles.y(y, at))
            here = tiles.cells(heights, at)
            here = jnp.where((i == new_x)[:, None], tiles.y(row, at)[None], here)
            here = jnp.where((j == new_y)[None], tiles.x(column, at)[:, None], here)
            inside_x = (there_x >= start[0]) & (there_x < end[0]) & fits
            inside_y = (there_y >= start[1]) & (there_y < end[1])
            here = jnp.where(inside_x[:, None] & inside_y[None], end[2], here)
            return tiles.write(heights, here, at)

        heights = tiles.each(tile, state.heights)
        box = indices(state.boxes[0]) == jnp.where(fits, state.used, -1)
        sides = (start[0], end[0], start[1], end[1], start[2], end[2])
        nowhere = np.iinfo(self.dtype).max
        firm = self._held(state, start, end) if self.firm else ()
        return state._replace(
            x=jnp.where(opens & (indices(x) > 0), nowhere, x).astype(self.dtype),
            y=jnp.where(opens & (indices(y) > 0), nowhere, y).astype(self.dtype),
            used_x=jnp.where(opens, 1, used_x),
            used_y=jnp.where(opens, 1, used_y),
            heights=heights.at[0, 0].set(jnp.where(opens, self.dtype.type(0), heights[0, 0])),
            boxes=tuple(
                jnp.where(box, value, column)
                for column, value in zip(state.boxes, sides, strict=True)
            ),
            firm=tuple(
                jnp.where(box, value, column)
                for column, value in zip(state.firm, firm, strict=True)
            ),
            used=jnp.where(opens, 0, state.used + fits.astype(jnp.int32)),
        )

    def _held(self, state: Faces, start: Array, end: Array) -> tuple[Array, ...]:
        """What carries of the tops of items from corner to corner [3, B]; see `firm.held`."""
        base = (start[0], end[0], start[1], end[1])
        used = jnp.arange(len(state.firm[0]), dtype=jnp.int32)[:, None] < state.used
        there = used & (state.boxes[5] == start[2])
        area = np.dtype("int32" if self.short else "int64")
        found = held(jnp, lambda rows: least(rows, 1), base, state.firm, there, area)
        return tuple(jnp.where(start[2] == 0, a, b) for a, b in zip(base, found, strict=True))

    def _with_line(
        self, lines: Array, used: Array, end: Array, fits: Array, wall: Array
    ) -> tuple[Array, Array, Array, Array]:
        """(lines with the first that a far edge makes, how many, its index or -1, line before)."""
        if self.step > 1:
            end = -(-end // self.step) * self.step
        index = indices(lines)
        is_new = fits & (end < wall) & (least((lines != end).astype(jnp.int8), 1) == 1)
        earlier = (lines <= end) & (index < used)
        pred = -least(-jnp.where(earlier, lines, self.dtype.type(0)), 1)
        at = jnp.where(is_new, used, -1)
        lines = jnp.where(index == at, end.astype(self.dtype), lines)
        return lines, used + is_new.astype(jnp.int32), at, pred


def stand_firm(state: Faces, at: Triple, size: Triple) -> Array:
    """Which positions are on the floor, or have what carries beyond the item's centre: bool.

    Args:
        state: of `TopFaces` that are `firm`.
        at: corners that broadcast to [X, Y, B], at their resting heights.
        size: sides of the items [B].
    """
    x, y, z = at
    beyond_x, beyond_y = beyond(jnp, x, size[0], 0), beyond(jnp, y, size[1], 1)

    def more(n: Array, quarters: Array) -> Array:
        near_x, end_x, near_y, end_y = (column[n] for column in state.firm)
        there = (state.boxes[5][n] == z) & (n < state.used)
        both = beyond_x(near_x, end_x) & beyond_y(near_y, end_y)
        return quarters | jnp.where(there, both, jnp.int8(0))

    quarters = jax.lax.fori_loop(0, state.used.max(), more, jnp.zeros(z.shape, jnp.int8))
    return (z == 0) | (quarters == QUARTERS)


class Corners(NamedTuple):
    """Candidates between lines. Whether one is carried is looked at when it is preferred."""

    tiles: Tiles
    state: Faces
    z: Array  # dtype [X, Y, B], in the tiles
    size: Triple
    needed: Array  # int32 or int64 [B]
    room: Triple
    wanted: Array  # bool [B]

    def first(self, rule: Rule) -> tuple[Triple, Array]:
        """The position that the rule prefers; the corner means nothing where there is none."""
        kinds = jax.eval_shape(lambda: self._keys(rule, (jnp.int32(0), jnp.int32(0)))[0])
        nothing = [jnp.full(key.shape[-1:], largest_of(key.dtype), key.dtype) for key in kinds]

        def look(at: Tile, best: list[Array]) -> list[Array]:
            keys, inside = self._keys(rule, at)
            hopeful = inside & self.wanted & (keys[0] <= best[0])

            def first_of_tile() -> list[Array]:
                allowed = hopeful & self._carried(at)
                rows = [key.reshape(-1, key.shape[-1]) for key in keys]
                mask = allowed.reshape(-1, allowed.shape[-1])
                found = least_first(rows, mask, lambda key: least(key, 1))
                wins = before(found, best)
                return [jnp.where(wins, one, other) for one, other in zip(found, best, strict=True)]

            return jax.lax.cond(hopeful.any(), first_of_tile, lambda: best)

        *_, place, z = self.tiles.each(look, nothing)
        bits = _bits(self.z.dtype)
        x, y = (part.astype(z.dtype) for part in (place & ((1 << bits) - 1), place >> bits))
        return (x, y, z), z < np.iinfo(z.dtype).max

    def _keys(self, rule: Rule, tile: Tile) -> tuple[list[Array], Array]:
        """(the rule's keys, then y and x as one, and z; whether it is inside the bin) of a tile."""
        x, y = self.tiles.x(self.state.x, tile)[:, None], self.tiles.y(self.state.y, tile)[None]
        z = self.tiles.cells(self.z, tile)
        at_x, at_y = tile
        inside_x = (at_x + indices(x) < self.state.used_x) & (x <= self.room[0] - self.size[0])
        rows = at_y + jnp.arange(y.shape[1], dtype=jnp.int32)[:, None]
        inside_y = (rows < self.state.used_y) & (y <= self.room[1] - self.size[1])
        at = Positions(
            x, y, z, self.size, self.room,
            lambda: self._contact(x, y, z), lambda: self._waste(x, y, z),
        )  # fmt: skip
        wide = np.dtype("int32" if z.dtype == np.int16 else "int64")
        place = (y.astype(wide) << _bits(z.dtype)) + x.astype(wide)
        keys = [jnp.broadcast_to(key, z.shape) for key in (*rule(at), place, z)]
        return keys, inside_x & inside_y & (z <= self.room[2] - self.size[2])

    def _carried(self, tile: Tile) -> Array:
        """Whether enough of an item lies on faces at its resting height, of a tile."""
        x, y = self.tiles.x(self.state.x, tile), self.tiles.y(self.state.y, tile)
        z = self.tiles.cells(self.z, tile)
        far_x, far_y = x + self.size[0], y + self.size[1]
        area_type = self.needed.dtype
        if self.state.firm:
            beyond_x = beyond(jnp, x, self.size[0], 0)
            beyond_y = beyond(jnp, y, self.size[1], 1)

        def some(part: Array, sums: tuple[Array, Array]) -> tuple[Array, Array]:
            area, quarters = sums
            row = (part * FACES, jnp.int32(0))
            near_x, end_x, near_y, end_y, _, top = (
                jax.lax.dynamic_slice(column, row, (FACES, self.tiles.batch))
                for column in self.state.boxes
            )
            for face in range(FACES):
                on_x = jnp.minimum(far_x, end_x[face]) - jnp.maximum(x, near_x[face])
                on_y = jnp.minimum(far_y, end_y[face]) - jnp.maximum(y, near_y[face])
                on_y = jnp.where(part * FACES + face < self.state.used, on_y, 0)
                on_x, on_y = (jnp.maximum(side, 0).astype(area_type) for side in (on_x, on_y))
                level = top[face] == z
                area += jnp.where(level, on_x[:, None] * on_y[None], 0).astype(area_type)
                if self.state.firm:
                    ends = [column[part * FACES + face] for column in self.state.firm]
                    level &= part * FACES + face < self.state.used
                    both = beyond_x(*ends[:2])[:, None] & beyond_y(*ends[2:])[None]
                    quarters |= jnp.where(level, both, jnp.int8(0))
            return area, quarters

        count = (self.state.used.max() + (FACES - 1)) >> FACE_BITS
        nothing = jnp.zeros(z.shape, area_type), jnp.zeros(z.shape, jnp.int8)
        area, quarters = jax.lax.fori_loop(0, count, some, nothing)
        held = quarters == QUARTERS if self.state.firm else True
        return (z == 0) | ((area >= self.needed) & held)

    def _contact(self, x: Array, y: Array, z: Array) -> Array:
        """Area of an item's sides at walls and at other items: float32, of the shape of z."""
        length, width, height = (side.astype(jnp.float32) for side in self.size)
        room_x, room_y, _ = self.room
        far_x, far_y, top = x + self.size[0], y + self.size[1], z + self.size[2]
        at_x = ((x == 0) * 1.0 + (far_x == room_x) * 1.0).astype(jnp.float32)
        at_y = ((y == 0) * 1.0 + (far_y == room_y) * 1.0).astype(jnp.float32)

        def beside(n: Array, sums: Array) -> Array:
            near_x, end_x, near_y, end_y, below, above = (column[n] for column in self.state.boxes)
            along = _overlap(z, top, below, above) * (n < self.state.used)
            touch_x = ((end_x == x) | (near_x == far_x)) * _overlap(y, far_y, near_y, end_y)
            touch_y = ((end_y == y) | (near_y == far_y)) * _overlap(x, far_x, near_x, end_x)
            return sums + along * (touch_x + touch_y)

        walls = at_x * width * height + at_y * length * height + jnp.zeros(z.shape, jnp.float32)
        return jax.lax.fori_loop(0, self.state.used.max(), beside, walls)

    def _waste(self, x: Array, y: Array, z: Array) -> Array:
        """Volume below an item that no item fills: float32, of the shape of z."""
        far_x, far_y = x + self.size[0], y + self.size[1]

        def without(n: Array, empty: Array) -> Array:
            near_x, end_x, near_y, end_y, below, above = (column[n] for column in self.state.boxes)
            tall = (above - below).astype(jnp.float32) * (n < self.state.used)
            area = _overlap(x, far_x, near_x, end_x) * _overlap(y, far_y, near_y, end_y)
            return empty - tall * area

        base = self.size[0].astype(jnp.float32) * self.size[1].astype(jnp.float32)
        return jax.lax.fori_loop(0, self.state.used.max(), without, z.astype(jnp.float32) * base)


def _bits(dtype: np.dtype) -> int:
    """Of a coordinate in the bin."""
    return 14 if dtype == np.int16 else 30


def _overlap(start: Array, end: Array, near: Array, far: Array) -> Array:
    """How long two stretches run side by side: float32."""
    return jnp.maximum(jnp.minimum(end, far) - jnp.maximum(start, near), 0).astype(jnp.float32)


def _rounded(count: int, step: int) -> int:
    return -(-count // step) * step
