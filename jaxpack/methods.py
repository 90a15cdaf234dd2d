"""Methods by name: each makes orders for a batch of instances."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.errors import UserError
from jaxpack.io.weights import load_policy
from jaxpack.learning.beam import beam_orders
from jaxpack.learning.bin_network import BinAwareConfig
from jaxpack.learning.policies import greedy_orders, sample_orders
from jaxpack.learning.recipe import OBJECTIVES, Policy
from jaxpack.model.problem import Instance, Problem
from jaxpack.search.bin_by_bin import bin_by_bin, orders_found
from jaxpack.search.brkga import BrkgaConfig, genetic
from jaxpack.search.evolved import evolved
from jaxpack.search.heuristics import footprint_order, height_order, random_order, volume_order
from jaxpack.search.protocol import Draw, Objective, Search, pack_orders, run_rounds
from jaxpack.search.sampling import best_of, sampling

Orders = Callable[[Array, Instance], Array]
"""(typed PRNG keys [B], instances [B, ...]) -> orders int32 [B, N]. Pure; jit it."""

SORTS = {"volume": volume_order, "footprint": footprint_order, "height": height_order}
NAMES = (
    "random", *SORTS, "best-of-N", "brkga", "pointer", "bin-aware", "bin-aware-best-of-N",
    "bin-aware-beam-N", "bin-aware-search", "brkga-seeded",
)  # fmt: skip
SEARCHES = ("brkga", "brkga-seeded", "bin-aware-search")  # no count: a time limit may end them
SEED_SAMPLES = 16  # of the policy's orders for brkga-seeded, and a quarter of it, at most


@dataclass(frozen=True)
class MethodOptions:
    """What the methods that search or learn need to know."""

    objective: str = "bins"  # of everything that searches: bins first, or the paper's R
    brkga: BrkgaConfig = BrkgaConfig()  # of brkga and brkga-seeded
    brkga_seeded: bool = True  # start brkga from the sorts
    policy: Policy | None = None  # of pointer or of bin-aware; the shipped ones where it is not
    bin_aware: str | None = None  # the shipped one's name, else that of the problem's dimension
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
        name: random, volume, footprint, height, best-of-N, brkga, pointer, bin-aware,
            bin-aware-best-of-N, bin-aware-beam-N, bin-aware-search or brkga-seeded.
        problem: the rules that it packs by.
        options: what a method that searches or learns needs to know.

    Returns:
        Its `orders(keys, instances)` is pure, jit it: typed PRNG keys [B] and instances [B, ...] to
        orders int32 [B, N]. See `compare`.

    Raises:
        UserError: where there is none, naming those there are; or the policy given is of another
            kind or for another dimension.
    """
    objective = OBJECTIVES[options.objective]
    if name == "random":
        return Method(jax.vmap(random_order))
    if name in SORTS:
        return Method(lambda keys, instances: jax.vmap(SORTS[name])(instances))
    if match := re.fullmatch(r"best-of-([1-9]\d{0,6})", name):
        return _best_of(problem, jax.vmap(random_order), int(match[1]), objective)
    if name == "brkga":
        return _searching(options, _brkga(problem, options), options.brkga.generations)
    if name == "pointer":
        return Method(_greedy(problem, _policy("pointer", problem, options), options))
    if name.startswith("bin-aware") or name == "brkga-seeded":
        return _bin_aware(name, problem, options, objective)
    raise UserError(_unknown(name))


def _unknown(name: str) -> str:
    return f"unknown method '{name}': choose from {', '.join(NAMES)} (N a whole number)"


def _bin_aware(name: str, problem: Problem, options: MethodOptions, objective: Objective) -> Method:
    policy = _policy("bin-aware", problem, options)
    greedy = _greedy(problem, policy, options)
    network = policy.config.policy
    assert isinstance(network, BinAwareConfig)

    def draw(keys: Array, instances: Instance) -> Array:
        return sample_orders(
            problem, network, policy.params, instances, keys, options.kinds, network.temperature
        )

    if name == "bin-aware":
        return Method(greedy)
    if match := re.fullmatch(r"bin-aware-best-of-([1-9]\d{0,6})", name):
        return _best_of(problem, draw, int(match[1]), objective)
    if match := re.fullmatch(r"bin-aware-beam-([1-9]\d{0,3})", name):
        return Method(partial(_beam, problem, policy, options, int(match[1]), objective))
    if name == "brkga-seeded":

        def seeds(keys: Array, instances: Instance) -> Array:
            return _stacked(greedy, draw, keys, instances, options.brkga.population)

        search = genetic(problem, options.brkga, objective, seeds)
        return _searching(options, search, options.brkga.generations)
    if name == "bin-aware-search":
        search = bin_by_bin(problem, greedy, draw, objective, options.width, options.draws)
        if options.breeding:
            breeding = _brkga(problem, options)
            search = evolved(problem, search, orders_found, breeding, objective, options.breeding)
        return _searching(options, search, options.rounds)
    raise UserError(_unknown(name))


def _policy(kind: str, problem: Problem, options: MethodOptions) -> Policy:
    """The given policy, or the shipped one for the problem's dimension.

    Raises:
        UserError: where it is of another kind or for another dimension.
    """
    dimension = len(problem.axes)
    shipped = options.bin_aware if kind == "bin-aware" else None
    policy = options.policy or load_policy(shipped or f"{kind}-{dimension}d")
    theirs = "bin-aware" if isinstance(policy.config.policy, BinAwareConfig) else "pointer"
    if theirs != kind:
        raise UserError(f"method '{kind}': the policy given is of kind {theirs}, name another run")
    if len(policy.config.problem.axes) != dimension:
        raise UserError(
            f"method '{kind}': the policy given is for {len(policy.config.problem.axes)}D, the "
            f"problem is {dimension}D; name another run"
        )
    return policy


def _greedy(problem: Problem, policy: Policy, options: MethodOptions) -> Orders:
    def orders(keys: Array, instances: Instance) -> Array:
        return greedy_orders(problem, policy.config.policy, policy.params, instances, options.kinds)

    return orders


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
) -> Array:
    network = policy.config.policy
    assert isinstance(network, BinAwareConfig)
    beams = beam_orders(problem, network, policy.params, instances, width, options.kinds)

    def best(instance: Instance, orders: Array) -> Array:
        repeated = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (width, *leaf.shape)), instance)
        costs = jax.vmap(objective)(repeated, pack_orders(problem, repeated, orders))
        return orders[jnp.argmin(costs)]

    return jax.vmap(best)(instances, beams)


def _brkga(problem: Problem, options: MethodOptions) -> Search:
    def sorts(keys: Array, instances: Instance) -> Array:
        return jnp.stack([jax.vmap(sort)(instances) for sort in SORTS.values()], 1)

    objective = OBJECTIVES[options.objective]
    return genetic(problem, options.brkga, objective, sorts if options.brkga_seeded else None)


def _stacked(
    greedy: Orders, draw: Draw, keys: Array, instances: Instance, population: int
) -> Array:
    """The policy's greedy order and its samples: int32 [B, K, N]."""
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
