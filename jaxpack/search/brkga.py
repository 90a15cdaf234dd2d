"""Biased random-key genetic algorithm over packing orders (Goncalves and Resende, 2011).

An individual is one uint32 key per item; sorting the keys gives the order, and the placement
kernel judges it. A generation keeps the elite, adds mutants and fills up with children that take
each key from an elite parent with probability `bias`, from a non-elite one otherwise.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.sharding import Mesh

from jaxpack.model.metrics import bins_first_cost
from jaxpack.model.problem import Instance, Problem
from jaxpack.packing.first_fit import pack
from jaxpack.search.breeding import BrkgaConfig, crossed
from jaxpack.search.heuristics import decode_keys
from jaxpack.search.protocol import Objective, Search, run_rounds
from jaxpack.xla.devices import WHOLE, share_out, split_batch

Costs = Callable[[Instance, Array], Array]  # (instance, genes [P, N]) -> [P]


class Population(NamedTuple):
    """The generation of one instance, best first."""

    key: Array  # typed PRNG key[], for the generations to come
    genes: Array  # uint32 [P, N]
    cost: Array  # float32 [P]


def genetic(
    problem: Problem,
    config: BrkgaConfig = BrkgaConfig(),
    objective: Objective = bins_first_cost,
    seeds: Callable[[Array, Instance], Array] | None = None,
    mesh: Mesh | None = None,
) -> Search:
    """The algorithm as a search: a round is a generation.

    Args:
        mesh: for use within `split_batch` of it, all inputs whole: the packings of a generation are
            shared out among its devices.
        objective: the cost to minimise, `bins_first_cost` or the paper's `paper_cost`.
        seeds: (keys [B], instances) -> int32 [B, K, N], orders to start from, such as the sorts; of
            more than the population the first ones.
    """

    costs = partial(_costs, problem, objective, mesh)

    def start(keys: Array, instances: Instance) -> Population:
        pairs = jax.vmap(jax.random.split)(keys)
        given = seeds(pairs[:, 0], instances) if seeds else None
        return jax.vmap(partial(_first_generation, config, costs))(pairs[:, 1], instances, given)

    def best(state: tuple[Population, Array]) -> Array:
        population, mask = state
        return jax.vmap(decode_keys)(population.genes[:, 0], mask)

    return Search(
        start=lambda keys, instances: (start(keys, instances), instances.mask),
        advance=lambda instances, state: (
            jax.vmap(partial(_next_generation, config, costs))(instances, state[0]),
            state[1],
        ),
        best=best,
    )


def brkga(
    problem: Problem,
    keys: Array,
    instances: Instance,
    config: BrkgaConfig = BrkgaConfig(),
    objective: Objective = bins_first_cost,
    seeds: Callable[[Array, Instance], Array] | None = None,
    mesh: Mesh | None = None,
) -> Array:
    """The best orders after all generations: int32 [B, N]. See `genetic`.

    Args:
        mesh: devices, from `data_mesh`, that share the packings of each generation. It is for
            fewer instances than devices; more are faster by `split_batch` of the instances.
    """
    search = genetic(problem, config, objective, seeds, mesh)
    run = partial(run_rounds, search, rounds=config.generations)
    best: Array = split_batch(mesh, run, WHOLE, WHOLE)(keys, instances)
    return best


def _first_generation(
    config: BrkgaConfig,
    costs: Costs,
    key: Array,
    instance: Instance,
    seeds: Array | None,
) -> Population:
    start_key, key = jax.random.split(key)
    genes = _fresh(start_key, config.population, instance)
    if seeds is not None:
        seeds = seeds[: config.population]
        genes = genes.at[: seeds.shape[0]].set(jax.vmap(keys_of)(seeds))
    return _best_first(key, genes, costs(instance, genes))


def _next_generation(
    config: BrkgaConfig,
    costs: Costs,
    instance: Instance,
    population: Population,
) -> Population:
    elite, mutants, children = config.shares
    key, mutant_key, child_key = jax.random.split(population.key, 3)

    def child(key: Array) -> Array:
        """Parameterised uniform crossover of one elite and one other parent."""
        elite_key, other_key, coin_key = jax.random.split(key, 3)
        mother = jax.random.randint(elite_key, (), 0, elite)
        father = jax.random.randint(other_key, (), elite, config.population)
        inherits = jax.random.bernoulli(coin_key, config.bias, population.genes.shape[1:])
        return crossed(inherits, population.genes, mother, father)

    born = jax.vmap(child)(jax.random.split(child_key, children))
    new = jnp.concatenate([born, _fresh(mutant_key, mutants, instance)])
    genes = jnp.concatenate([population.genes[:elite], new])
    cost = jnp.concatenate([population.cost[:elite], costs(instance, new)])
    return _best_first(key, genes, cost)


def _fresh(key: Array, count: int, instance: Instance) -> Array:
    return jax.random.bits(key, (count, instance.mask.shape[0]), jnp.uint32)


def _costs(
    problem: Problem, objective: Objective, mesh: Mesh | None, instance: Instance, genes: Array
) -> Array:
    def cost(keys: Array) -> Array:
        order = decode_keys(keys, instance.mask)
        return objective(instance, pack(problem, instance, order))

    return share_out(mesh, jax.vmap(cost), genes)


def _best_first(key: Array, genes: Array, costs: Array) -> Population:
    rank = jnp.argsort(costs)
    return Population(key, genes[rank], costs[rank])


def keys_of(order: Array) -> Array:
    """Evenly spread uint32 keys [N] that decode to `order` (int [N])."""
    items = order.shape[0]
    step = jnp.uint32((2**32 - 1) // (items + 1))
    spread = (jnp.arange(items, dtype=jnp.uint32) + 1) * step
    return jnp.zeros(items, jnp.uint32).at[order].set(spread)
