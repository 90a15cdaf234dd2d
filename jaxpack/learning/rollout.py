"""Packing a batch with the bin-aware policy: greedily, by sampling, and with a memory of it."""

from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.learning.bin_network import Sight, look, scores
from jaxpack.learning.parameters import Params
from jaxpack.model.problem import Instance, Problem
from jaxpack.packing.env import (
    BinState,
    Decisions,
    Kinds,
    compact,
    decisions_of,
    reset,
    step,
)
from jaxpack.xla.pieces import in_pieces

if TYPE_CHECKING:
    from jaxpack.learning.bin_aware import BinAwareConfig

Choice = tuple[Array, Array]  # label of the kind and orientation, int32 [B] each

# Instances side by side. What the network holds of 64 stays in a core's cache, and since every
# batch is cut into pieces of this one shape, an instance's order does not depend on the batch.
LANES = 64

# Shares of the steps after which kinds of which nothing remains are dropped: a third less to
# score. Every stretch compiles for itself, so few kinds (2D) do without.
COMPACTED = (0.4, 0.7)
FEW_KINDS = 32


class Trace(NamedTuple):
    """What the network saw at T steps of a batch, and what was chosen."""

    sight: Sight  # leaves [T, ...]
    kind: Array  # int32 [T, B], the row chosen; of no meaning where nothing fits


def choose_orders(
    network: "BinAwareConfig",
    problem: Problem,
    params: Params,
    instances: Instance,
    keys: Array | None = None,
    kinds: int | None = None,
    temperature: float | None = None,
) -> Decisions:
    """Decisions for a batch: sampled with a typed PRNG key each, greedy without; see `Network`.

    Items are turned too, where `Instance.turned` leaves a choice: what was packed is the order
    over `in_orientation(instance, orientation)`.
    """
    if temperature is None:
        temperature = network.temperature

    def orders(piece: tuple[Instance, Array | None]) -> Decisions:
        return _play(problem, network, params, *piece, kinds, temperature, remember=False)[0]

    return in_pieces(orders, (instances, keys), LANES)


def trace_choices(
    problem: Problem,
    network: "BinAwareConfig",
    params: Params,
    instances: Instance,
    keys: Array,
    kinds: int,
) -> tuple[Decisions, list[Trace]]:
    """What `choose_orders` samples, and what was seen and chosen: a trace per stretch of rows."""
    return _play(problem, network, params, instances, keys, kinds, 1.0, remember=True)


def _play(
    problem: Problem,
    network: "BinAwareConfig",
    params: Params,
    instances: Instance,
    keys: Array | None,
    kinds: int | None,
    temperature: float,
    remember: bool,
) -> tuple[Decisions, list[Trace]]:
    """(leaves [B, N]; the traces if they are to be remembered)."""
    last = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), instances)
    fixed, state = reset(problem, last, kinds)
    items = instances.mask.shape[1]
    ways = 1 if instances.turned is None else instances.turned.shape[2]

    noise = jnp.zeros((items, *state.remaining.shape))
    if keys is not None:
        draw = jax.vmap(lambda key: jax.random.gumbel(key, noise.shape[:2]), out_axes=-1)
        noise = draw(keys)

    def play(fixed: Kinds, state: BinState, noise: Array) -> tuple[BinState, tuple[Choice, Trace]]:
        state, choices, sight = look(problem, network, fixed, state)
        preference = scores(network, params, sight)
        kind = jnp.argmax(preference + temperature * noise, 0).astype(jnp.int32)
        label, orientation = (
            jnp.take_along_axis(column, kind[None], 0)[0]
            for column in (fixed.label, fixed.orientation)
        )
        label = jnp.where(choices.fits.any(0), label, items)
        after = step(problem, fixed, state, choices, kind)
        return after, ((label, orientation), Trace(sight, kind))

    def play_only(fixed: Kinds, state: BinState, noise: Array) -> tuple[BinState, Choice]:
        """Without a trace to fill, the steps after the last item has been placed cost nothing."""

        def turn(state: BinState) -> tuple[BinState, Choice]:
            after, (choice, _) = play(fixed, state, noise)
            return after, choice

        def rest(state: BinState) -> tuple[BinState, Choice]:
            nothing = jnp.zeros(noise.shape[1:], jnp.int32)
            return state, (nothing + items, nothing)

        return jax.lax.cond(state.remaining.any(), turn, rest, state)

    chosen: list[Choice] = []
    trace: list[Trace] = []
    cuts = COMPACTED if state.remaining.shape[0] > FEW_KINDS else ()
    for start, end in pairwise((0, *(round(share * items) for share in cuts), items)):
        fixed, state = compact(fixed, state, ways * (items - start))
        rows = state.remaining.shape[0]
        noises = noise[start:end, :rows]
        if remember:
            state, (choice, seen) = jax.lax.scan(partial(play, fixed), state, noises)
            trace.append(seen)
        else:
            state, choice = jax.lax.scan(partial(play_only, fixed), state, noises)
        chosen.append(choice)
    label, orientation = (jnp.concatenate(column) for column in zip(*chosen, strict=True))
    return decisions_of(fixed, label, orientation), trace
