"""Search bin by bin: keep the best ways to fill the first bin, then those to fill the second.

Whole orders are drawn, W * M of them per instance and round, but only their next bin is kept:
the W packings whose first bins hold the most go on, each with M new draws for what they left.
N draws of a whole order must be lucky in every bin at once; here every bin has its own luck.
Since every draw is packed to the end and judged, the best whole packing is there at any time.
After the last bin the next pass begins with empty bins.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.errors import UserError
from jaxpack.model.problem import Instance, Problem
from jaxpack.packing.env import Decisions
from jaxpack.search.protocol import Draw, Objective, Orders, Search, better, pack_orders


class Beams(NamedTuple):
    """The W partial packings, as whole orders of which the first bins count, and the best."""

    key: Array  # typed PRNG keys [B], never change
    round: Array  # int32[]
    filled: Array  # int32 [B], bins that count in this pass
    order: Orders  # [B, W, N]
    bin: Array  # int32 [B, W, N], bin of every item
    best_cost: Array  # float32 [B]
    best: Orders


def bin_by_bin(
    problem: Problem,
    first: Draw,
    draw: Draw,
    objective: Objective,
    width: int = 8,
    draws: int = 8,
) -> Search:
    """A round fills one more bin of every beam.

    Args:
        first: the orders to beat, such as a policy's greedy ones.
        draw: orders of what is left, such as a policy's samples.
        width: W, partial packings kept per instance.
        draws: M, orders drawn for each of them and round.

    Raises:
        UserError: where one of these is less than 1.
    """
    if width < 1 or draws < 1:
        raise UserError(f"width {width}, draws {draws}: give at least 1 of each")

    def start(keys: Array, instances: Instance) -> Beams:
        batch, items = instances.mask.shape
        best = first(keys, instances)
        packings = pack_orders(problem, instances, best)
        shape = batch, width, items
        order = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf[:, None], shape), best)
        return Beams(
            key=keys,
            round=jnp.int32(0),
            filled=jnp.zeros(batch, jnp.int32),
            order=order,
            bin=jnp.zeros(shape, jnp.int32),
            best_cost=jax.vmap(objective)(instances, packings),
            best=best,
        )

    advance = partial(_next_bin, problem, draw, objective, width, draws)
    return Search(start, advance, lambda state: state.best)


def _next_bin(
    problem: Problem,
    draw: Draw,
    objective: Objective,
    width: int,
    draws: int,
    instances: Instance,
    state: Beams,
) -> Beams:
    """One more bin of every beam is filled."""
    batch, items = instances.mask.shape
    children = width * draws

    def repeat(leaf: Array) -> Array:
        return jnp.repeat(leaf, children, 0)

    def of_beams(orders: Any) -> Any:
        return jax.tree.map(
            lambda leaf: jnp.repeat(leaf.reshape(batch * width, items), draws, 0), orders
        )

    def split(key: Array) -> Array:
        return jax.random.split(jax.random.fold_in(key, state.round), children)

    repeated, filled = jax.tree.map(repeat, (instances, state.filled))
    left = repeated.mask & (of_beams(state.bin) >= filled[:, None])
    drawn = draw(jax.vmap(split)(state.key).reshape(-1), repeated._replace(mask=left))
    orders = jax.vmap(_put_last)(of_beams(state.order), drawn, left)
    packings = pack_orders(problem, repeated, orders)
    costs = jax.vmap(objective)(repeated, packings)
    counted = jnp.arange(items) <= filled[:, None]
    held = jnp.where(counted, packings.volume, 0).sum(1)
    costs, held = costs.reshape(batch, children), held.reshape(batch, children)
    # Most volume in the first bins; the cost of the whole decides between equals.
    rank = jnp.lexsort((costs, -held))
    member = jnp.arange(batch)[:, None]

    def pick(orders: Any, which: Array) -> Any:
        return jax.tree.map(
            lambda leaf: leaf.reshape(batch, children, items)[member, which], orders
        )

    cheapest = jnp.argmin(costs, 1)[:, None]
    found = jax.tree.map(lambda leaf: leaf[:, 0], pick(orders, cheapest))
    best_cost, best = better(costs[member, cheapest][:, 0], found, state.best_cost, state.best)
    order, bin = pick(orders, rank[:, :width]), pick(packings.bin, rank[:, :width])
    # With one bin left to fill the pass is over: that bin was drawn already.
    over = state.filled + 2 >= bin.max((1, 2)) + 1
    return Beams(
        key=state.key,
        round=state.round + 1,
        filled=jnp.where(over, 0, state.filled + 1),
        order=order,
        bin=bin,
        best_cost=best_cost,
        best=best,
    )


def orders_found(state: Beams) -> Any:
    """The best order and those of the beams: leaves [B, 1 + W, N]."""
    return jax.tree.map(
        lambda one, others: jnp.concatenate([one[:, None], others], 1), state.best, state.order
    )


def _put_last(order: Any, drawn: Any, left: Array) -> Any:
    """`order` without the items that are left, then those in the drawn order: leaves [N]."""
    if isinstance(order, Decisions):
        by_item = jax.tree.map(partial(jnp.where, left), drawn[1:], order[1:])
        return Decisions(_put_last(order.order, drawn.order, left), *by_item)
    items = order.shape[0]
    place = jnp.arange(items, dtype=jnp.int32)
    rank = jnp.zeros(items, jnp.int32).at[order].set(place)
    late = jnp.zeros(items, jnp.int32).at[drawn].set(place)
    return jnp.argsort(jnp.where(left, items + late, rank)).astype(jnp.int32)
