"""Loops over the lines of a bin that are in use, tile by tile.

Batch members use as many lines as they need, of an array that has room for many more: a tile is a
few lines along x by a few along y, of all members, and what no member uses is never looked at.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

TILE, AT_ONCE = 8, 8
"""Lines of a tile, and those that its lines look at together."""


class Tiles(NamedTuple):
    """The lines in use, cut into tiles."""

    lines_x: Array  # int32[]
    lines_y: Array
    wide: int  # lines of a tile along y
    batch: int

    @property
    def _along_y(self) -> Array:
        return (self.lines_y + (self.wide - 1)) // self.wide

    @property
    def number(self) -> Array:
        """How many tiles there are: int32[]."""
        return (self.lines_x + (TILE - 1)) // TILE * self._along_y

    def start(self, n: Array) -> tuple[Array, Array]:
        """First lines of tile n along x and y: int32[] each."""
        return n // self._along_y * TILE, n % self._along_y * self.wide

    def x(self, column: Array, n: Array) -> Array:
        """Of [X, B] its lines along x: [TILE, B]."""
        return jax.lax.dynamic_slice(column, (self.start(n)[0], jnp.int32(0)), (TILE, self.batch))

    def y(self, column: Array, n: Array) -> Array:
        """Of [Y, B] its lines along y: [wide, B]."""
        return jax.lax.dynamic_slice(
            column, (self.start(n)[1], jnp.int32(0)), (self.wide, self.batch)
        )

    def cells(self, values: Array, n: Array) -> Array:
        """Of [X, Y, B] its part: [TILE, wide, B]."""
        where = (*self.start(n), jnp.int32(0))
        return jax.lax.dynamic_slice(values, where, (TILE, self.wide, self.batch))

    def write(self, values: Array, cells: Array, n: Array) -> Array:
        """The values [X, Y, B] with that part replaced."""
        return jax.lax.dynamic_update_slice(values, cells, (*self.start(n), jnp.int32(0)))


def highest(
    tiles: Tiles, axis: int, heights: Array, lines: Array, length: Array, found: Array
) -> Array:
    """Highest number over the lines within `length` [B] of every line along an axis.

    Args:
        heights: dtype [X, Y, B].
        found: written to, in the tiles.
    """
    batch, count = tiles.batch, (tiles.lines_x, tiles.lines_y)[axis]

    def tile(n: Array, found: Array) -> Array:
        here = (tiles.x, tiles.y)[axis](lines, n)
        end = here + length
        at_x, at_y = tiles.start(n)

        def some(part: Array, most: Array) -> Array:
            first = part * AT_ONCE
            others = jax.lax.dynamic_slice(lines, (first, jnp.int32(0)), (AT_ONCE, batch))
            where = ((first, at_y), (at_x, first))[axis]
            shape = ((AT_ONCE, tiles.wide), (TILE, AT_ONCE))[axis]
            values = jax.lax.dynamic_slice(heights, (*where, jnp.int32(0)), (*shape, batch))
            for n, other in enumerate(jnp.moveaxis(values, axis, 0)):
                inside = jnp.expand_dims((others[n] >= here) & (others[n] < end), 1 - axis)
                most = jnp.maximum(most, jnp.where(inside, jnp.expand_dims(other, axis), 0))
            return most

        nothing = jnp.zeros((TILE, tiles.wide, batch), heights.dtype)
        most = jax.lax.fori_loop(0, (count + (AT_ONCE - 1)) // AT_ONCE, some, nothing)
        return tiles.write(found, most, n)

    return jax.lax.fori_loop(0, tiles.number, tile, found)


def row_at(count: Array, lines: Array, at: Array, values: Array, axis: int) -> Array:
    """Of [X, Y, B] the row of the line at a coordinate [B]: without that axis. Loops, as XLA
    gathers one number after the other.
    """
    shape = [*values.shape]
    shape[axis] = min(AT_ONCE, len(lines))

    def some(part: Array, row: Array) -> Array:
        first, zero = part * AT_ONCE, jnp.int32(0)
        others = jax.lax.dynamic_slice(lines, (first, zero), (shape[axis], lines.shape[1]))
        where = ((first, zero, zero), (zero, first, zero))[axis]
        rows = jnp.moveaxis(jax.lax.dynamic_slice(values, where, shape), axis, 0)
        for n, other in enumerate(rows):
            row = jnp.where(others[n] == at, other, row)
        return row

    nothing = jnp.zeros(shape[:axis] + shape[axis + 1 :], values.dtype)
    row: Array = jax.lax.fori_loop(0, (count + (AT_ONCE - 1)) // AT_ONCE, some, nothing)
    return row


def indices(column: Array) -> Array:
    """int32 [len, 1, ...], to compare with what is batched."""
    return jnp.arange(len(column), dtype=jnp.int32).reshape(-1, *(1,) * (column.ndim - 1))
