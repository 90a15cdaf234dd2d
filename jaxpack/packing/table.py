"""Where would every footprint come to rest? One pass over the distinct footprints.

The height of an item only decides whether it stays under the bin's ceiling: where it comes to rest
depends on its footprint alone. A table over the footprints up to `Problem.window` therefore
holds the candidate placements of all items, and neighbours in it share their work: the highest
cell under a footprint one cell longer needs one more comparison, not a new pass.

Footprint (l, w) has row (l - 1) * window width + w - 1; F is the number of footprints.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.errors import UserError
from jaxpack.model.problem import Problem
from jaxpack.packing.height_map import (
    Cells,
    cell_dtype,
    drop,
    empty_map,
    higher,
    lowest,
    rest,
)
from jaxpack.packing.rules import RULES
from jaxpack.packing.surface import Triple
from jaxpack.packing.view import LEVELS, Candidates, Outline, Places, Surroundings

OF_FOOTPRINTS = ("nearest-corner", "far-corner", "least-wasted")
"""Position rules that do not ask how high an item is."""


class Rests(NamedTuple):
    """The placement that the rule gives each footprint in one bin, any height allowed."""

    x: Array  # cell_dtype [F, *batch], cells
    y: Array  # cell_dtype [F, *batch]
    z: Array  # cell_dtype [F, *batch], the wall's height where there is no supported position
    supported: Array  # cell_dtype [F, *batch], cells of the footprint at height z


class Chart(NamedTuple):
    """A height map and what was found out about it."""

    heights: Array  # cell_dtype [L + window - 1, W + window - 1, B], with walls
    at: tuple[Rests, ...]  # by the rules of the table


@dataclass(frozen=True)
class Table:
    """The view of bins in cells, whose first rule is the paper's: see `jaxpack.packing.view`.

    Raises:
        UserError: where a rule is none of `OF_FOOTPRINTS`.
    """

    problem: Problem  # the rules
    # One footprint after the other, by one rule: slower, and compiled in half the time.
    rolled: bool = False
    more: tuple[str, ...] = ()  # names of further position rules, of `OF_FOOTPRINTS`
    lanes = 64  # what a network holds of them stays in a core's cache

    def __post_init__(self) -> None:
        for name in self.more:
            if name not in OF_FOOTPRINTS:
                raise UserError(f"more '{name}': choose {', '.join(OF_FOOTPRINTS)}")

    @property
    def rules(self) -> int:
        """The paper's, and more."""
        return 1 + len(self.more)

    @property
    def dtype(self) -> np.dtype:
        """See `cell_dtype`."""
        return cell_dtype(self.problem)

    @property
    def cells(self) -> tuple[int, int, int]:
        """Those of the height map."""
        return self.problem.bin

    def largest(self, bins: Array) -> Array:
        """The table's end is one too."""
        return jnp.minimum(bins, jnp.asarray([*self.problem.window, self.problem.bin[2]])[:, None])

    def empty(self, bins: Array) -> Chart:
        """Everything rests in the corner, on the floor."""
        heights = empty_map(self.problem, bins)
        area = jnp.asarray(footprints(self.problem).prod(-1), heights.dtype)[:, None]
        nothing = jnp.zeros((len(area), bins.shape[-1]), heights.dtype)
        corner = Rests(nothing, nothing, nothing, nothing + area)
        if not self.more:
            return Chart(heights, (corner,))
        return Chart(heights, self._rests(heights, bins))

    def corners(self, state: Chart, bins: Array, sides: Triple) -> tuple[Triple, Array]:
        """Read off the table."""
        row = self._row(sides)
        x, y, z = (jnp.take_along_axis(column, row, 0) for column in state.at[0][:3])
        return (x, y, z), z <= bins[2].astype(z.dtype) - sides[2]

    def look(self, state: Chart, bins: Array, sides: Triple, rule: int = 0) -> Candidates:
        """One gather of whole rows of the table instead of one per column."""
        at = state.at[rule]
        around = surroundings(self.problem, state.heights, bins, at)
        columns = [column.astype(around.under.dtype) for column in (*at, *around)]
        row = self._row(sides)
        rows = jnp.take_along_axis(jnp.stack(columns, -1), row[..., None], 0)
        x, y, z, supported, *beside = (rows[..., column] for column in range(rows.shape[-1]))
        x, y, z = (place.astype(self.dtype) for place in (x, y, z))
        # Of what rests nowhere this is beyond the type, and then the floor's.
        top = jnp.clip((z + sides[2]).astype(jnp.int32), 0, self.problem.bin[2])
        cells_at = _histogram(self._inside(state), self.problem.bin[2] + 1)
        level = jnp.take_along_axis(cells_at, top, 0)
        fits = z <= bins[2].astype(z.dtype) - sides[2]
        return Candidates(fits, (x, y, z), supported, level, Surroundings._make(beside))

    def outline(self, state: Chart, bins: Array) -> Outline:
        """Walls are above every level."""
        inside = self._inside(state)
        heights = jnp.where(inside == np.iinfo(inside.dtype).max, 0, inside)
        levels = inside.astype(jnp.int32) * LEVELS // bins[2]
        return Outline(
            heights.max((0, 1)), heights.sum((0, 1), dtype=jnp.int32), _histogram(levels, LEVELS)
        )

    def places(self, state: Chart, bins: Array, size: Triple) -> Places:
        """Every cell."""
        (L, W, _), dtype = self.problem.bin, self.dtype
        needed = self.problem.cells_needed(size[0].astype(jnp.int32) * size[1]).astype(dtype)
        z = rest(self.problem, state.heights, size, needed, bins[2].astype(dtype))
        x, y = jnp.arange(L, dtype=dtype), jnp.arange(W, dtype=dtype)
        return Places(x[:, None, None], y[None, :, None], z, z < np.iinfo(dtype).max)

    def place(self, state: Chart, bins: Array, size: Triple, corner: Triple, fits: Array) -> Chart:
        """A new table."""
        heights = drop(self.problem, state.heights, size, corner, fits)
        return Chart(heights, self._rests(heights, bins))

    def _rests(self, heights: Array, bins: Array) -> tuple[Rests, ...]:
        if self.rolled and not self.more:
            return (rests_in_a_loop(self.problem, heights),)
        return rests(self.problem, heights, bins, self.more)

    def _row(self, sides: Triple) -> Array:
        row = (sides[0].astype(jnp.int32) - 1) * self.problem.window[1] + sides[1] - 1
        return jnp.maximum(row, 0)

    def _inside(self, state: Chart) -> Array:
        return state.heights[: self.problem.bin[0], : self.problem.bin[1]]


