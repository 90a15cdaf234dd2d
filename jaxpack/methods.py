"""Methods by name: each makes orders for a batch of instances."""

import re
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.errors import UserError
from jaxpack.io.weights import load_policy
from jaxpack.learning.networks import NETWORKS
from jaxpack.learning.recipe import Policy
from jaxpack.model.objectives import grid_costs
from jaxpack.model.problem import Instance, Problem
from jaxpack.packing.env import Decisions
from jaxpack.search.bin_by_bin import bin_by_bin, orders_found
from jaxpack.search.breeding import BrkgaConfig
from jaxpack.search.brkga import genetic
from jaxpack.search.evolved import evolved
from jaxpack.search.heuristics import footprint_order, height_order, random_order, volume_order
from jaxpack.search.protocol import Draw, Objective, Search, pack_orders, run_rounds
from jaxpack.search.sampling import best_of, sampling

Orders = Draw
"""(typed PRNG keys [B], instances [B, ...]) -> `search.protocol.Orders`: int32 [B, N], with the
orientations where the method turns items that may be turned. Pure; jit it."""

SORTS = {"volume": volume_order, "footprint": footprint_order, "height": height_order}
SEARCHES = (
    "brkga",
    "brkga-seeded",
    *(f"{name}-search" for name, network in NETWORKS.items() if "search" in network.searches),
)
"""They have no count in their names: a time limit may end them."""
SEEDING = "bin-aware"  # the policy of brkga-seeded
SEED_SAMPLES = 16  # of the policy's orders for brkga-seeded, and a quarter of it, at most


@dataclass(frozen=True)
class MethodOptions:
    """What the methods that search or learn need to know."""

    objective: str = "bins"  # of everything that searches: bins first, or the paper's R
    brkga: BrkgaConfig = BrkgaConfig()  # of brkga and brkga-seeded
    brkga_seeded: bool = True  # start brkga from the sorts
    policy: Policy | None = None  # of the methods that begin with its network's name
    shipped: str = ""  # the one to load for them if none is given, else that of the dimension
    kinds: int | None = None  # K, at least the distinct sizes in an instance, if it is known
    width: int = 8  # partial packings that bin-aware-search keeps
    draws: int = 8  # orders that it draws for each of them and bin
    rounds: int = 4  # bins that it fills without a time limit
    breeding: int = 10  # generations of BRKGA that its finds breed after each
    time_limit: float | None = None  # seconds per instance of SEARCHES, instead of their counts


@dataclass(frozen=True)
class Method:
    """How a method makes orders: as one program, or by a search that runs until time is up."""

    orders: Orders
    search: Search | None = None
    seconds: float | None = None  # per instance, of the search


def make_method(name: str, problem: Problem, options: MethodOptions) -> Method:
    """The method with this name.

    Args:
        name: random, volume, footprint, height, best-of-N, brkga, brkga-seeded, and of every
            network its name and what it `searches`, such as bin-aware-best-of-N.
        problem: the rules that it packs by.
        options: what a method that searches or learns needs to know.

    Returns:
        Its `orders(keys, instances)` is pure, jit it: typed PRNG keys [B] and instances [B, ...] to
        orders int32 [B, N]; to `Decisions` where items may be turned and the method, a policy's,
        turns them: all others leave them as their sizes are. See `compare`.

    Raises:
        UserError: where there is none, naming those there are; or the policy given is of another
            kind or for another dimension.
    """
    number = re.search(r"(?<=-)[1-9]\d{0,6}$", name)
    pattern, count = (name[: number.start()] + "N", int(number[0])) if number else (name, 0)
    learned = {
        f"{network}-{how}".strip("-"): (network, how)
        for network, policy in NETWORKS.items()
        for how in ("", *policy.searches)
    }
    if pattern in learned and pattern.endswith("-N") == (count > 0):
        return _learned(*learned[pattern], count, problem, options)
    objective = grid_costs()[options.objective]
    if pattern == "best-of-N" and count:
        return _best_of(problem, jax.vmap(random_order), count, objective)
    if name == "random":
        return Method(jax.vmap(random_order))
    if name in SORTS:
        return Method(lambda keys, instances: jax.vmap(SORTS[name])(instances))
    if name == "brkga":
        return _searching(options, _brkga(problem, options), options.brkga.generations)
    if name == "brkga-seeded":
        config = (policy := _policy(SEEDING, problem, options)).config
        # Genes are orders: what breeds has been drawn by the rule alone.
        by_rule = replace(config, policy=replace(config.policy, positions=()))
        greedy, draw = _policy_orders(problem, replace(policy, config=by_rule), options)
        seeds = partial(_stacked, greedy, draw, options.brkga.population)
        search = genetic(problem, options.brkga, objective, seeds)
        return _searching(options, search, options.brkga.generations)
    names = ("random", *SORTS, "best-of-N", "brkga", *learned, "brkga-seeded")
    raise UserError(f"unknown method '{name}': choose from {', '.join(names)} (N a whole number)")


