"""Best of N orders, whatever draws them."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.errors import UserError
from jaxpack.model.problem import Instance, Problem
from jaxpack.search.protocol import (
    Draw,
    Objective,
    Orders,
    Search,
    better,
    like_drawn,
    pack_orders,
    run_rounds,
)


class Sampled(NamedTuple):
    """The best order so far."""

    key: Array  # typed PRNG keys [B], never change
    drawn: Array  # int32[], samples drawn per instance
    cost: Array  # float32 [B]
    order: Orders


def sampling(
    problem: Problem, draw: Draw, objective: Objective, chunk: int, samples: int | None = None
) -> Search:
    """Draws `chunk` orders per instance and round; keeps the best, the items' own order included.

    Sample i is drawn from fold_in(key, i) and nothing else, so more samples are never worse and
    `chunk` does not change the answer.

    Args:
        samples: after so many further ones do not count; None: they all do.

    Raises:
        UserError: where `chunk` is less than 1.
    """
    if chunk < 1:
        raise UserError(f"samples {chunk}: draw at least 1")

    def start(keys: Array, instances: Instance) -> Sampled:
        own = jnp.argsort(~instances.mask, axis=1, stable=True).astype(jnp.int32)
        order = like_drawn(draw, keys, instances, own)
        packings = pack_orders(problem, instances, order)
        return Sampled(keys, jnp.int32(0), jax.vmap(objective)(instances, packings), order)

    def advance(instances: Instance, state: Sampled) -> Sampled:
        batch, items = instances.mask.shape
        index = state.drawn + jnp.arange(chunk)
        keys = jax.vmap(lambda key: jax.vmap(jax.random.fold_in, (None, 0))(key, index))(state.key)
        repeated = jax.tree.map(lambda leaf: jnp.repeat(leaf, chunk, 0), instances)
        orders = draw(keys.reshape(-1), repeated)
        packings = pack_orders(problem, repeated, orders)
        costs = jax.vmap(objective)(repeated, packings).reshape(batch, chunk)
        if samples is not None:
            costs = jnp.where(index < samples, costs, jnp.inf)
        best = jnp.argmin(costs, 1)
        member = jnp.arange(batch)
        order = jax.tree.map(lambda leaf: leaf.reshape(batch, chunk, items)[member, best], orders)
        found = better(costs[member, best], order, state.cost, state.order)
        return Sampled(state.key, state.drawn + chunk, *found)

    return Search(start, advance, lambda state: state.order)


def best_of(
    problem: Problem,
    keys: Array,
    instances: Instance,
    draw: Draw,
    samples: int,
    objective: Objective,
    chunk: int = 50,
) -> Orders:
    """The best of `samples` orders of every instance; of equally good ones the first.

    Args:
        keys: typed PRNG keys [B].
        instances: leaves [B, ...].
        draw: such as `jax.vmap(random_order)` or a policy's samples.
        chunk: samples of an instance packed side by side; bounds the memory.

    Returns:
        The best orders.
    """
    search = sampling(problem, draw, objective, min(chunk, samples), samples)

    def start(keys: Array, instances: Instance) -> Sampled:
        """Anything drawn is better."""
        order = like_drawn(draw, keys, instances, jnp.zeros(instances.mask.shape, jnp.int32))
        return Sampled(keys, jnp.int32(0), jnp.full(len(keys), jnp.inf), order)

    search = search._replace(start=start)
    best: Orders = run_rounds(search, keys, instances, -(-samples // min(chunk, samples)))
    return best
