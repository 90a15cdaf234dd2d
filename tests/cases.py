"""Random cases for the tests, in NumPy, the packers they go through, and a small recipe."""

from functools import cache

import jax
import numpy as np

from jaxpack.learning.pointer import PointerConfig
from jaxpack.learning.recipe import TrainConfig
from jaxpack.model.instances import Distribution
from jaxpack.model.problem import Instance, Problem
from jaxpack.packing.first_fit import pack

TINY = TrainConfig(
    problem=Problem(bin=(6, 1, 6), largest=(4, 1)),
    distribution=Distribution(items=8, low=1, high=4),
    policy=PointerConfig(hidden=8, critic=4),
    train_instances=160,
    valid_instances=8,
    batch=8,
    epochs=3,
)
"""A recipe that trains in a moment."""


@cache
def packer(problem):
    """Packs a batch [B, ...] of instances, one order each; compiled once per problem and shape."""
    return jax.jit(jax.vmap(lambda instance, order: pack(problem, instance, order)))


def random_cases(problem, seed, count, items, *, padding=0.2, shrink=True, oversize=0.05):
    """(instances, orders) [count, ...] that reach into every corner of the rules.

    Half of the bins are the problem's and half are anything smaller, flat ones too (all are the
    problem's without `shrink`). Half of the items are small and half are anything up to the bin's
    or `largest`'s own sides; a share `oversize` of them is one cell too long, wide or tall. A share
    `padding` is padding, of any size, anywhere in the order.
    """
    rng = np.random.default_rng(seed)
    full = np.array(problem.bin)
    smaller = rng.random((count, 1)) < 0.5 * shrink
    bins = np.where(smaller, rng.integers(1, full + 1, (count, 3)), full)
    most = np.broadcast_to(bins[:, None], (count, items, 3)).copy()
    if problem.largest is not None:
        most[..., :2] = np.minimum(most[..., :2], problem.largest)
    small = rng.random((count, items, 1)) < 0.5
    size = rng.integers(1, np.where(small, -(-most // 2), most) + 1)
    axis = rng.integers(0, 3, (count, items, 1)) == np.arange(3)
    too_large = rng.random((count, items, 1)) < oversize
    size = np.where(too_large & axis, most + 1, size)
    mask = rng.random((count, items)) >= padding
    orders = rng.permuted(np.tile(np.arange(items), (count, 1)), axis=1)
    return Instance(size.astype(np.int32), mask, bins.astype(np.int32)), orders.astype(np.int32)
