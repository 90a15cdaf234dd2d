"""The judge without a grid: first fit over bins of several sizes, with a limit on their weight."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.packing.height_map import Triple
from jaxpack.packing.top_faces import (
    Edges,
    Faces,
    add_edge,
    first_edges,
    lowest_corner,
    no_edges,
    no_faces,
    put_on,
    rest_on,
)

STAGES = (4, 8, 16, 32, 64, 128, 256, 512)
"""A bin with so many candidates an axis or fewer costs what one with exactly so many does."""
ROUNDING = 2.0**-22  # of one sum of volumes in float32, which are rounded


@dataclass(frozen=True)
class ExactRules:
    """What stays fixed while a program runs: hashable, a static argument of ``jit``."""

    most: int  # M, items that a bin can hold
    flat: bool = False  # 2D: nothing ever lies behind anything


class Items(NamedTuple):
    """Items in packing order, turned as they are to be packed; a trailing batch axis."""

    size: Array  # int32 [N, 3, B], units: along x, y and z
    needed: Array  # int32 or int64 [N, B], area of the footprint that must be carried
    weight: Array  # int32 or int64 [N, B], units of weight
    waiting: Array  # bool [N, B], False for what is not to be packed


class Bins(NamedTuple):
    """The bins in the order in which they are filled."""

    size: Array  # int32 [S, 3, B], units
    limit: Array  # [S, B], units of weight, of the type of `Items.weight`; its largest: no limit
    step: Array  # int32[], units: corners along x and y are multiples of it


class Layout(NamedTuple):
    """Where every item went."""

    bin: Array  # int32 [N, B], index of the bin; -1 for what was not packed
    corner: Array  # int32 [N, 3, B], units


class _Open(NamedTuple):
    """The bin that each batch member is filling."""

    slot: Array  # int32 [B]
    next: Array  # int32 [B], the items before this one have been offered
    faces: Faces
    x: Edges
    y: Edges
    weight: Array  # int32 or int64 [B], that may still be loaded
    volume: Array  # float32 [B], that is still free
    shut: Array  # bool [N, B], like what was refused since the last came in, or higher


def pack_exact(rules: ExactRules, items: Items, bins: Bins) -> Layout:
    """Packs the items in their order, first fit, over the bins in theirs.

    A turn offers one item to one bin, in every batch member to its own. Items that are too
    heavy or too large for what is free are passed over without a turn.

    Args:
        rules: what is static.
        items: in packing order.
        bins: in the order in which they are filled.

    Returns:
        The placements; int32 whatever the types of areas and weights.
    """
    # Areas and weights of 64 bits are whole numbers here and nowhere else: all that touches them
    # has to be traced like this. Every other type is written out.
    with jax.enable_x64(True):
        return _pack(rules, items, bins)


def _pack(rules: ExactRules, items: Items, bins: Bins) -> Layout:
    N, _, B = items.size.shape
    S = bins.limit.shape[0]
    lane = jnp.arange(B, dtype=jnp.int32)
    index = jnp.arange(N, dtype=jnp.int32)[:, None]
    unlimited = np.iinfo(bins.limit.dtype).max
    volume = items.size.astype(jnp.float32).prod(1)
    room_volume = bins.size.astype(jnp.float32).prod(1) * np.float32(1 + N * ROUNDING)

    def opened(slot: Array) -> _Open:
        inside = jnp.minimum(slot, S - 1)
        return _Open(
            slot,
            jnp.zeros(B, jnp.int32),
            no_faces(rules.most, B),
            no_edges(rules.most + 1, B),
            no_edges(1 if rules.flat else rules.most + 1, B),
            jnp.where(slot < S, bins.limit[inside, lane], -1),
            jnp.where(slot < S, room_volume[inside, lane], np.float32(0)),
            jnp.zeros((N, B), bool),
        )

    def next_item(current: _Open, waiting: Array) -> Array:
        """int32 [B], N where there is none: the first that may fit and was not offered yet."""
        light = (items.weight <= current.weight) & (volume <= current.volume)
        suited = waiting & light & (index >= current.next) & ~current.shut
        return jnp.where(suited & (current.faces.used < rules.most), index, N).min(0)

    def turn(carry: tuple[_Open, Array, Layout]) -> tuple[_Open, Array, Layout]:
        current, waiting, layout = carry
        item = next_item(current, waiting)
        full = item == N
        fresh = opened(current.slot + 1)
        current = jax.tree.map(lambda new, old: jnp.where(full, new, old), fresh, current)
        item = jnp.where(full, next_item(fresh, waiting), item)
        found, item = item < N, jnp.minimum(item, N - 1)
        sides = items.size[item, :, lane].T
        size = (sides[0], sides[1], sides[2])
        room = bins.size[jnp.minimum(current.slot, S - 1), :, lane].T
        corner, fits = _place(
            rules, current, size, items.needed[item, lane], (room[0], room[1], room[2]), found
        )
        where = jnp.where(fits, item, N)
        like = (items.size[:, :2] == sides[:2]).all(1) & (items.size[:, 2] >= size[2]) & found
        layout = Layout(
            layout.bin.at[where, lane].set(current.slot, mode="drop"),
            layout.corner.at[where, :, lane].set(jnp.stack(corner).T, mode="drop"),
        )
        taken = jnp.where(fits & (current.weight < unlimited), items.weight[item, lane], 0)
        x, y = (-(-(corner[axis] + size[axis]) // bins.step) * bins.step for axis in (0, 1))
        current = current._replace(
            next=jnp.where(found, item + 1, current.next),
            faces=put_on(current.faces, size, corner, fits),
            x=add_edge(current.x, x, fits),
            y=current.y if rules.flat else add_edge(current.y, y, fits),
            weight=current.weight - taken,
            volume=current.volume - jnp.where(fits, volume[item, lane], np.float32(0)),
            shut=(current.shut | like) & ~fits,
        )
        return current, waiting.at[where, lane].set(False, mode="drop"), layout

    def more(carry: tuple[_Open, Array, Layout]) -> Array:
        current, waiting, _ = carry
        return (waiting.any(0) & (current.slot < S)).any()

    nothing = Layout(jnp.full((N, B), -1, jnp.int32), jnp.zeros((N, 3, B), jnp.int32))
    start = (opened(jnp.zeros(B, jnp.int32)), items.waiting, nothing)
    _, _, layout = jax.lax.while_loop(more, turn, start)
    return layout


def _place(
    rules: ExactRules, current: _Open, size: Triple, needed: Array, room: Triple, found: Array
) -> tuple[Triple, Array]:
    """(corner, whether it fits) of the item, looking at few more edges than are in use."""
    faces, x, y = current.faces, current.x, current.y
    faces = faces._replace(used=jnp.where(found, faces.used, 0))
    stages = [stage for stage in STAGES if stage <= rules.most] + [rules.most + 1]

    def among(edges: int) -> Callable[[], tuple[Triple, Array]]:
        def place() -> tuple[Triple, Array]:
            xs, ys = first_edges(x, edges), first_edges(y, edges)
            return lowest_corner(xs, ys, rest_on(faces, xs, ys, size, needed, room))

        return place

    used = jnp.where(found, jnp.maximum(x.used, y.used), 0).max()
    stage = jnp.searchsorted(jnp.asarray(stages, jnp.int32), used).astype(jnp.int32)
    corner, fits = jax.lax.switch(stage, [among(edges) for edges in stages])
    return corner, fits & found
