"""The two policies behind one set of functions: a network config names which one is meant.

All functions take a batch of instances, leaves [B, ...], and return orders int32 [B, N]; items stay
as `Instance.size` has them. The pointer network, and Flax with it, is imported where it is used.
"""

import jax
from jax import Array

from jaxpack.learning.bin_network import BinAwareConfig, init_network
from jaxpack.learning.parameters import Params, PointerConfig
from jaxpack.learning.rollout import choose_orders
from jaxpack.model.problem import Instance, Problem

Network = PointerConfig | BinAwareConfig


def init_policy(problem: Problem, network: Network, key: Array) -> Params:
    """Fresh weights. `key` is a typed PRNG key, consumed."""
    if isinstance(network, PointerConfig):
        from jaxpack.learning.pointer import init_pointer

        return init_pointer(problem, network, key)
    return init_network(network, key)


def greedy_orders(
    problem: Problem,
    network: Network,
    params: Params,
    instances: Instance,
    kinds: int | None = None,
) -> Array:
    """The most probable choice at every step. `kinds`: see `choose_orders`."""
    if isinstance(network, PointerConfig):
        from jaxpack.learning.pointer import greedy_order

        return jax.vmap(lambda one: greedy_order(problem, network, params, one))(instances)
    fixed = instances._replace(turned=None)
    return choose_orders(problem, network, params, fixed, kinds=kinds)[0]


def sample_orders(
    problem: Problem,
    network: Network,
    params: Params,
    instances: Instance,
    keys: Array,
    kinds: int | None = None,
    temperature: float = 1.0,
) -> Array:
    """Orders drawn from the policy with a typed PRNG key each: keys [B].

    `kinds` and `temperature`: see `choose_orders`; the pointer network has neither.
    """
    if isinstance(network, PointerConfig):
        from jaxpack.learning.pointer import sample_order

        draw = jax.vmap(lambda one, key: sample_order(problem, network, params, one, key).order)
        return draw(instances, keys)
    fixed = instances._replace(turned=None)
    return choose_orders(problem, network, params, fixed, keys, kinds, temperature)[0]
