"""How good is a packing on a grid? Section II.D of the paper, and what the field adds to it.

Every function takes one instance and its packing and returns a scalar; batch them with vmap.
"""

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.model.problem import Instance, Packing


def bins_used(packing: Packing) -> Array:
    """Number of bins with at least one item: int32."""
    return (packing.volume > 0).sum(dtype=jnp.int32)


def compactness(instance: Instance, packing: Packing) -> Array:
    """C: volume of the items in a bin / (L * W * the bin's highest point), mean over used bins."""
    region = instance.bin[0] * instance.bin[1] * packing.top
    return _mean_ratio(packing, region)


def pyramid(packing: Packing) -> Array:
    """P: volume of the items in a bin / sum of its height map, mean over used bins."""
    return _mean_ratio(packing, packing.shadow)


def utilisation(instance: Instance, packing: Packing) -> Array:
    """Packed volume / volume of the used bins: float32. Unlike C it sees the space on top."""
    # Of whole numbers below 2^24 float32 makes exact sums; those of many bins are beyond int32.
    capacity = bins_used(packing).astype(jnp.float32) * instance.bin.prod()
    return packing.volume.astype(jnp.float32).sum() / jnp.maximum(capacity, 1)


def lower_bound(instance: Instance) -> Array:
    """ceil(total volume / bin volume): int32, no packing uses fewer bins. Exact at any size.

    Of an item larger than the bin only what is within the bin's sides counts.
    """
    inside = jnp.minimum(instance.size, instance.bin).prod(-1)
    volume = jnp.where(instance.mask, inside, 0).astype(jnp.uint32)
    capacity = instance.bin.prod().astype(jnp.uint32)

    def add(one: tuple[Array, Array], other: tuple[Array, Array]) -> tuple[Array, Array]:
        """(full bins, what is left over, at most a bin): the sum of both is within uint32."""
        full, left = one[0] + other[0], one[1] + other[1]
        return full + (left > capacity), jnp.where(left > capacity, left - capacity, left)

    sums = jax.lax.associative_scan(add, (jnp.zeros_like(volume, jnp.int32), volume))
    full, left = (column[-1] for column in sums)
    return full + (left > 0)


def paper_cost(
    instance: Instance, packing: Packing, alpha: float = 0.5, beta: float = 0.5
) -> Array:
    """R of Eq. (9), a cost: 5 [alpha (1 - mean C) + beta (1 - mean P)], float32."""
    loose = alpha * (1 - compactness(instance, packing)) + beta * (1 - pyramid(packing))
    return 5 * loose


def bins_first_cost(
    instance: Instance, packing: Packing, alpha: float = 0.5, beta: float = 0.05
) -> Array:
    """Bins, then C, then P: bins + alpha (1 - mean C) + beta (1 - mean P), float32.

    The default weights keep the order strict: C and P together never outweigh one bin.
    """
    loose = alpha * (1 - compactness(instance, packing)) + beta * (1 - pyramid(packing))
    return bins_used(packing) + loose


def _mean_ratio(packing: Packing, denominator: Array) -> Array:
    ratio = packing.volume / jnp.maximum(denominator, 1)
    return ratio.sum() / jnp.maximum(bins_used(packing), 1)
