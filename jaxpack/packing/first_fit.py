"""The judge: one function that turns a packing order into a packing.

First fit: an item goes into the first bin that has an allowed position for it. Box by box this
needs one height map at a time: bin 0 reads the whole order and takes what fits when its turn
comes, what it leaves goes to bin 1 in the same order, and so on. The placements are the same.

A turn offers one item to one bin, in every batch member its own: none waits for another's bins.
"""

import math
from collections.abc import Callable
from functools import cache, partial
from typing import NamedTuple

import chex
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.custom_batching import custom_vmap

from jaxpack.model.problem import Instance, Packing, Problem
from jaxpack.packing.height_map import (
    LARGE_WINDOW,
    Triple,
    cell_dtype,
    drop,
    empty_map,
    lowest,
    rest,
)
from jaxpack.xla.pieces import in_pieces
from jaxpack.xla.programs import least, loops_are_whole, total, whole

LANES, FEW_LANES = 128, 4
"""Instances that a CPU packs at once: more, and what they hold leaves the cache. Few with a
window from `LARGE_WINDOW` on."""
VECTOR, SEVERAL = 32, 4
"""Bytes that the processor takes at once: what is left over of a row is done one by one, which
takes longer than a vector more, from several instances on."""

MANY_ITEMS = 128
"""From so many on, a turn less for what would be refused is worth looking for it."""

TURNS = 4
"""On a GPU, between two looks whether an item is left: the host has to wait for what it sees."""


class _Turn(NamedTuple):
    """Between two turns. Ranks are places in the packing order, from 0; N is none."""

    heights: Array  # cell_dtype [L + window - 1, W + window - 1, B], of the bin that is filled
    slot: Array  # integer [B], which bin that is
    began: Array  # bool [B], whether something lies in it
    rank: Array  # integer [B], of the item that is offered next
    item: tuple[Triple, Array]  # cell_dtype [B]: its sides, and the cells that must carry it
    shut: Array  # bool [N, B] by item, what this bin would refuse; of few items one row of False
    bin: Array  # integer [N, B] by item, -1 while waiting, -2 for what is never packed
    place: Array  # cell_dtype [N, B] by item, y * L + x of the corner
    z: Array  # cell_dtype [N, B] by item


def pack(problem: Problem, instance: Instance, order: Array) -> Packing:
    """Packs the items in the given order, first fit, over as many bins as it takes.

    An item stands at the lowest of its allowed positions, of several at the least y, then x (Wang
    and Dong, section II.C).

    Composes with jit and with vmap over `instance`, `order` or both; vmap costs nothing, the
    kernel underneath is batched. Items that fit no empty bin get bin -1 (`make_instance` refuses
    them, inside jit nothing can).

    Args:
        problem: the static rules.
        instance: one instance of N items.
        order: int [N], a permutation of 0..N-1; where the padding stands in it is immaterial.

    Returns:
        Bins, positions and sums over every bin, int32 [N, ...] in cells.

    Raises:
        AssertionError: where ranks, shapes or dtypes are others; a batch takes `vmap`.
    """
    chex.assert_type([instance.size, instance.bin, order], int)
    chex.assert_shape(instance.bin, (3,))
    chex.assert_shape([instance.mask, order], (len(instance.size),))
    chex.assert_shape(instance.size, (None, 3))
    one = jax.tree.map(lambda leaf: leaf[None], (instance, order.astype(jnp.int32)))
    packing = _batched(problem)(*one)
    return jax.tree.map(lambda leaf: leaf[0], packing)


@cache
def _batched(problem: Problem) -> Callable[[Instance, Array], Packing]:
    """A packer of batches (leaves [B, ...]) in which a vmap becomes a larger B, not a new axis."""

    @custom_vmap
    def packer(instance: Instance, order: Array) -> Packing:
        return _in_pieces(problem, instance, order)

    @packer.def_vmap
    def _(size: int, batched: tuple, instance: Instance, order: Array):  # type: ignore[no-untyped-def]
        def merge(leaf: Array, has_axis: bool) -> Array:
            leaf = leaf if has_axis else jnp.broadcast_to(leaf, (size, *leaf.shape))
            return leaf.reshape(-1, *leaf.shape[2:])

        packing = packer(*jax.tree.map(merge, (instance, order), tuple(batched)))
        split = jax.tree.map(lambda leaf: leaf.reshape(size, -1, *leaf.shape[1:]), packing)
        return split, jax.tree.map(lambda _: True, packing)

    # Compiled once per problem and shape, also where the caller does not jit.
    return jax.jit(packer)


