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
from jaxpack.learning.rollout import LANES
from jaxpack.model.problem import Instance, Problem
from jaxpack.packing.env import Decisions, decisions_of, reset, step
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

    def decide(piece: Instance) -> Decisions:
        return _beams(problem, network, params, piece, width, kinds)

    return in_pieces(decide, instances, max(1, LANES // width))


def _beams(
    problem: Problem,
    network: "BinAwareConfig",
    params: Params,
    instances: Instance,
    width: int,
    kinds: int | None,
) -> Decisions:
    batch, items = instances.mask.shape
    lanes = batch * width
    repeated = jax.tree.map(lambda leaf: jnp.repeat(leaf, width, 0), instances)
    last = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), repeated)
    fixed, state = reset(problem, last, kinds)
    K = state.remaining.shape[0]
    # At first all slots but the first are empty: their one state must not be taken width times.
    total = jnp.where(jnp.arange(width) == 0, 0.0, MASKED * items)
    total = jnp.broadcast_to(total, (batch, width))

    def advance(carry: tuple, index: Array) -> tuple[tuple, None]:
        state, total, *chosen = carry
        state, choices, sight = look(problem, network, fixed, state)
        log_probs = scores(network, params, sight)
        done = ~choices.fits.any(0)
        # A finished packing goes on as it is: one continuation, free.
        log_probs = log_probs.at[0].set(jnp.where(done, 0.0, log_probs[0]))
        after = total[:, :, None] + log_probs.T.reshape(batch, width, K)
        parent, kind, total = _monotone(after)
        source = (jnp.arange(batch)[:, None] * width + parent).reshape(-1)
        state, choices, chosen, done = jax.tree.map(
            lambda leaf: leaf[..., source], (state, choices, chosen, done)
        )
        kind = kind.reshape(-1)
        state = step(problem, fixed, state, choices, kind)
        label, orientation = (
            jnp.take_along_axis(column, kind[None], 0)[0]
            for column in (fixed.label, fixed.orientation)
        )
        now = jnp.where(done, items, label), orientation
        chosen = [column.at[index].set(one) for column, one in zip(chosen, now, strict=True)]
        return (state, total, *chosen), None

    nothing = jnp.full((items, lanes), items, jnp.int32)
    start: Any = (state, total, nothing, nothing)
    (_, _, *chosen), _ = jax.lax.scan(advance, start, jnp.arange(items))
    decisions = decisions_of(fixed, *chosen)
    return jax.tree.map(lambda leaf: leaf.reshape(batch, width, items), decisions)


def _monotone(after: Array) -> tuple[Array, Array, Array]:
    """(parent, kind, total) of the new slots, [B, width] each, from [B, width, K] totals."""
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