def footprints(problem: Problem) -> np.ndarray:
    """(length, width) of every row of the table: int [F, 2]."""
    window_x, window_y = problem.window
    grid = np.meshgrid(np.arange(1, window_x + 1), np.arange(1, window_y + 1), indexing="ij")
    return np.stack(grid, -1).reshape(-1, 2)


def rests(
    problem: Problem, heights: Array, bins: Array, more: tuple[str, ...] = ()
) -> tuple[Rests, ...]:
    """The placement of every footprint by the paper's rule, and by each of some more.

    Args:
        heights: cell_dtype [L + window - 1, W + window - 1, *batch], height maps with walls.
        bins: int32 [3, *batch], cells.
        more: names of rules.
    """
    (L, W, _), (window_x, window_y) = problem.bin, problem.window
    columns = []
    z_x, count_x = heights[:L], jnp.ones_like(heights[:L])
    for length in range(1, window_x + 1):
        if length > 1:
            beside = heights[length - 1 : length - 1 + L]
            z_x, count_x = higher(z_x, count_x, beside, jnp.ones_like(beside))
        z, count = z_x[:, :W], count_x[:, :W]
        for width in range(1, window_y + 1):
            if width > 1:
                rows = slice(width - 1, width - 1 + W)
                z, count = higher(z, count, z_x[:, rows], count_x[:, rows])
            columns.append((z, count))
    z, count = (jnp.stack(column, 2) for column in zip(*columns, strict=True))  # [L, W, F, *batch]
    area = jnp.asarray(footprints(problem).prod(-1), jnp.int32)
    needed = problem.cells_needed(area).astype(heights.dtype).reshape(-1, *(1,) * (z.ndim - 3))
    z = jnp.where(count >= needed, z, np.iinfo(z.dtype).max)
    place_x = jnp.arange(L, dtype=z.dtype).reshape(-1, 1, *(1,) * (z.ndim - 2))
    place_y = jnp.arange(W, dtype=z.dtype).reshape(1, -1, *(1,) * (z.ndim - 2))

    def rested(corner: Triple) -> Rests:
        x, y, lowest = corner
        here = (place_x == x) & (place_y == y)
        return Rests(x, y, lowest, jnp.where(here, count, 0).max((0, 1)))

    found = [rested(lowest(problem, z)[0])]
    if more:
        along_x, along_y = (jnp.asarray(side, z.dtype)[:, None] for side in footprints(problem).T)
        size, (room_x, room_y, ceiling) = (along_x, along_y, 0 * along_x), bins.astype(z.dtype)
        at = Footprints(problem, heights, z, size, (room_x, room_y, ceiling))
        found += [rested(at.first(RULES[name])[0]) for name in more]
    return tuple(found)