def _in_pieces(problem: Problem, instance: Instance, order: Array) -> Packing:
    """`pack` over a batch (leaves [B, ...]), on a CPU piece by piece."""
    batch = order.shape[0]
    if jax.default_backend() != "cpu" or batch < SEVERAL:
        return _first_fit(problem, instance, order)
    most, vector = LANES, VECTOR // cell_dtype(problem).itemsize
    if max(problem.window) >= LARGE_WINDOW:
        most, vector = FEW_LANES, 1
    size = -(-batch // -(-batch // most))
    return in_pieces(
        lambda piece: _first_fit(problem, *piece), (instance, order), -(-size // vector) * vector
    )


def _first_fit(problem: Problem, instance: Instance, order: Array) -> Packing:
    """One piece. Inside, batches are last: see `height_map`."""
    dtype = cell_dtype(problem)
    # Items larger than the bin or the kernel's window never fit, and their sides may not survive
    # the narrow type below.
    limit = jnp.minimum(instance.bin, jnp.asarray([*problem.window, problem.bin[2]]))
    able = (instance.mask & (instance.size <= limit[:, None]).all(-1)).T
    sizes = instance.size.transpose(2, 1, 0)
    needed = problem.cells_needed(sizes[0] * sizes[1]).astype(dtype)
    length, width, height = sizes.astype(dtype)
    sides = length, width, height
    turns = partial(_take_turns, problem)
    always = (instance.bin > 0).all()
    packed = whole(always, turns, instance.bin.T, (sides, needed), able, order.T)
    y, x = jnp.divmod(packed.place, problem.bin[0])
    corner = x, y, packed.z
    stats = _stats_by_bin(problem, packed.bin, corner, sides)
    position = jnp.stack([place.T.astype(jnp.int32) for place in corner], -1)
    bin = jnp.maximum(packed.bin, -1).astype(jnp.int32)
    return Packing(bin.T, position, *stats.transpose(1, 2, 0))


def _take_turns(
    problem: Problem, bins: Array, items: tuple[Triple, Array], able: Array, order: Array
) -> _Turn:
    """Offers items to bins until none is left to offer.

    Args:
        bins: int32 [3, B].
        items: cell_dtype [N, B]: sides, and the cells that must carry each.
        able: bool [N, B], False for what is never packed.
        order: int32 [N, B].
    """
    N, batch = able.shape
    dtype = cell_dtype(problem)
    lane = jnp.arange(batch)
    ceiling = bins[2].astype(dtype)
    empty = empty_map(problem, bins)
    slots = _narrowest(("int8", "int16", "int32"), N)
    # Up to twice N: what comes before the current item is offered to the next bin.
    ranks = _narrowest(("uint8", "uint16", "uint32"), 2 * N)
    (length, width, height), needed = items
    ranked = jnp.stack([length, width, height, needed], -1)
    if dtype.itemsize == 1:  # as one word: XLA gathers one element after the other
        ranked = jax.lax.bitcast_convert_type(ranked, jnp.int32)
    ranked, rank_of = _by_rank(ranked, order, ranks)

    def fetched(rank: Array) -> tuple[Triple, Array]:
        row = jnp.minimum(rank, N - 1).astype(jnp.int32)
        item = ranked.at[row, lane].get(mode="promise_in_bounds")
        if dtype.itemsize == 1:
            item = jax.lax.bitcast_convert_type(item, dtype)
        length, width, height, needed = jnp.unstack(item, axis=-1)
        return (length, width, height), needed

    def turn(now: _Turn) -> _Turn:
        size, needed = now.item
        z = rest(problem, now.heights, size, needed, ceiling)
        corner, fits = lowest(problem, z, least)
        fits &= now.rank < N
        x, y, z = corner
        here = (rank_of == now.rank) & fits
        bin = jnp.where(here, now.slot, now.bin)
        shut = now.shut
        if N >= MANY_ITEMS:
            # What is like a refused item, or higher, is refused too until something comes in.
            shut |= (length == size[0]) & (width == size[1]) & (height >= size[2])
            shut &= ~fits
        following = jnp.where((rank_of > now.rank) & ~shut, rank_of, rank_of + N)
        following = least(jnp.where(bin == -1, following, ranks.type(2 * N)), 1)
        # A bin that took nothing is the end: what is left fits no bin.
        began = now.began | fits
        opens = (following >= N) & began
        rank = jnp.where(opens, following - N, jnp.minimum(following, N))
        heights = drop(problem, now.heights, size, corner, fits)
        return _Turn(
            heights=jnp.where(opens, empty, heights),
            slot=now.slot + opens.astype(slots),
            began=began & ~opens,
            rank=rank,
            # Fetched here and carried: fetched where it is used, XLA fuses it into every cell.
            item=fetched(rank),
            shut=shut & ~opens,
            bin=bin,
            place=jnp.where(here, y * problem.bin[0] + x, now.place),
            z=jnp.where(here, z, now.z),
        )

    rank = least(jnp.where(able, rank_of, ranks.type(N)), 1)
    nothing = jnp.zeros((N, batch), dtype)
    start = _Turn(
        heights=empty,
        slot=jnp.zeros(batch, slots),
        began=jnp.zeros(batch, bool),
        rank=rank,
        item=fetched(rank),
        shut=jnp.zeros((N if N >= MANY_ITEMS else 1, batch), bool),
        bin=jnp.where(able, -1, -2).astype(slots),
        place=nothing,
        z=nothing,
    )

    def turns(now: _Turn) -> _Turn:
        for _ in range(1 if jax.default_backend() == "cpu" else TURNS):
            now = turn(now)  # of no effect once nothing is left
        return now

    return jax.lax.while_loop(lambda now: (now.rank < N).any(), turns, start)


def _by_rank(items: Array, order: Array, dtype: np.dtype) -> tuple[Array, Array]:
    """(rows of `items` [N, B, ...] in packing order, rank of every item [N, B])."""
    N, batch = order.shape
    lane = jnp.arange(batch)
    if not loops_are_whole():
        rank = jax.lax.broadcasted_iota(dtype, (N, batch), 0)
        rank_of = jnp.zeros_like(rank).at[order, lane].set(rank, unique_indices=True)
        return items.at[order, lane].get(mode="promise_in_bounds"), rank_of
    # Comparing a whole column costs less than writing one number to where it belongs.
    number = jax.lax.broadcasted_iota(dtype, (N, batch), 0)

    def place(rank: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
        row = items.at[order[rank], lane].get(mode="promise_in_bounds")
        here = number == order[rank].astype(dtype)
        return found[0].at[rank].set(row), jnp.where(here, rank.astype(dtype), found[1])

    nothing = jnp.zeros_like(items), jnp.zeros((N, batch), dtype)
    done: tuple[Array, Array] = jax.lax.fori_loop(0, N, place, nothing)
    return done


def _stats_by_bin(problem: Problem, bin: Array, corner: Triple, sides: Triple) -> Array:
    """Volume, highest point and sum of the height map of every bin slot: int32 [N, 3, B].

    Apart from the loop that packs, so that who wants placements only does not pay for it.

    Args:
        bin, corner, sides: integers [N, B] by item.
    """
    L, W, _ = problem.bin
    N, batch = bin.shape
    dtype = sides[0].dtype
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

        heights = jax.lax.fori_loop(0, N, raised, jnp.zeros((L, W, batch), dtype))
        found = (
            total(jnp.where(inside, volume, 0), 1),
            -least(jnp.where(inside, -top, 0), 1),
            total(heights.astype(jnp.int32), 2),
        )
        return stats.at[slot].set(jnp.stack(found))

    nothing = jnp.zeros((N, 3, batch), jnp.int32)
    # A scatter takes one number after the other; a slot at a time takes all lanes.
    return jax.lax.fori_loop(0, bin.max().astype(jnp.int32) + 1, stats_of, nothing)


def _narrowest(names: tuple[str, ...], largest: int) -> np.dtype:
    """The first of these integer types that holds `largest`, its maximum kept free."""
    return np.dtype(next(name for name in names if np.iinfo(name).max > largest))