def _learned(
    network: str, how: str, count: int, problem: Problem, options: MethodOptions
) -> Method:
    """What the policy decides, or a search among it: `how` is one of `Network.searches`."""
    policy, objective = _policy(network, problem, options), grid_costs()[options.objective]
    greedy, draw = _policy_orders(problem, policy, options)
    if how == "best-of-N":
        return _best_of(problem, draw, count, objective)
    if how == "beam-N":
        return Method(partial(_beam, problem, policy, options, count, objective))
    if how == "search":
        search = bin_by_bin(problem, greedy, draw, objective, options.width, options.draws)
        if options.breeding:
            breeding = _brkga(problem, options)
            search = evolved(problem, search, orders_found, breeding, objective, options.breeding)
        return _searching(options, search, options.rounds)
    return Method(greedy)


def _policy(network: str, problem: Problem, options: MethodOptions) -> Policy:
    """The given policy, or the shipped one for the problem's dimension.

    Raises:
        UserError: where it is of another kind or for another dimension.
    """
    dimension = len(problem.axes)
    shipped = options.shipped if options.shipped.startswith(network) else ""
    policy = options.policy or load_policy(shipped or f"{network}-{dimension}d")
    theirs = policy.config.policy.name
    if theirs != network:
        raise UserError(
            f"method '{network}': the policy given is of kind {theirs}, name another run"
        )
    if len(policy.config.problem.axes) != dimension:
        raise UserError(
            f"method '{network}': the policy given is for {len(policy.config.problem.axes)}D, the "
            f"problem is {dimension}D; name another run"
        )
    return policy


def _policy_orders(problem: Problem, policy: Policy, options: MethodOptions) -> tuple[Orders, Draw]:
    """Its greedy orders and its samples."""

    def decide(instances: Instance, keys: Array | None = None) -> Any:
        network = policy.config.policy
        decided = network.orders(problem, policy.params, instances, keys, options.kinds)
        return _decided(instances, decided)

    def greedy(keys: Array, instances: Instance) -> Any:
        return decide(instances)

    def draw(keys: Array, instances: Instance) -> Any:
        return decide(instances, keys)

    return greedy, draw


def _decided(instances: Instance, decisions: Decisions) -> Any:
    """Orders alone where nothing else was decided."""
    alone = instances.turned is None and decisions.place is None
    return decisions.order if alone else decisions


def _best_of(problem: Problem, draw: Draw, samples: int, objective: Objective) -> Method:
    """The best of a count; as a search it goes on drawing, so many at a time."""
    orders = partial(best_of, problem, draw=draw, samples=samples, objective=objective)
    return Method(orders, sampling(problem, draw, objective, min(samples, 50)))


def _beam(
    problem: Problem,
    policy: Policy,
    options: MethodOptions,
    width: int,
    objective: Objective,
    keys: Array,
    instances: Instance,
) -> Any:
    network = policy.config.policy
    beams = network.beams(problem, policy.params, instances, width, options.kinds)

    def best(instance: Instance, orders: Any) -> Any:
        repeated = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (width, *leaf.shape)), instance)
        costs = jax.vmap(objective)(repeated, pack_orders(problem, repeated, orders))
        return jax.tree.map(lambda leaf: leaf[jnp.argmin(costs)], orders)

    return jax.vmap(best)(instances, _decided(instances, beams))


def _brkga(problem: Problem, options: MethodOptions) -> Search:
    def sorts(keys: Array, instances: Instance) -> Array:
        return jnp.stack([jax.vmap(sort)(instances) for sort in SORTS.values()], 1)

    objective = grid_costs()[options.objective]
    return genetic(problem, options.brkga, objective, sorts if options.brkga_seeded else None)


def _stacked(
    greedy: Orders, draw: Draw, population: int, keys: Array, instances: Instance
) -> Array:
    """The policy's greedy order and its samples, of items as their sizes are: int32 [B, K, N]."""
    instances = instances._replace(turned=None)
    samples = min(SEED_SAMPLES, population // 4)
    each = jax.vmap(lambda key: jax.random.split(key, samples))(keys).reshape(-1)
    repeated = jax.tree.map(lambda leaf: jnp.repeat(leaf, samples, 0), instances)
    best = greedy(keys, instances)[:, None]
    if not samples:
        return best
    return jnp.concatenate([best, draw(each, repeated).reshape(len(keys), samples, -1)], 1)


def _searching(options: MethodOptions, search: Search, rounds: int) -> Method:
    orders = partial(run_rounds, search, rounds=rounds)
    return Method(orders, search, options.time_limit)
