"""Loops over the lines of a bin that are in use, tile by tile.

Batch members use as many lines as they need, of an array that has room for many more: a tile is a
few lines along x by a few along y, of all members, and what no member uses is never looked at.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax import Array

TILE = 8  # lines
BITS = 3
AT_ONCE = 1 << BITS  # lines that those of a tile look at together


T = TypeVar("T")
Tile = tuple[Array, Array]  # int32[] each: its first lines along x and y


class Tiles(NamedTuple):
    """The lines in use, cut into tiles."""

    lines_x: Array  # int32[]
    lines_y: Array
    wide: int  # lines of a tile along y
    batch: int

    def each(self, function: Callable[[Tile, T], T], carry: T) -> T:
        """Runs over all tiles; none of it divides, which takes long to compile."""

        def one(now: tuple[Array, Array, T]) -> tuple[Array, Array, T]:
            at_x, at_y, carry = now
            carry = function((at_x, at_y), carry)
            last = at_y + self.wide >= self.lines_y
            return (
                jnp.where(last, at_x + TILE, at_x),
                jnp.where(last, 0, at_y + self.wide).astype(jnp.int32),
                carry,
            )

        start = jnp.int32(0), jnp.int32(0), carry
        done: tuple[Array, Array, T] = jax.lax.while_loop(
            lambda now: now[0] < self.lines_x, one, start
        )
        return done[2]

    def x(self, column: Array, at: Tile) -> Array:
        """Of [X, B] its lines along x: [TILE, B]."""
        return jax.lax.dynamic_slice(column, (at[0], jnp.int32(0)), (TILE, self.batch))

    def y(self, column: Array, at: Tile) -> Array:
        """Of [Y, B] its lines along y: [wide, B]."""
        return jax.lax.dynamic_slice(column, (at[1], jnp.int32(0)), (self.wide, self.batch))

    def cells(self, values: Array, at: Tile) -> Array:
        """Of [X, Y, B] its part: [TILE, wide, B]."""
        where = (*at, jnp.int32(0))
        return jax.lax.dynamic_slice(values, where, (TILE, self.wide, self.batch))

    def write(self, values: Array, cells: Array, at: Tile) -> Array:
        """The values [X, Y, B] with that part replaced."""
        return jax.lax.dynamic_update_slice(values, cells, (*at, jnp.int32(0)))


def highest(
    tiles: Tiles, axis: int, heights: Array, lines: Array, length: Array, found: Array
) -> Array:
    """Highest number over the lines within `length` [B] of every line along an axis.

    Args:
        heights: dtype [X, Y, B].
        found: written to, in the tiles.
    """
    batch, count = tiles.batch, (tiles.lines_x, tiles.lines_y)[axis]

    def tile(at: Tile, found: Array) -> Array:
        here = (tiles.x, tiles.y)[axis](lines, at)
        end = here + length
        at_x, at_y = at

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
        most = jax.lax.fori_loop(0, (count + (AT_ONCE - 1)) >> BITS, some, nothing)
        return tiles.write(found, most, at)

    return tiles.each(tile, found)


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
    row: Array = jax.lax.fori_loop(0, (count + (AT_ONCE - 1)) >> BITS, some, nothing)
    return row


def indices(column: Array) -> Array:
    """int32 [len, 1, ...], to compare with what is batched."""
    return jnp.arange(len(column), dtype=jnp.int32).reshape(-1, *(1,) * (column.ndim - 1))
