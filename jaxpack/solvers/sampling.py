"""Best of N orders, whatever draws them."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.packing.first_fit import pack
from jaxpack.packing.problem import Instance, Packing, Problem

Objective = Callable[[Instance, Packing], Array]
"""A cost to minimise: (instance, packing) -> float32 scalar. See `jaxpack.packing.metrics`."""


def best_of(
    problem: Problem,
    key: Array,
    instance: Instance,
    draw: Callable[[Array, Instance], Array],
    samples: int,
    objective: Objective,
    chunk: int = 50,
) -> Array:
    """The best of `samples` orders of one instance; of equally good ones the first.

    Args:
        key: typed PRNG key; sample i is drawn from fold_in(key, i) and nothing else, so more
            samples are never worse and `chunk` does not change the answer.
        draw: (key, instance) -> int32 [N], such as `random_order` or a policy's sample.
        chunk: samples packed side by side; bounds the memory.

    Returns:
        int32 [N], the best order.
    """

    def trial(index: Array) -> tuple[Array, Array]:
        order = draw(jax.random.fold_in(key, index), instance)
        cost = objective(instance, pack(problem, instance, order))
        return jnp.where(index < samples, cost, jnp.inf), order

    def step(best: tuple[Array, Array], first: Array) -> tuple[tuple[Array, Array], None]:
        costs, orders = jax.vmap(trial)(first + jnp.arange(chunk))
        winner = jnp.argmin(costs)
        better = costs[winner] < best[0]
        return (
            jnp.minimum(costs[winner], best[0]),
            jnp.where(better, orders[winner], best[1]),
        ), None

    start = (jnp.float32(jnp.inf), jnp.arange(instance.mask.shape[0], dtype=jnp.int32))
    (_, order), _ = jax.lax.scan(step, start, jnp.arange(0, samples, chunk))
    return order