class Footprints(Cells):
    """The positions of all footprints at once: z is [L, W, F, *batch]."""

    def waste(self) -> Array:
        """From sums of the height map up to every cell."""
        (L, W, _), wall = self.problem.bin, np.iinfo(self.heights.dtype).max
        solid = jnp.where(self.heights == wall, 0, self.heights.astype(jnp.int32))
        sums = jnp.pad(solid.cumsum(0).cumsum(1), ((1, 0), (1, 0), *((0, 0),) * (solid.ndim - 2)))
        under = []
        for length, width in footprints(self.problem):
            near, far = sums[:L], sums[length : length + L]
            under.append(far[:, width : width + W] - far[:, :W] - near[:, width : width + W])
            under[-1] += near[:, :W]
        area = self.size[0].astype(jnp.int32) * self.size[1]
        return (self.z.astype(jnp.int32) * area - jnp.stack(under, 2)).astype(jnp.float32)


def rests_in_a_loop(problem: Problem, heights: Array) -> Rests:
    """The same, of one footprint after the other."""
    (L, W, _), dtype = problem.bin, heights.dtype
    ones = jnp.ones((L, *heights.shape[1:]), dtype)
    lengths, widths = (jnp.arange(side, dtype=jnp.int32) for side in problem.window)
    X, Y = (jnp.arange(side, dtype=dtype) for side in (L, W))

    def longer(before: tuple[Array, Array], length: Array) -> tuple[tuple[Array, Array], Rests]:
        beside = jax.lax.dynamic_slice_in_dim(heights, length, L)
        strip = higher(*before, beside, ones)

        def wider(before: tuple[Array, Array], width: Array) -> tuple[tuple[Array, Array], Rests]:
            rows = (jax.lax.dynamic_slice_in_dim(leaf, width, W, 1) for leaf in strip)
            z, count = higher(*before, *rows)
            needed = problem.cells_needed((length + 1) * (width + 1)).astype(dtype)
            (x, y, best), _ = lowest(problem, jnp.where(count >= needed, z, np.iinfo(dtype).max))
            here = (X.reshape(-1, *(1,) * (z.ndim - 1)) == x) & (
                Y.reshape(-1, *(1,) * (z.ndim - 2)) == y
            )
            return (z, count), Rests(x, y, best, jnp.where(here, count, 0).max((0, 1)))

        nothing = jnp.full_like(ones[:, :W], -1)
        return strip, jax.lax.scan(wider, (nothing, 0 * nothing), widths)[1]

    nothing = jnp.full_like(ones, -1)
    _, found = jax.lax.scan(longer, (nothing, 0 * nothing), lengths)
    return Rests(*(leaf.reshape(-1, *leaf.shape[2:]) for leaf in found))


