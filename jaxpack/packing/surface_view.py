"""The view of any surface: a bin as blocks between lines, each of one height.

What a policy sees of a grid it sees of bins in millimetres too, see `Problem.surface`. Where an
item would stand the surface says, row by row, whatever the position rule; what lies there is read
off the blocks: rows times blocks a look.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.model.problem import Problem, area_needed
from jaxpack.packing.height_map import HeightMap
from jaxpack.packing.rules import RULES, Rule
from jaxpack.packing.rules.lowest import lowest
from jaxpack.packing.surface import Surface, Triple
from jaxpack.packing.table import OF_FOOTPRINTS, Table
from jaxpack.packing.top_faces import Faces, TopFaces, stand_firm
from jaxpack.packing.view import LEVELS, Candidates, Outline, Places, Surroundings, View


class Blocks(NamedTuple):
    """What lies in a bin: the block [i, j] reaches from near_x[i] to far_x[i], near_y[j] to ...

    Blocks of no length are none.
    """

    near_x: Array  # int32 [X, B]
    far_x: Array
    near_y: Array  # int32 [Y, B]
    far_y: Array
    height: Array  # int32 [X, Y, B]


def blocks_of_cells(heights: Array, bins: Array) -> Blocks:
    """Of a height map: see `HeightMap`."""
    edges = []
    for axis in (0, 1):
        near = jnp.arange(heights.shape[axis], dtype=jnp.int32)[:, None]
        edges += [jnp.minimum(near, bins[axis]), jnp.minimum(near + 1, bins[axis])]
    return Blocks._make((*edges, heights.astype(jnp.int32)))


def blocks_of_faces(faces: Faces, bins: Array) -> Blocks:
    """Between lines: see `TopFaces`. They stand in the order in which they came."""
    edges = []
    for lines, side in ((faces.x, bins[0]), (faces.y, bins[1])):
        near = jnp.minimum(lines.astype(jnp.int32), side)
        following = jnp.where(near[None] > near[:, None], near[None], side)
        edges += [near, following.min(1)]
    return Blocks._make((*edges, faces.heights.astype(jnp.int32)))


@dataclass(frozen=True)
class SurfaceView:
    """The view of a surface: see `jaxpack.packing.view`."""

    surface: Surface
    blocks: Callable[[Any, Array], Blocks]  # (state, bins) -> what lies in them
    support: float = 0.5  # share of a base that must rest at its own height
    inclusive: bool = True  # whether exactly that share is enough
    rule: Rule = lowest
    more: tuple[Rule, ...] = ()  # further ones to choose among
    stands: Callable[[Any, Triple, Triple], Array] | None = None
    """(state, positions, sides) -> which of these are allowed, beyond their support."""
    lanes: int = 1  # rows and blocks of one instance fill a core's cache
    cells = None

    @property
    def rules(self) -> int:
        """One, and more."""
        return 1 + len(self.more)

    @property
    def dtype(self) -> np.dtype:
        """The surface's."""
        return self.surface.dtype

    def largest(self, bins: Array) -> Array:
        """As large as the bin."""
        return bins

    def empty(self, bins: Array) -> Any:
        """The surface's."""
        return self.surface.empty(self._room(bins))

    def corners(
        self, state: Any, bins: Array, sides: Triple, rule: int = 0
    ) -> tuple[Triple, Array]:
        """Row by row."""
        room, preferred = self._room(bins), (self.rule, *self.more)[rule]

        def corner(size: Triple) -> Triple:
            wanted = size[0] > 0  # or else it is padding
            # How high an item is changes nothing of the lowest position but whether it fits.
            flat = (size[0], size[1], jnp.zeros_like(size[2]))
            shown = flat if preferred is lowest else size
            found, _ = self.surface.candidates(state, shown, self._needed(size), room, wanted)
            (x, y, z), fits = found.first(preferred)
            nowhere = np.iinfo(z.dtype).max
            return jnp.where(fits, x, 0), jnp.where(fits, y, 0), jnp.where(fits, z, nowhere)

        x, y, z = jax.lax.map(corner, sides)
        return (x, y, z), z <= room[2] - sides[2]

    def look(self, state: Any, bins: Array, sides: Triple, rule: int = 0) -> Candidates:
        """What lies where the items of the rows would stand."""
        corner, fits = self.corners(state, bins, sides, rule)
        blocks = self.blocks(state, bins)
        x, y, z = (place.astype(jnp.int32) for place in corner)
        far_x, far_y = x + sides[0], y + sides[1]
        over_x = _overlap(blocks.near_x, blocks.far_x, x[:, None], far_x[:, None])
        over_y = _overlap(blocks.near_y, blocks.far_y, y[:, None], far_y[:, None])
        under = (over_x > 0)[:, :, None] & (over_y > 0)[:, None]
        top_under = jnp.where(under, blocks.height, 0).max((1, 2))
        level = jnp.clip((corner[2] + sides[2]).astype(jnp.int32), 0, bins[2])
        base = over_x[:, :, None] * over_y[:, None]
        around = self._around(blocks, bins, (x, y, z), (far_x, far_y), (over_x, over_y))
        return Candidates(
            fits=fits,
            corner=corner,
            supported=_sum(base, blocks.height == top_under[:, None, None]),
            level=_sum(self._areas(blocks), blocks.height == level[:, None, None]),
            around=around._replace(under=_sum(base, blocks.height)),
        )

    def _around(
        self,
        blocks: Blocks,
        bins: Array,
        corner: Triple,
        far: tuple[Array, Array],
        over: tuple[Array, Array],
    ) -> Surroundings:
        """All but what is under."""
        z = corner[2][:, None]
        height = blocks.height.astype(jnp.float32)
        beside, gaps = [], []
        for axis in (0, 1):
            near_edge, far_edge = (blocks.near_x, blocks.far_x) if axis == 0 else blocks[2:4]
            across = blocks[2:4] if axis == 0 else blocks[:2]
            start, end = corner[axis][:, None], far[axis][:, None]
            # The block just before the item, and just behind it; the walls have none.
            before = (near_edge < start) & (start <= far_edge)
            behind = (near_edge <= end) & (end < far_edge)
            strip = over[1 - axis]  # [K, across, B]
            map_ = height if axis == 0 else height.swapaxes(0, 1)
            profile = jnp.einsum("kyb,xyb->kxb", strip, map_, precision="highest")
            wall = bins[2].astype(jnp.float32) * strip.sum(1)
            for at, is_wall in ((before, start <= 0), (behind, end >= bins[axis])):
                there = jnp.where(at & (near_edge < far_edge), profile, 0).sum(1)
                beside.append(jnp.where(is_wall[:, 0], wall, there))
            # Along the row or column of the corner, whatever is higher than where the item rests.
            first = corner[1 - axis][:, None]
            line = (across[0] <= first) & (first < across[1])
            ints = blocks.height if axis == 0 else blocks.height.swapaxes(0, 1)
            along = jnp.where(line[:, None], ints, 0).max(2)
            higher = (along > z) & (near_edge < far_edge)
            limit = jnp.where(higher & (near_edge < start), far_edge, 0).max(1)
            gaps.append(corner[axis] - limit)
            limit = jnp.where(higher & (near_edge >= end), near_edge, bins[axis]).min(1)
            gaps.append(limit - far[axis])
        return Surroundings(jnp.zeros_like(beside[0]), *beside, *gaps)

    def outline(self, state: Any, bins: Array) -> Outline:
        """Summed over blocks."""
        blocks = self.blocks(state, bins)
        areas = self._areas(blocks)
        there = areas > 0
        level = jnp.where(there, blocks.height * LEVELS // bins[2], LEVELS)
        levels = [jnp.where(level == one, areas, 0).sum((0, 1)) for one in range(LEVELS)]
        return Outline(
            jnp.where(there, blocks.height, 0).max((0, 1)),
            (areas * jnp.where(there, blocks.height, 0)).sum((0, 1)),
            jnp.stack(levels),
        )

    def places(self, state: Any, bins: Array, size: Triple) -> Places:
        """At the near edges of all blocks."""
        blocks, needed = self.blocks(state, bins), self._needed(size)
        x, y = blocks.near_x, blocks.near_y
        over_x = _overlap(blocks.near_x, blocks.far_x, x[:, None], x[:, None] + size[0])
        over_y = _overlap(blocks.near_y, blocks.far_y, y[:, None], y[:, None] + size[1])

        def along_y(over_x: Array) -> tuple[Array, Array]:
            """(resting height, area that lies there), int32 [Y, B], of the corners with one x."""
            base = over_x[None, :, None] * over_y[:, None]  # [Y, X, Y, B]
            z = jnp.where(base > 0, blocks.height, 0).max((1, 2))
            return z, _sum(base, blocks.height == z[:, None, None])

        z, area = jax.lax.map(along_y, over_x)
        inside = (x + size[0] <= bins[0])[:, None] & (y + size[1] <= bins[1])
        room = (blocks.near_x < blocks.far_x)[:, None] & (blocks.near_y < blocks.far_y)
        allowed = inside & room & (z + size[2] <= bins[2]) & (area >= needed)
        if self.stands:
            allowed &= self.stands(state, (x[:, None], y[None], z), size)
        return Places(x[:, None], y[None], z.astype(self.dtype), allowed)

    def place(self, state: Any, bins: Array, size: Triple, corner: Triple, fits: Array) -> Any:
        """The surface's."""
        never = jnp.zeros_like(fits)
        return self.surface.place(state, size, corner, fits, self._room(bins), never)

    def _room(self, bins: Array) -> Triple:
        x, y, z = bins.astype(self.dtype)
        return x, y, z

    def _needed(self, size: Triple) -> Array:
        area = size[0].astype(jnp.int32) * size[1].astype(jnp.int32)
        return area_needed(self.support, self.inclusive, area)

    def _areas(self, blocks: Blocks) -> Array:
        """Of every block: float32 [X, Y, B]."""
        length, width = blocks.far_x - blocks.near_x, blocks.far_y - blocks.near_y
        return length.astype(jnp.float32)[:, None] * width.astype(jnp.float32)


def view_of(problem: Problem, more: tuple[str, ...] = ()) -> View:
    """The view of the problem's bins: of cells the table where it knows the rules.

    Args:
        more: names of further position rules to choose among.
    """
    faces, rules = problem.surface == "faces", (problem.support, problem.inclusive)
    if problem.rule == "lowest" and not faces and set(more) <= set(OF_FOOTPRINTS):
        return Table(problem, more=more)
    blocks = blocks_of_faces if faces else blocks_of_cells
    stands = stand_firm if problem.stability == "centre" else None
    rule, *others = (RULES[name] for name in (problem.rule, *more))
    return SurfaceView(surface_of(problem), blocks, *rules, rule, tuple(others), stands)


def surface_of(problem: Problem) -> Surface:
    """What the problem's bins look like from above."""
    if problem.surface == "cells":
        return HeightMap(problem)
    assert problem.most is not None
    # Lengths of 32 bits would have to be traced with x64 enabled.
    firm = problem.stability == "centre"
    return TopFaces(problem.most, problem.bin[1] == 1, short=True, firm=firm)


def _overlap(near: Array, far: Array, start: Array, end: Array) -> Array:
    """How long two stretches run side by side: float32."""
    return jnp.maximum(jnp.minimum(end, far) - jnp.maximum(start, near), 0).astype(jnp.float32)


def _sum(areas: Array, factor: Array) -> Array:
    """Over all blocks: float32 [K, B] of [(K,) X, Y, B] each."""
    return (areas * factor).sum((-3, -2))
