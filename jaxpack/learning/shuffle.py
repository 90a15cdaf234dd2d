"""A shuffle that is worked out where it is looked at.

To sort 100,000 random numbers takes as long as some updates, and an update looks at 50 of them.
"""

import jax
import jax.numpy as jnp
from jax import Array

ROUNDS = 8


def shuffled(key: Array, places: Array, count: int) -> Array:
    """What stands at these places when 0, 1, ..., count - 1 are shuffled.

    A Feistel network permutes the numbers of so many bits; from a number that is too large it goes
    on until it comes to one that is not (Black and Rogaway, Ciphers with arbitrary finite domains,
    2002).

    Args:
        key: typed PRNG key [], which gives the shuffle.
        places: int32 [...], 0 or more and below `count`.
        count: static.

    Returns:
        int32, the shape of `places`.
    """
    half = max(1, ((count - 1).bit_length() + 1) // 2)
    low = jnp.uint32((1 << half) - 1)
    secrets = jax.random.bits(key, (ROUNDS,), jnp.uint32)

    def permute(number: Array) -> Array:
        left, right = number >> half, number & low
        for secret in secrets:
            left, right = right, left ^ (_mixed(right ^ secret) & low)
        return (left << half) | right

    def walk(number: Array) -> Array:
        return jnp.where(number >= count, permute(number), number)

    first = permute(places.astype(jnp.uint32))
    found: Array = jax.lax.while_loop(lambda number: (number >= count).any(), walk, first)
    return found.astype(jnp.int32)


def _mixed(number: Array) -> Array:
    """Every bit depends on all: the last step of MurmurHash3."""
    number = (number ^ (number >> 16)) * jnp.uint32(0x85EBCA6B)
    number = (number ^ (number >> 13)) * jnp.uint32(0xC2B2AE35)
    return number ^ (number >> 16)
