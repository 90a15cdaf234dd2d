"""A search whose finds breed: between its rounds a genetic algorithm works on them.

A packing costs a tenth of drawing an order from a policy, so generations are nearly free beside
the search's rounds; and they change orders where the search never goes back, in the last bins.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.model.problem import Instance, Problem
from jaxpack.packing.env import Decisions
from jaxpack.packing.first_fit import pack
from jaxpack.search.brkga import Population, keys_of
from jaxpack.search.protocol import Objective, Search


def evolved(
    problem: Problem,
    search: Search,
    finds: Callable[[Any], Array],
    breeding: Search,
    objective: Objective,
    generations: int,
) -> Search:
    """A round is one of `search` and so many generations of `breeding`, a smaller one a generation.

    Where more than orders is decided nothing is bred, as `breeding` has orders: `search` is alone.

    Args:
        breeding: from `genetic`.
        finds: the search's state -> int32 [B, K, N], the orders that breed, the best one first.
    """

    def judged(instance: Instance, orders: Array) -> Array:
        return jax.vmap(lambda order: objective(instance, pack(problem, instance, order)))(orders)

    def join(
        instances: Instance, found: Any, bred: tuple[Population, Array]
    ) -> tuple[Any, tuple[Population, Array]]:
        """The finds take the place of the worst individuals, in front where they are better.

        Never that of the best one: of a population too small for all finds the first ones join.
        """
        population, mask = bred
        orders = finds(found)[:, : population.cost.shape[1] - 1]
        count = orders.shape[1]
        genes = population.genes.at[:, -count:].set(jax.vmap(jax.vmap(keys_of))(orders))
        cost = population.cost.at[:, -count:].set(jax.vmap(judged)(instances, orders))
        rank = jnp.argsort(cost, axis=1)
        genes = jnp.take_along_axis(genes, rank[..., None], 1)
        cost = jnp.take_along_axis(cost, rank, 1)
        return found, (Population(population.key, genes, cost), mask)

    def start(keys: Array, instances: Instance) -> Any:
        found = search.start(keys, instances)
        if isinstance(finds(found), Decisions):
            return found, None
        return join(instances, found, breeding.start(keys, instances))

    def generation(instances: Instance, state: Any) -> Any:
        if state[1] is None:
            return search.advance(instances, state[0]), None
        return state[0], breeding.advance(instances, state[1])

    def advance(instances: Instance, state: Any) -> Any:
        if state[1] is None:
            return generation(instances, state)
        state = join(instances, search.advance(instances, state[0]), state[1])
        return jax.lax.fori_loop(
            0, generations, lambda _, state: generation(instances, state), state
        )

    def best(state: Any) -> Any:
        return search.best(state[0]) if state[1] is None else breeding.best(state[1])

    return Search(start, advance, best, refine=generation)
