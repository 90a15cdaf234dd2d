"""Biased random-key genetic algorithm over packing orders (Goncalves and Resende, 2011).

An individual is one uint32 key per item; sorting the keys gives the order, and the placement
kernel judges it. A generation keeps the elite, adds mutants and fills up with children that take
each key from an elite parent with probability `bias`, from a non-elite one otherwise.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.errors import UserError
from jaxpack.packing.first_fit import pack
from jaxpack.packing.metrics import bins_first_cost
from jaxpack.packing.problem import Instance, Problem
from jaxpack.solvers.heuristics import decode_keys
from jaxpack.solvers.sampling import Objective


@dataclass(frozen=True)
class BrkgaConfig:
    """Budget and shares: population * generations packings, less the elite's."""

    population: int = 100
    generations: int = 60
    elite: float = 0.2  # share of the population that survives unchanged
    mutants: float = 0.14  # share that is drawn afresh
    bias: float = 0.7  # probability of inheriting a key from the elite parent

    def __post_init__(self) -> None:
        for name in ("elite", "mutants", "bias"):
            if not 0 <= getattr(self, name) <= 1:
                raise UserError(f"BRKGA {name} {getattr(self, name)}: give a share from 0 to 1")
        elite, _, children = self.shares
        if elite < 1 or children < 1 or self.generations < 0:
            raise UserError(
                f"BRKGA population {self.population}, elite {self.elite}, mutants {self.mutants}, "
                f"generations {self.generations}: leave at least one elite and one child"
            )

    @property
    def shares(self) -> tuple[int, int, int]:
        """Individuals per generation: (elite, mutants, children)."""
        elite = round(self.elite * self.population)
        mutants = round(self.mutants * self.population)
        return elite, mutants, self.population - elite - mutants


def brkga(
    problem: Problem,
    key: Array,
    instance: Instance,
    config: BrkgaConfig = BrkgaConfig(),
    objective: Objective = bins_first_cost,
    seeds: Array | None = None,
) -> Array:
    """The best order that the algorithm finds for one instance; vmap it over instances.

    Args:
        key: typed PRNG key, consumed.
        objective: the cost to minimise, `bins_first_cost` or the paper's `paper_cost`.
        seeds: int [K, N] orders to start from, such as the sorts; K at most the population.

    Returns:
        int32 [N], an order.
    """
    items = instance.mask.shape[0]
    elite, mutants, children = config.shares

    def fresh(key: Array, count: int) -> Array:
        return jax.random.bits(key, (count, items), jnp.uint32)

    def cost(keys: Array) -> Array:
        order = decode_keys(keys, instance.mask)
        return objective(instance, pack(problem, instance, order))

    def best_first(population: tuple[Array, Array]) -> tuple[Array, Array]:
        keys, costs = population
        rank = jnp.argsort(costs)
        return keys[rank], costs[rank]

    def child(key: Array, keys: Array) -> Array:
        """Parameterised uniform crossover of one elite and one other parent."""
        elite_key, other_key, coin_key = jax.random.split(key, 3)
        mother = keys[jax.random.randint(elite_key, (), 0, elite)]
        father = keys[jax.random.randint(other_key, (), elite, config.population)]
        inherits = jax.random.bernoulli(coin_key, config.bias, (items,))
        return jnp.where(inherits, mother, father)

    def generation(population: tuple[Array, Array], key: Array) -> tuple[tuple, None]:
        keys, costs = population
        mutant_key, child_key = jax.random.split(key)
        born = jax.vmap(child, (0, None))(jax.random.split(child_key, children), keys)
        new = jnp.concatenate([born, fresh(mutant_key, mutants)])
        keys = jnp.concatenate([keys[:elite], new])
        costs = jnp.concatenate([costs[:elite], jax.vmap(cost)(new)])
        return best_first((keys, costs)), None

    start_key, run_key = jax.random.split(key)
    keys = fresh(start_key, config.population)
    if seeds is not None:
        keys = keys.at[: seeds.shape[0]].set(jax.vmap(keys_of)(seeds))
    population = best_first((keys, jax.vmap(cost)(keys)))
    (keys, _), _ = jax.lax.scan(
        generation, population, jax.random.split(run_key, config.generations)
    )
    return decode_keys(keys[0], instance.mask)


def keys_of(order: Array) -> Array:
    """Evenly spread uint32 keys [N] that decode to `order` (int [N])."""
    items = order.shape[0]
    step = jnp.uint32((2**32 - 1) // (items + 1))
    spread = (jnp.arange(items, dtype=jnp.uint32) + 1) * step
    return jnp.zeros(items, jnp.uint32).at[order].set(spread)
