"""The judge: one function that turns a packing order into a packing.

First fit: an item goes into the first bin that has an allowed position for it. Box by box this
needs one height map at a time: bin 0 reads the whole order and takes what fits when its turn
comes, what it leaves goes to bin 1 in the same order, and so on. The placements are the same.
"""

from collections.abc import Callable
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.custom_batching import custom_vmap

from jaxpack.packing.height_map import cell_dtype, drop, empty_map, lowest, rest
from jaxpack.packing.problem import Instance, Packing, Problem


def pack(problem: Problem, instance: Instance, order: Array) -> Packing:
    """Packs the items in the given order, first fit, over as many bins as it takes.

    Composes with jit and with vmap over `instance`, `order` or both; vmap costs nothing, the
    kernel underneath is batched. Items that fit no empty bin get bin -1 (`make_instance` refuses
    them, inside jit nothing can).

    Args:
        problem: the static rules.
        instance: one instance of N items.
        order: int [N], a permutation of 0..N-1; where the padding stands in it is immaterial.
    """
    one = jax.tree.map(lambda leaf: leaf[..., None], (instance, order.astype(jnp.int32)))
    packing = _batched(problem)(*one)
    return jax.tree.map(lambda leaf: leaf[..., 0], packing)


@cache
def _batched(problem: Problem) -> Callable[[Instance, Array], Packing]:
    """Batch-last packer [..., B] in which a vmap becomes a larger B instead of a new axis."""

    @custom_vmap
    def packer(instance: Instance, order: Array) -> Packing:
        return _first_fit(problem, instance, order)

    @packer.def_vmap
    def _(size: int, batched: tuple, instance: Instance, order: Array):  # type: ignore[no-untyped-def]
        def merge(leaf: Array, has_axis: bool) -> Array:
            leaf = leaf if has_axis else jnp.broadcast_to(leaf, (size, *leaf.shape))
            return jnp.moveaxis(leaf, 0, -2).reshape(*leaf.shape[1:-1], -1)

        def split(leaf: Array) -> Array:
            return jnp.moveaxis(leaf.reshape(*leaf.shape[:-1], size, -1), -2, 0)

        packing = packer(*jax.tree.map(merge, (instance, order), tuple(batched)))
        return jax.tree.map(split, packing), jax.tree.map(lambda _: True, packing)

    # Compiled once per problem and shape, also where the caller does not jit.
    return jax.jit(packer)


def _first_fit(problem: Problem, instance: Instance, order: Array) -> Packing:
    """`pack` over a trailing batch: size [N, 3, B], mask [N, B], bin [3, B], order [N, B]."""
    dtype = cell_dtype(problem)
    wall = np.iinfo(dtype).max
    items, batch = order.shape
    # From here to the end everything is in packing order: row t is the t-th item to be packed.
    size = jnp.take_along_axis(instance.size, order[:, None], 0)
    # Items larger than the bin or the kernel's window never fit, and their sides may not survive
    # the narrow type below.
    limit = jnp.minimum(instance.bin, jnp.asarray([*problem.window, problem.bin[2]])[:, None])
    waiting = jnp.take_along_axis(instance.mask, order, 0) & (size <= limit).all(1)
    needed = problem.cells_needed(size[:, 0] * size[:, 1]).astype(dtype)
    volume = size.prod(1)
    sides = tuple(size[:, axis].astype(dtype) for axis in range(3))
    ceiling = instance.bin[2].astype(dtype)
    empty = empty_map(problem, instance.bin)

    def offer(heights: Array, item: tuple) -> tuple[Array, tuple]:
        sides, needed, waiting = item
        corner, fits = lowest(problem, rest(problem, heights, sides, needed, ceiling))
        fits &= waiting
        return drop(problem, heights, sides, corner, fits), (corner, fits)

    def fill_bin(carry: tuple) -> tuple:
        slot, waiting, _, bins, corners, stats = carry
        heights, (corner, fits) = jax.lax.scan(offer, empty, (sides, needed, waiting))
        heights = jnp.where(heights == wall, 0, heights)
        row = jnp.stack(
            [
                jnp.where(fits, volume, 0).sum(0),
                heights.max((0, 1)).astype(jnp.int32),
                heights.sum((0, 1), dtype=jnp.int32),
            ]
        )
        return (
            slot + 1,
            waiting & ~fits,
            fits.any(),
            jnp.where(fits, slot, bins),
            tuple(jnp.where(fits, new, old) for new, old in zip(corner, corners, strict=True)),
            stats.at[slot].set(row),
        )

    def more(carry: tuple) -> Array:
        _, waiting, progress, *_ = carry
        return waiting.any() & progress

    _, _, _, bins, corners, stats = jax.lax.while_loop(
        more,
        fill_bin,
        (
            jnp.int32(0),
            waiting,
            jnp.bool(True),
            jnp.full((items, batch), -1, jnp.int32),
            (jnp.zeros((items, batch), dtype),) * 3,
            jnp.zeros((items, 3, batch), jnp.int32),
        ),
    )
    member = jnp.arange(batch)

    def by_item(ranked: Array) -> Array:
        return jnp.zeros((items, batch), jnp.int32).at[order, member].set(ranked.astype(jnp.int32))

    return Packing(
        bin=by_item(bins),
        position=jnp.stack([by_item(corner) for corner in corners], axis=1),
        volume=stats[:, 0],
        top=stats[:, 1],
        shadow=stats[:, 2],
    )
