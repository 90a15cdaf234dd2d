"""Beam search over the bin-aware policy, monotone in its width.

Slot 0 keeps what greedy does. Slot j takes the most probable continuation, so far, of slots 0
to j that no earlier slot took. A narrower beam is therefore the beginning of a wider one, and
more width is never worse (monotonic beam search, Lemons et al. 2022).
"""

from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.learning.bin_network import look, scores
from jaxpack.learning.parameters import MASKED, Params
from jaxpack.model.problem import Instance, Problem
from jaxpack.packing.env import (
    Choice,
    Decisions,
    State,
    choice_of,
    decisions_of,
    observe,
    reset,
    step,
)
from jaxpack.packing.surface_view import view_of
from jaxpack.packing.view import View
from jaxpack.xla.pieces import in_pieces

if TYPE_CHECKING:
    from jaxpack.learning.bin_aware import BinAwareConfig


def beam_orders(
    network: "BinAwareConfig",
    problem: Problem,
    params: Params,
    instances: Instance,
    width: int,
    kinds: int | None = None,
) -> Decisions:
    """Where the beams end, slot 0 the greedy one: leaves [B, width, N]. See `Network`."""
    view = view_of(problem, network.positions)

    def decide(piece: Instance) -> Decisions:
        return _beams(network, view, params, piece, width, kinds)

    return in_pieces(decide, instances, max(1, view.lanes // width))


def _beams(
    network: "BinAwareConfig",
    view: View,
    params: Params,
    instances: Instance,
    width: int,
    kinds: int | None,
) -> Decisions:
    batch, items = instances.mask.shape
    lanes = batch * width
    repeated = jax.tree.map(lambda leaf: jnp.repeat(leaf, width, 0), instances)
    last = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), repeated)
    # The kinds are the same for all slots of an instance: they need not go with what is chosen.
    fixed, *moving = reset(view, last, kinds)
    K = view.rules * len(fixed.kind)
    # At first all slots but the first are empty: their one state must not be taken width times.
    total = jnp.where(jnp.arange(width) == 0, 0.0, MASKED * items)
    total = jnp.broadcast_to(total, (batch, width))

    def advance(carry: tuple, index: Array) -> tuple[tuple, None]:
        moving, total, chosen = carry
        state = State(fixed, *moving)
        choices = observe(view, state)
        sight = look(network, view, state, choices)
        log_probs = scores(network, params, sight)
        done = ~sight.fits.any(0)
        # A finished packing goes on as it is: one continuation, free.
        log_probs = log_probs.at[0].set(jnp.where(done, 0.0, log_probs[0]))
        after = total[:, :, None] + log_probs.T.reshape(batch, width, K)
        parent, row, total = _monotone(after)
        source = (jnp.arange(batch)[:, None] * width + parent).reshape(-1)
        moving, choices, chosen, done = jax.tree.map(
            lambda leaf: leaf[..., source], (moving, choices, chosen, done)
        )
        state = State(fixed, *moving)
        choice = choice_of(view, state, choices, row.reshape(-1))
        _, *moving = step(view, state, choice)
        now = choice._replace(kind=jnp.where(done, items, choice.kind))
        chosen = jax.tree.map(lambda column, one: column.at[index].set(one), chosen, now)
        return (moving, total, chosen), None

    nothing = jnp.full((items, lanes), items, jnp.int32)
    corner = (nothing.astype(view.dtype),) * 2 if view.rules > 1 else None
    start: Any = (moving, total, Choice(nothing, nothing, corner))
    (_, _, chosen), _ = jax.lax.scan(advance, start, jnp.arange(items))
    decisions = decisions_of(fixed, chosen)
    return jax.tree.map(lambda leaf: leaf.reshape(batch, width, items), decisions)


def _monotone(after: Array) -> tuple[Array, Array, Array]:
    """(parent, row, total) of the new slots, [B, width] each, from [B, width, K] totals."""
    batch, width, K = after.shape
    flat = after.reshape(batch, -1)
    parents = jnp.arange(width * K) // K
    member = jnp.arange(batch)

    def fill(open_: Array, slot: Array) -> tuple[Array, tuple[Array, Array]]:
        allowed = jnp.where(open_ & (parents <= slot), flat, -jnp.inf)
        best = jnp.argmax(allowed, 1)
        return open_.at[member, best].set(False), (best, allowed[member, best])

    _, (best, total) = jax.lax.scan(fill, jnp.ones(flat.shape, bool), jnp.arange(width))
    # Empty slots stay empty, and finite: sums of the floor would lose their last digits.
    return best.T // K, best.T % K, jnp.maximum(total.T, MASKED * 100)
