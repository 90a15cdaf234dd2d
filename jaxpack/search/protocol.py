"""Searches as pure functions, run for a number of rounds or for a number of seconds.

A search is over a batch of instances at once: leaves [B, ...], a typed PRNG key each.
"""

import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.sharding import Mesh

from jaxpack.model.problem import Instance, Packing, Problem, in_orientation
from jaxpack.packing.env import Decisions
from jaxpack.packing.first_fit import pack, pack_decisions
from jaxpack.xla.devices import PART, WHOLE, split_batch

Objective = Callable[[Instance, Packing], Array]
"""A cost to minimise: (instance, packing) -> float32 scalar. See `jaxpack.model.metrics`."""

Orders = Array | Decisions
"""Of a batch: int32 [B, N], for items as their sizes are; or, where `Instance.turned` leaves a
choice and it is made, with the orientations."""

Draw = Callable[[Array, Instance], Any]
"""Random `Orders`: (keys [B], instances [B, ...]) -> leaves [B, N], padding last."""


class Search(NamedTuple):
    """Pure functions; more rounds are never worse."""

    start: Callable[[Array, Instance], Any]  # (keys [B], instances) -> state
    advance: Callable[[Instance, Any], Any]  # (instances, state) -> state after one more round
    best: Callable[[Any], Any]  # state -> `Orders`, the best so far
    refine: Callable[[Instance, Any], Any] | None = None  # like `advance`, less and faster


def run_rounds(search: Search, keys: Array, instances: Instance, rounds: int) -> Any:
    """The best `Orders` after so many rounds. Pure; jit it."""
    state = search.start(keys, instances)

    def advance(state: Any, _: None) -> tuple[Any, None]:
        return search.advance(instances, state), None

    state, _ = jax.lax.scan(advance, state, None, length=rounds)
    return search.best(state)


def compile_search(
    search: Search, keys: Array, instances: Instance, mesh: Mesh | None = None
) -> Search:
    """The same search, compiled for batches of this shape: no run pays for compilation.

    Args:
        mesh: the devices that share a batch, from `data_mesh`.
    """
    state = jax.eval_shape(search.start, keys, instances)
    # Of a state every array is a batch, and what counts the rounds is the same for all.
    specs = jax.tree.map(lambda leaf: PART if leaf.ndim else WHOLE, state)
    start = jax.jit(split_batch(mesh, search.start, out_specs=specs)).lower(keys, instances)
    begin = start.compile()
    state = jax.tree.map(
        lambda leaf, place: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype, sharding=place),
        state,
        begin.output_shardings,
    )

    def compiled(advance: Callable[[Instance, Any], Any]) -> Callable[[Instance, Any], Any]:
        shared = split_batch(mesh, advance, (PART, specs), specs)
        return jax.jit(shared, donate_argnums=1).lower(instances, state).compile()

    return Search(
        begin,
        compiled(search.advance),
        jax.jit(split_batch(mesh, search.best, (specs,))).lower(state).compile(),
        compiled(search.refine) if search.refine else None,
    )


def run_for(search: Search, keys: Array, instances: Instance, seconds: float) -> Any:
    """The best `Orders` found in so many seconds.

    No round is begun that would end late if it took as long as the longest one so far; what is
    left of the time then goes to the search's smaller rounds, if it has any. The start always runs.

    Args:
        search: from `compile_search`, or compilation counts.
    """
    end = time.perf_counter() + seconds
    state = jax.block_until_ready(search.start(keys, instances))
    for advance in filter(None, (search.advance, search.refine)):
        longest, now = 0.0, time.perf_counter()
        while now + longest <= end:
            state = jax.block_until_ready(advance(instances, state))
            before, now = now, time.perf_counter()
            longest = max(longest, now - before)
    return search.best(state)


def pack_orders(problem: Problem, instances: Instance, orders: Orders) -> Packing:
    """`pack` over a batch."""
    if isinstance(orders, Decisions):
        return pack_decisions(problem, instances, orders)[1]
    return jax.vmap(partial(pack, problem))(instances, orders)


def lying(instances: Instance, orders: Orders) -> tuple[Instance, Array]:
    """(the instances with every item turned as decided, the orders alone)."""
    if isinstance(orders, Decisions):
        return jax.vmap(in_orientation)(instances, orders.orientation), orders.order
    return instances, orders


def like_drawn(draw: Draw, keys: Array, instances: Instance, order: Array) -> Orders:
    """An order (int32 [B, N]) as `draw` gives them: all else that it decides is left as it is."""
    drawn = jax.eval_shape(draw, keys, instances)
    if not isinstance(drawn, Decisions):
        return order
    nothing = jnp.zeros_like(order)
    return Decisions(order, nothing, None if drawn.place is None else nothing - 1)


def better(cost: Array, orders: Any, than_cost: Array, than: Any) -> tuple[Array, Any]:
    """(cost [B], orders), the cheaper of two; of equally good ones the second."""
    wins = cost < than_cost
    chosen = jax.tree.map(lambda one, other: jnp.where(wins[:, None], one, other), orders, than)
    return jnp.where(wins, cost, than_cost), chosen
