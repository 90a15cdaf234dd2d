"""Packing a batch with the bin-aware policy: greedily, by sampling, and with a memory of it."""

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.learning.bin_network import Sight, look, scores
from jaxpack.learning.parameters import Params
from jaxpack.model.problem import Instance, Problem
from jaxpack.packing.env import Choice, Decisions, State, compact, decisions_of, reset, step
from jaxpack.packing.surface_view import view_of
from jaxpack.packing.table import Table
from jaxpack.packing.view import View
from jaxpack.xla.pieces import in_pieces

if TYPE_CHECKING:
    from jaxpack.learning.bin_aware import BinAwareConfig

# Shares of the steps after which kinds of which nothing remains are dropped: a third less to
# score. Every stretch compiles for itself, so few kinds (2D) do without.
COMPACTED = (0.4, 0.7)
FEW_KINDS = 32

LANES = Table.lanes


class Trace(NamedTuple):
    """What the network saw at T steps of a batch, and what was chosen."""

    sight: Sight  # leaves [T, ...]
    row: Array  # int32 [T, B], that was chosen; of no meaning where nothing fits


def choose_orders(
    network: "BinAwareConfig",
    problem: Problem,
    params: Params,
    instances: Instance,
    keys: Array | None = None,
    kinds: int | None = None,
    temperature: float | None = None,
) -> Decisions:
    """Decisions for a batch: sampled with a typed PRNG key each, greedy without; see `Network`."""
    return decide(network, view_of(problem), params, instances, keys, kinds, temperature)


def decide(
    network: "BinAwareConfig",
    view: View,
    params: Params,
    instances: Instance,
    keys: Array | None = None,
    kinds: int | None = None,
    temperature: float | None = None,
    cuts: tuple[float, ...] = COMPACTED,
) -> Decisions:
    """`choose_orders` on any surface.

    Every batch is cut into pieces of one shape, so what is decided of an instance does not depend
    on the batch. Items are turned too, where `Instance.turned` leaves a choice: what was packed is
    the order over `in_orientation(instance, orientation)`.

    Args:
        cuts: see `COMPACTED`; without any it compiles in a third of the time.
    """
    if temperature is None:
        temperature = network.temperature

    def orders(piece: tuple[Instance, Array | None]) -> Decisions:
        return _play(network, view, params, *piece, kinds, temperature, cuts)[0]

    return in_pieces(orders, (instances, keys), view.lanes)


def trace_choices(
    network: "BinAwareConfig",
    view: View,
    params: Params,
    instances: Instance,
    keys: Array,
    kinds: int,
) -> tuple[Decisions, list[Trace]]:
    """What `decide` samples, and what was seen and chosen: a trace per stretch of rows."""
    return _play(network, view, params, instances, keys, kinds, 1.0, COMPACTED, remember=True)


def _play(
    network: "BinAwareConfig",
    view: View,
    params: Params,
    instances: Instance,
    keys: Array | None,
    kinds: int | None,
    temperature: float,
    cuts: tuple[float, ...],
    remember: bool = False,
) -> tuple[Decisions, list[Trace]]:
    """(leaves [B, N]; the traces if they are to be remembered)."""
    last = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), instances)
    state = reset(view, last, kinds)
    items = instances.mask.shape[1]
    ways = 1 if instances.turned is None else instances.turned.shape[2]

    noise = jnp.zeros((items, *state.remaining.shape))
    if keys is not None:
        draw = jax.vmap(lambda key: jax.random.gumbel(key, noise.shape[:2]), out_axes=-1)
        noise = draw(keys)

    def play(state: State, noise: Array) -> tuple[State, tuple[Choice, Trace]]:
        sight = look(network, view, state)
        preference = scores(network, params, sight)
        row = jnp.argmax(preference + temperature * noise, 0).astype(jnp.int32)
        choice = state.kinds.choice(row)
        after = step(view, state, choice)
        done = ~sight.fits.any(0)
        chosen = Choice(jnp.where(done, items, choice.kind), choice.orientation)
        return after, (chosen, Trace(sight, row))

    def play_only(state: State, noise: Array) -> tuple[State, Choice]:
        """Without a trace to fill, the steps after the last item has been placed cost nothing."""

        def turn(state: State) -> tuple[State, Choice]:
            after, (choice, _) = play(state, noise)
            return after, choice

        def rest(state: State) -> tuple[State, Choice]:
            nothing = jnp.zeros(noise.shape[1:], jnp.int32)
            return state, Choice(nothing + items, nothing)

        return jax.lax.cond(state.remaining.any(), turn, rest, state)

    chosen: list[Choice] = []
    trace: list[Trace] = []
    cuts = cuts if state.remaining.shape[0] > FEW_KINDS else ()
    for start, end in pairwise((0, *(round(share * items) for share in cuts), items)):
        state = compact(state, ways * (items - start))
        noises = noise[start:end, : state.remaining.shape[0]]
        if remember:
            state, (choice, seen) = jax.lax.scan(play, state, noises)
            trace.append(seen)
        else:
            state, choice = jax.lax.scan(play_only, state, noises)
        chosen.append(choice)
    kind, orientation, _ = jax.tree.map(lambda *stretches: jnp.concatenate(stretches), *chosen)
    return decisions_of(state.kinds, kind, orientation), trace
