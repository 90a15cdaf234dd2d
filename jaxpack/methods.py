"""Methods by name: each is a function that makes an order."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import jax.numpy as jnp
from jax import Array

from jaxpack.errors import UserError
from jaxpack.files.weights import Policy
from jaxpack.learning.pointer import greedy_order
from jaxpack.packing.metrics import bins_first_cost, paper_cost
from jaxpack.packing.problem import Instance, Problem
from jaxpack.solvers.brkga import BrkgaConfig, brkga
from jaxpack.solvers.heuristics import footprint_order, height_order, random_order, volume_order
from jaxpack.solvers.sampling import best_of

Method = Callable[[Array, Instance], Array]
"""(typed PRNG key, one instance) -> order int32 [N]. Pure; jit and vmap it."""

OBJECTIVES = {"bins": bins_first_cost, "paper": paper_cost}
SORTS = {"volume": volume_order, "footprint": footprint_order, "height": height_order}
NAMES = ("random", *SORTS, "best-of-N", "brkga", "pointer")


@dataclass(frozen=True)
class MethodOptions:
    """What the methods that search or learn need to know."""

    objective: str = "bins"  # of best-of-N and brkga: bins first, or the paper's R
    brkga: BrkgaConfig = BrkgaConfig()
    brkga_seeded: bool = True  # start brkga from the sorts
    policy: Policy | None = None  # of pointer


def make_method(name: str, problem: Problem, options: MethodOptions) -> Method:
    """The method with this name. Raises UserError where there is none, naming those there are."""
    objective = OBJECTIVES[options.objective]
    if name == "random":
        return random_order
    if name in SORTS:
        return lambda key, instance: SORTS[name](instance)
    if match := re.fullmatch(r"best-of-([1-9]\d{0,6})", name):
        samples = int(match[1])
        return lambda key, instance: best_of(
            problem, key, instance, random_order, samples, objective
        )
    if name == "brkga":
        return partial(_brkga, problem, options)
    if name == "pointer":
        if options.policy is None:
            raise UserError("method 'pointer' has no policy here: name a run with --run")
        config, params = options.policy.config.policy, options.policy.params
        return lambda key, instance: greedy_order(problem, config, params, instance)
    raise UserError(f"unknown method '{name}': choose from {', '.join(NAMES)} (N a whole number)")


def _brkga(problem: Problem, options: MethodOptions, key: Array, instance: Instance) -> Array:
    sorts = jnp.stack([sort(instance) for sort in SORTS.values()])
    return brkga(
        problem,
        key,
        instance,
        options.brkga,
        OBJECTIVES[options.objective],
        sorts if options.brkga_seeded else None,
    )
