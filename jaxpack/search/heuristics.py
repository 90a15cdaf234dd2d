"""Orders that need no search: random, and the sorts. Padding comes last in every order."""

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.model.problem import Instance


def random_order(key: Array, instance: Instance) -> Array:
    """A uniformly random order: int32 [N]. `key` is a typed PRNG key, consumed."""
    return decode_keys(jax.random.bits(key, instance.mask.shape, jnp.uint32), instance.mask)


def decode_keys(keys: Array, mask: Array) -> Array:
    """The order that sorts random keys ascending, padding last.

    The index of an item rides in the low bits of its key, so that one sort of single integers
    does it: five to eight times faster in XLA than an argsort. It leaves 2^(32 - bits of N)
    distinct keys; equal ones go by index.

    Args:
        keys: uint32 [N], uniform over the full range.
        mask: bool [N].

    Returns:
        int32 [N], a permutation.
    """
    items = mask.shape[-1]
    low = jnp.uint32((1 << (items - 1).bit_length()) - 1)
    # The largest keys are the padding's: a real item gives up its top bit pattern for it.
    free = jnp.minimum(keys & ~low, ~low - low - 1)
    tagged = jnp.where(mask, free, ~low) | jnp.arange(items, dtype=jnp.uint32)
    return (jax.lax.sort(tagged) & low).astype(jnp.int32)


def volume_order(instance: Instance) -> Array:
    """Descending volume, area in 2D: the paper's B-Box Seq. int32 [N], ties by index."""
    return _descending(instance, instance.size.prod(-1))


def footprint_order(instance: Instance) -> Array:
    """Descending footprint, then height. int32 [N], ties by index."""
    length, width, height = instance.size.T
    return _descending(instance, length * width, height)


def height_order(instance: Instance) -> Array:
    """Descending height, then footprint. int32 [N], ties by index."""
    length, width, height = instance.size.T
    return _descending(instance, height, length * width)


def _descending(instance: Instance, *keys: Array) -> Array:
    masked = [jnp.where(instance.mask, -key, jnp.iinfo(jnp.int32).max) for key in keys]
    return jnp.lexsort(masked[::-1]).astype(jnp.int32)
