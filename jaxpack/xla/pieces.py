"""A batch in pieces that stay in a processor's cache, one after the other."""

from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.xla.target import target

T = TypeVar("T")
U = TypeVar("U")


def in_pieces(function: Callable[[T], U], batch: T, size: int) -> U:
    """A batched function (leaves [B, ...] -> [B, ...]) in pieces of `size`, one after the other.

    The last piece is filled up with the last member.

    Args:
        size: on a CPU; elsewhere see `Target.lanes`.
    """
    size = target().lanes(size)
    count = len(jax.tree.leaves(batch)[0])
    missing = -count % size

    def cut(leaf: Array) -> Array:
        filling = jnp.broadcast_to(leaf[-1:], (missing, *leaf.shape[1:]))
        return jnp.concatenate([leaf, filling]).reshape(-1, size, *leaf.shape[1:])

    done = jax.lax.map(function, jax.tree.map(cut, batch))
    return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:])[:count], done)