def surroundings(problem: Problem, heights: Array, bins: Array, at: Rests) -> Surroundings:
    """What lies under and beside every footprint where it rests.

    Args:
        heights: cell_dtype [L + window - 1, W + window - 1, *batch].
        bins: int32 [3, *batch], cells.
        at: the placements, from `rests`.
    """
    (L, W, H), batch = problem.bin, heights.shape[2:]
    largest = H * problem.window[0] * problem.window[1]
    dtype = jnp.int16 if largest <= np.iinfo(np.int16).max else jnp.int32
    sides = jnp.asarray(footprints(problem), dtype).reshape(-1, 2, *(1,) * len(batch))
    length, width = sides[:, 0], sides[:, 1]
    bin_x, bin_y, ceiling = bins.astype(dtype)
    inside = heights[:L, :W]
    walled = jnp.where(inside == np.iinfo(heights.dtype).max, ceiling, inside.astype(dtype))
    X = jnp.arange(L, dtype=dtype).reshape(1, -1, *(1,) * len(batch))
    Y = jnp.arange(W, dtype=dtype).reshape(1, -1, *(1,) * len(batch))
    x, y, z = (side.astype(dtype) for side in at[:3])
    end_x, end_y = x + length, y + width
    # Four passes over the map: its sums across the footprint, seen from the side and from the
    # front, and the row and the column through the corner. All else is read off these profiles.
    in_x, in_y = (x[:, None] <= X) & (end_x[:, None] > X), (y[:, None] <= Y) & (end_y[:, None] > Y)
    across = jnp.where(in_y[:, None], walled, 0).sum(2, dtype=dtype)  # [F, L, *batch]
    along = jnp.where(in_x[:, :, None], walled, 0).sum(1, dtype=dtype)  # [F, W, *batch]
    row = jnp.where((y[:, None] == Y)[:, None], walled, 0).sum(2, dtype=dtype)
    column = jnp.where((x[:, None] == X)[:, :, None], walled, 0).sum(1, dtype=dtype)

    def at_cell(profile: Array, cells: Array, cell: Array) -> Array:
        return jnp.where(cells == cell[:, None], profile, 0).sum(1, dtype=dtype)

    def gaps(profile: Array, cells: Array, start: Array, end: Array, limit: Array) -> tuple:
        higher = profile > z[:, None]
        before = jnp.where(higher & (cells < start[:, None]), cells + 1, 0).max(1)
        after = jnp.where(higher & (cells >= end[:, None]), cells, limit).min(1)
        return start - before, after - end

    gap_left, gap_right = gaps(row, X, x, end_x, bin_x)
    gap_front, gap_back = gaps(column, Y, y, end_y, bin_y)
    return Surroundings(
        under=jnp.where(in_x, across, 0).sum(1, dtype=dtype),
        left=jnp.where(x == 0, ceiling * width, at_cell(across, X, x - 1)),
        right=jnp.where(end_x >= bin_x, ceiling * width, at_cell(across, X, end_x)),
        front=jnp.where(y == 0, ceiling * length, at_cell(along, Y, y - 1)),
        back=jnp.where(end_y >= bin_y, ceiling * length, at_cell(along, Y, end_y)),
        gap_left=gap_left,
        gap_right=gap_right,
        gap_front=gap_front,
        gap_back=gap_back,
    )


def _histogram(cells: Array, values: int) -> Array:
    """How many cells [X, Y, B] have each of the values 0, 1, ...: int32 [values, B]."""
    value = jnp.arange(values, dtype=cells.dtype).reshape(-1, 1, 1, 1)
    return (cells == value).sum((1, 2), dtype=jnp.int32)
