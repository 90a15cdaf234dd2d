"""The judge: one function that turns a packing order into a packing.

First fit: an item goes into the first bin that has an allowed position for it. Box by box this
needs one height map at a time: bin 0 reads the whole order and takes what fits when its turn
comes, what it leaves goes to bin 1 in the same order, and so on. The placements are the same.

A turn offers one item to one bin, in every batch member its own: none waits for another's bins.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any

import chex
import jax
import jax.numpy as jnp
from jax import Array
from jax.custom_batching import custom_vmap

from jaxpack.model.problem import Instance, Packing, Problem, in_orientation
from jaxpack.packing.decode import Bins, Items, decode
from jaxpack.packing.env import Decisions
from jaxpack.packing.height_map import LARGE_WINDOW
from jaxpack.packing.rules import rule_named
from jaxpack.packing.surface import Triple
from jaxpack.packing.surface_view import surface_of
from jaxpack.xla.pieces import in_pieces
from jaxpack.xla.programs import least, total, whole
from jaxpack.xla.target import Target, target, traced_for

LANES, FEW_LANES = 128, 4
"""Instances that a CPU packs at once: more, and what they hold leaves the cache. Few with a
window from `LARGE_WINDOW` on."""
VECTOR, SEVERAL = 32, 4
"""Bytes that the processor takes at once: what is left over of a row is done one by one, which
takes longer than a vector more, from several instances on."""


def pack(problem: Problem, instance: Instance, order: Array, place: Array | None = None) -> Packing:
    """Packs the items in the given order, first fit, over as many bins as it takes.

    An item stands at the lowest of its allowed positions, of several at the least y, then x (Wang
    and Dong, section II.C).

    Composes with jit and with vmap over `instance`, `order` or both; vmap costs nothing, the
    kernel underneath is batched. Items that fit no empty bin get bin -1 (`make_instance` refuses
    them, inside jit nothing can).

    Args:
        problem: the static rules.
        instance: one instance of N items, which lie as their sizes are; see `in_orientation`.
        order: int [N], a permutation of 0..N-1; where the padding stands in it is immaterial.
        place: int32 [N], see `Decisions`; None: all items go by the rule.

    Returns:
        Bins, positions and sums over every bin, int32 [N, ...] in cells (or units, of faces).

    Raises:
        AssertionError: where ranks, shapes or dtypes are others; a batch takes `vmap`.
    """
    chex.assert_type([instance.size, instance.bin, order], int)
    chex.assert_shape(instance.bin, (3,))
    chex.assert_shape([instance.mask, order], (len(instance.size),))
    chex.assert_shape(instance.size, (None, 3))
    instance = instance._replace(turned=None)
    if place is not None:
        chex.assert_type(place, int)
        chex.assert_equal_shape([order, place])
        place = place.astype(jnp.int32)
    one = jax.tree.map(lambda leaf: leaf[None], (instance, order.astype(jnp.int32), place))
    packing = _batched(problem, target())(*one)
    return jax.tree.map(lambda leaf: leaf[0], packing)


def pack_decisions(
    problem: Problem, instances: Instance, decisions: Decisions
) -> tuple[Instance, Packing]:
    """The instances with every item turned as decided, and how they are packed: leaves [B, ...].

    Args:
        problem: the static rules.
        instances: leaves [B, ...].
        decisions: leaves [B, N].
    """
    turned = jax.vmap(in_orientation)(instances, decisions.orientation)
    return turned, jax.vmap(partial(pack, problem))(turned, decisions.order, decisions.place)


@cache
def _batched(problem: Problem, made_for: Target) -> Callable[..., Packing]:
    """A packer of batches (leaves [B, ...]) in which a vmap becomes a larger B, not a new axis."""

    @custom_vmap
    def packer(instance: Instance, order: Array, place: Array | None) -> Packing:
        with traced_for(made_for):
            return _in_pieces(problem, instance, order, place)

    @packer.def_vmap
    def _(size: int, batched: tuple, *leaves: Any):  # type: ignore[no-untyped-def]
        def merge(leaf: Array, has_axis: bool) -> Array:
            leaf = leaf if has_axis else jnp.broadcast_to(leaf, (size, *leaf.shape))
            return leaf.reshape(-1, *leaf.shape[2:])

        packing = packer(*jax.tree.map(merge, leaves, tuple(batched)))
        split = jax.tree.map(lambda leaf: leaf.reshape(size, -1, *leaf.shape[1:]), packing)
        return split, jax.tree.map(lambda _: True, packing)

    # Compiled once per problem, target and shape, also where the caller does not jit.
    return jax.jit(packer)


def _in_pieces(problem: Problem, instance: Instance, order: Array, place: Array | None) -> Packing:
    """`pack` over a batch (leaves [B, ...]), on a CPU piece by piece."""
    batch = order.shape[0]
    if not target().cpu or batch < SEVERAL:
        return _first_fit(problem, instance, order, place)
    most, vector = LANES, VECTOR // surface_of(problem).dtype.itemsize
    if problem.surface == "cells" and max(problem.window) >= LARGE_WINDOW:
        most, vector = FEW_LANES, 1
    size = -(-batch // -(-batch // most))
    size = -(-size // vector) * vector
    if problem.surface == "cells":
        return in_pieces(lambda piece: _first_fit(problem, *piece), (instance, order, place), size)
    # Those of the fewest items first: a piece takes as long as the longest of its members.
    rank = jnp.argsort(instance.mask.sum(1))
    ranked = jax.tree.map(lambda leaf: leaf[rank], (instance, order, place))
    packed = in_pieces(lambda piece: _first_fit(problem, *piece), ranked, size)
    return jax.tree.map(lambda leaf: jnp.zeros_like(leaf).at[rank].set(leaf), packed)


def _first_fit(problem: Problem, instance: Instance, order: Array, place: Array | None) -> Packing:
    """One piece. Inside, batches are last: see `height_map`."""
    surface = surface_of(problem)
    dtype = surface.dtype
    # Items larger than the bin or the kernel's window never fit, and their sides may not survive
    # the narrow type below.
    limit = jnp.minimum(instance.bin, jnp.asarray([*problem.window, problem.bin[2]]))
    able = (instance.mask & (instance.size <= limit[:, None]).all(-1)).T
    sizes = instance.size.transpose(2, 1, 0)
    needed = problem.cells_needed(sizes[0] * sizes[1])
    if problem.surface == "cells":
        needed = needed.astype(dtype)
    length, width, height = sizes.astype(dtype)
    sides = length, width, height
    room = instance.bin.T.astype(dtype)
    bins = Bins((room[0], room[1], room[2]))
    items = Items(sides, needed, able, place=None if place is None else place.T)
    packer = partial(decode, surface, rule_named(problem.rule))
    placed = whole((instance.bin > 0).all(), packer, items, bins, order.T)
    stats = _stats_by_bin(problem, placed.bin, placed.corner, sides, bins.size)
    position = jnp.stack([place.T.astype(jnp.int32) for place in placed.corner], -1)
    return Packing(placed.bin.T.astype(jnp.int32), position, *stats.transpose(1, 2, 0))


def _stats_by_bin(
    problem: Problem, bin: Array, corner: Triple, sides: Triple, room: Triple
) -> Array:
    """Volume, highest point and sum of the height map of every bin slot: int32 [N, 3, B].

    Apart from the loop that packs, so that who wants placements only does not pay for it.

    Args:
        bin, corner, sides: integers [N, B] by item.
        room: [B], the bins' sides.
    """
    (L, W, _), faces = problem.bin, problem.surface == "faces"
    N, batch = bin.shape
    dtype = sides[0].dtype
    if not faces:
        x = jnp.arange(L, dtype=dtype)[:, None, None]
        y = jnp.arange(W, dtype=dtype)[:, None]
    ends = tuple(at + side for at, side in zip(corner, sides, strict=True))
    volume = math.prod(side.astype(jnp.int32) for side in sides)
    top = ends[2].astype(jnp.int32)

    def stats_of(slot: Array, stats: Array) -> Array:
        inside = bin == slot

        def raised(item: Array, heights: Array) -> Array:
            over_x = (corner[0][item] <= x) & (x < ends[0][item])
            over_y = (corner[1][item] <= y) & (y < ends[1][item])
            return jnp.maximum(heights, jnp.where(inside[item] & over_x & over_y, ends[2][item], 0))

        if not faces:
            heights = jax.lax.fori_loop(0, N, raised, jnp.zeros((L, W, batch), dtype))
        found = (
            total(jnp.where(inside, volume, 0), 1),
            -least(jnp.where(inside, -top, 0), 1),
            _shadow(W == 1, inside, corner, ends, room)
            if faces
            else total(heights.astype(jnp.int32), 2),
        )
        return stats.at[slot].set(jnp.stack(found))

    nothing = jnp.zeros((N, 3, batch), jnp.int32)
    # A scatter takes one number after the other; a slot at a time takes all lanes.
    return jax.lax.fori_loop(0, bin.max().astype(jnp.int32) + 1, stats_of, nothing)


def _shadow(
    flat: bool, inside: Array, corner: Triple, ends: Sequence[Array], room: Triple
) -> Array:
    """Sum of the height map of bins without cells: int32 [B].

    The map may change where an item ends, since others begin there. Such lines are looked at one by
    one along x, as many as there are in the bin of which most is to be seen.

    Args:
        flat: 2D.
        inside: bool [N, B], what lies in them.
        corner, ends: integers [N, B] by item, near and far edges.
        room: [B], the bins' sides.
    """

    def lines(axis: int) -> tuple[Array, Array]:
        """[N + 1, B], ascending, and how far it is to the next; at the wall where none is left."""
        far = jnp.where(inside, ends[axis], room[axis])
        line = jnp.sort(jnp.concatenate([jnp.zeros_like(far[:1]), far]), 0)
        following = jnp.concatenate([line[1:], room[axis][None]])
        return line, (following - line).astype(jnp.int32)

    (x, length), (y, width) = lines(0), lines(1)
    if flat:
        y, width = y[:1], width[:1]
    number = jax.lax.broadcasted_iota(jnp.int32, inside.shape, 0)
    items = jnp.where(inside, number + 1, 0).max()

    def strip(n: Array, sums: Array) -> Array:
        def raised(item: Array, heights: Array) -> Array:
            over_x = inside[item] & (corner[0][item] <= x[n]) & (x[n] < ends[0][item])
            over_y = (corner[1][item] <= y) & (y < ends[1][item])
            return jnp.maximum(heights, jnp.where(over_x & over_y, ends[2][item], 0))

        heights = jax.lax.fori_loop(0, items, raised, jnp.zeros_like(y))
        return sums + (heights.astype(jnp.int32) * width).sum(0) * length[n]

    return jax.lax.fori_loop(0, inside.sum(0).max() + 1, strip, jnp.zeros_like(length[0]))
