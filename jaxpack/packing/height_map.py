"""The kernel: where would an item of this size come to rest, seen from above?

Height maps are ``[L + window - 1, W + window - 1, *batch]``: batch last, because XLA on the
CPU vectorises over the last axis, and in the narrowest integer that holds every number of the
kernel. Cells outside the bin are walls of the largest number of the type: a footprint that
reaches over the edge then rests too high to fit, and no comparison of coordinates is needed.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.model.problem import Problem
from jaxpack.packing.rules import Positions, Rule
from jaxpack.packing.surface import Triple, least_first
from jaxpack.xla.programs import apart, least

LARGE_WINDOW = 150
"""From this many cells on, a window is put together from blocks of 1, 2, 4, ... cells."""


@dataclass(frozen=True)
class HeightMap:
    """The surface of bins in cells: see `jaxpack.packing.surface`. Its state is the map."""

    problem: Problem

    @property
    def dtype(self) -> np.dtype:
        """See `cell_dtype`."""
        return cell_dtype(self.problem)

    @property
    def flat(self) -> bool:
        """2D."""
        return self.problem.bin[1] == 1

    @property
    def most(self) -> int | None:
        """Any number."""
        return None

    def empty(self, room: Triple) -> Array:
        """See `empty_map`."""
        return empty_map(self.problem, jnp.stack(room))

    def candidates(
        self, state: Array, size: Triple, needed: Array, room: Triple, wanted: Array
    ) -> tuple["Cells", Array]:
        """Every cell of the bin."""
        z = rest(self.problem, state, size, needed, room[2])
        return Cells(self.problem, state, z, size, room), state

    def place(
        self, state: Array, size: Triple, corner: Triple, fits: Array, room: Triple, opens: Array
    ) -> Array:
        """See `drop`."""
        return jnp.where(opens, self.empty(room), drop(self.problem, state, size, corner, fits))


class Cells(NamedTuple):
    """Candidates on a height map."""

    problem: Problem
    heights: Array
    z: Array  # cell_dtype [L, W, *batch] from `rest`
    size: Triple
    room: Triple

    def first(self, rule: Rule) -> tuple[Triple, Array]:
        """The position that the rule prefers; the corner means nothing where there is none."""
        L, W, _ = self.problem.bin
        x, y = _coordinates(self.problem, self.z.ndim - 2)
        at = Positions(x[:L], y[:, :W], self.z, self.size, self.room, self.contact, self.waste)
        keys = rule(at)
        # Cells in the order of y, then x; of what the corner is made besides z.
        place = (at.y * L + at.x).astype(self.z.dtype)
        wall = np.iinfo(self.z.dtype).max
        by_height = keys[0] is self.z  # which says already what is not allowed
        keys = (*keys, place) if by_height else (*keys, place, self.z)
        allowed = None if by_height else self.z < wall
        found = least_first(keys, allowed, lambda key: least(key, 2))
        z = found[0 if by_height else -1]
        first = found[len(keys) - (1 if by_height else 2)]
        return (first % L, first // L, z), z < wall

    def contact(self) -> Array:
        """Area of an item's sides at walls or at what is higher beside it, all that is below its
        top counted as solid: float32 [L, W, *batch].
        """
        length, width, height = self.size

        def touching(d: Array, e: Array, there: Array) -> Array:
            along_y = ((d == 0) | (d == length + 1)) & (e > 0) & (e <= width)
            along_x = ((e == 0) | (e == width + 1)) & (d > 0) & (d <= length)
            return jnp.where(along_x | along_y, jnp.clip(there - self.z, 0, height), 0)

        return self._summed(touching)

    def waste(self) -> Array:
        """Volume between an item and what is below it: float32 [L, W, *batch], cells."""
        length, width, _ = self.size

        def empty(d: Array, e: Array, there: Array) -> Array:
            under = (d > 0) & (d <= length) & (e > 0) & (e <= width)
            return jnp.where(under, jnp.maximum(self.z - there, 0), 0)

        return self._summed(empty)

    def _summed(self, cell: Callable[[Array, Array, Array], Array]) -> Array:
        """Sum of `cell(d, e, height)` over the cells under and around every position, which are
        counted from one before the corner on.
        """
        window_x, window_y = self.problem.window
        wall = np.iinfo(self.heights.dtype).max
        padding = ((1, 1), (1, 1), *((0, 0),) * (self.z.ndim - 2))
        heights = jnp.pad(self.heights, padding, constant_values=wall)

        def add(n: Array, sums: Array) -> Array:
            d, e = jnp.divmod(n, window_y + 2)
            there = jax.lax.dynamic_slice(heights, (d, e, *(0,) * (self.z.ndim - 2)), self.z.shape)
            d, e = d.astype(self.z.dtype), e.astype(self.z.dtype)
            return sums + cell(d, e, there).astype(jnp.float32)

        cells = (window_x + 2) * (window_y + 2)
        return jax.lax.fori_loop(0, cells, add, jnp.zeros(self.z.shape, jnp.float32))


def cell_dtype(problem: Problem) -> np.dtype:
    """The narrowest signed type for heights, cell counts and positions, its maximum kept free."""
    length, width, height = problem.bin
    largest = max(height, length * width)
    for name in ("int8", "int16"):
        if largest < np.iinfo(name).max:
            return np.dtype(name)
    return np.dtype("int32")


def empty_map(problem: Problem, bins: Array) -> Array:
    """Height maps of empty bins with their walls.

    Args:
        bins: int [3, *batch], cells: the bin of each batch member, no larger than problem.bin.
    """
    x, y = _coordinates(problem, bins.ndim - 1)
    dtype = cell_dtype(problem)
    inside = (x < bins[0].astype(dtype)) & (y < bins[1].astype(dtype))
    return jnp.where(inside, 0, np.iinfo(dtype).max).astype(dtype)


def rest(problem: Problem, heights: Array, size: Triple, needed: Array, ceiling: Array) -> Array:
    """Resting height of an item at every position, the wall's height where it is not allowed.

    The share of the footprint at the resting height is counted in two passes, along x and then
    along y: a maximum together with the number of cells that reach it is associative, so the
    cost is cells * (length + width) and not cells * length * width. On large grids it is
    cells * log(length * width), see `_highest_by_doubling`.

    Args:
        heights: cell_dtype [L + window - 1, W + window - 1, *batch].
        size: length, width and height, cell_dtype [*batch] each, cells; no larger than the bin
            and than the problem's window.
        needed: cell_dtype [*batch], cells of the footprint that must be at the resting height.
        ceiling: cell_dtype [*batch], the height of the bin.

    Returns:
        cell_dtype [L, W, *batch]: z of the item with its corner at (x, y).
    """
    length, width, height = size
    (L, W, _), (window_x, window_y) = problem.bin, problem.window
    if max(problem.window) < LARGE_WINDOW:
        under_x = [(d < length, heights[d : d + L]) for d in range(window_x)]
        z_x, count_x = _highest(under_x, [jnp.ones_like(heights[:L])] * window_x)

        def along_y(z_x: Array, count_x: Array) -> tuple[Array, Array]:
            under_y = [(d < width, z_x[:, d : d + W]) for d in range(window_y)]
            return _highest(under_y, [count_x[:, d : d + W] for d in range(window_y)])

        z, count = z_x[:, :W], count_x[:, :W]
        if window_y > 1:
            z, count = apart((ceiling > -1).all(), along_y, z_x, count_x)
    else:
        rows = _highest_by_doubling(heights, jnp.ones_like(heights), length, window_x, axis=0)
        z_x, count_x = (row[:L] for row in rows)
        columns = _highest_by_doubling(z_x, count_x, width, window_y, axis=1)
        z, count = (column[:, :W] for column in columns)
    # `ceiling - height` cannot overflow, `z + height` on a wall would.
    allowed = (z <= ceiling - height) & (count >= needed)
    return jnp.where(allowed, z, np.iinfo(heights.dtype).max)


def lowest(problem: Problem, z: Array) -> tuple[Triple, Array]:
    """The paper's choice among allowed positions: minimum z, then y, then x (section II.C).

    Args:
        z: cell_dtype [L, W, *batch] from `rest`.

    Returns:
        ((x, y, z), fits): cell_dtype [*batch] each and bool [*batch]; the corner means nothing
        where the item does not fit.
    """
    L, W, _ = problem.bin
    x, y = _coordinates(problem, z.ndim - 2)
    place = (y[:, :W] * L + x[:L]).astype(z.dtype)
    best, first = least_first((z, place), None, lambda key: key.min((0, 1)))
    return (first % L, first // L, best), best < np.iinfo(z.dtype).max


def drop(problem: Problem, heights: Array, size: Triple, corner: Triple, fits: Array) -> Array:
    """The height maps after an item of `size` has come to rest at `corner`, where it fits."""
    length, width, height = size
    x, y, z = corner
    column, row = _coordinates(problem, heights.ndim - 2)
    covered = (column >= x) & (column < x + length) & (row >= y) & (row < y + width)
    return jnp.where(covered & fits, z + height, heights)


def higher(z: Array, count: Array, other: Array, other_count: Array) -> tuple[Array, Array]:
    """(maximum, cells that reach it) of two parts of a footprint."""
    top = jnp.maximum(z, other)
    reached = jnp.where(z == top, count, 0) + jnp.where(other == top, other_count, 0)
    return top, reached


def _highest_by_doubling(
    z: Array, count: Array, length: Array, window: int, axis: int
) -> tuple[Array, Array]:
    """(maximum, cells that reach it) over the next `length` cells along an axis, at every cell.

    A block of 2 size cells is two of `size`; a length is the blocks of its binary digits, the
    small ones last, and a batch member takes those that it needs. A loop, since XLA fuses what is
    written out and then makes every block anew for each cell that uses it.

    Args:
        z, count: cell_dtype [X, Y, *batch]; the parts to put together.
        length: cell_dtype [*batch], up to `window`.
    """
    digits, cells = window.bit_length(), z.shape[axis]
    padding = [(0, 1 << (digits - 1) if at == axis else 0) for at in range(z.ndim)]

    def ahead(values: Array, size: Array) -> Array:
        # What comes in at the end lies outside the map: nobody asks for it.
        return jax.lax.dynamic_slice_in_dim(jnp.pad(values, padding), size, cells, axis)

    def double(digit: Array, blocks: tuple[Array, ...]) -> tuple[Array, ...]:
        done, reached, z, count = blocks
        size = jnp.left_shift(jnp.int32(1), digit)
        longer = higher(z, count, ahead(done, size), ahead(reached, size))
        takes = (length.astype(jnp.int32) & size) > 0
        done, reached = (
            jnp.where(takes, new, old) for new, old in zip(longer, (done, reached), strict=True)
        )
        return done, reached, *higher(z, count, ahead(z, size), ahead(count, size))

    nothing = jnp.full_like(z, -1), jnp.zeros_like(count)
    done, reached, *_ = jax.lax.fori_loop(0, digits, double, (*nothing, z, count))
    return done, reached


def _coordinates(problem: Problem, batch_axes: int) -> tuple[Array, Array]:
    (L, W, _), (window_x, window_y) = problem.bin, problem.window
    dtype = cell_dtype(problem)
    tail = (1,) * batch_axes
    x = jnp.arange(L + window_x - 1, dtype=dtype).reshape(-1, 1, *tail)
    y = jnp.arange(W + window_y - 1, dtype=dtype).reshape(1, -1, *tail)
    return x, y


def _highest(cells: list[tuple[Array, Array]], weights: list[Array]) -> tuple[Array, Array]:
    """Maximum over the cells that count, and the summed weight of those that reach it."""
    z = cells[0][1]
    for counts, height in cells[1:]:
        z = jnp.maximum(z, jnp.where(counts, height, -1))
    reached = jnp.zeros_like(z)
    for (counts, height), weight in zip(cells, weights, strict=True):
        reached += jnp.where(counts & (height == z), weight, 0)
    return z, reached
