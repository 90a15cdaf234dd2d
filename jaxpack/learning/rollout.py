"""Packing a batch with the bin-aware policy: greedily, by sampling, and with a memory of it."""

from collections.abc import Callable
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
    Choice,
    Decisions,
    State,
    choice_of,
    compact,
    decisions_of,
    observe,
    reset,
    step,
)
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
    """What the network saw at T of the steps of a batch, and what was chosen."""

    sight: Sight  # leaves [T, ...]
    row: Array  # int32 [T, B], that was chosen; of no meaning where nothing fits
    step: Array  # int32 [T], which steps these are
    weight: Array  # float32[], steps for each of these


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
    return decide(
        network, view_of(problem, network.positions), params, instances, keys, kinds, temperature
    )


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
    share: float = 1.0,
) -> tuple[Decisions, list[Trace]]:
    """What `decide` samples, and what was seen and chosen: a trace per stretch of rows.

    Args:
        share: of the steps, drawn at random, that are remembered. A sum over them, times
            `Trace.weight`, has the sum over all steps as its mean.
    """
    return _play(network, view, params, instances, keys, kinds, 1.0, COMPACTED, share)


def draw_steps(key: Array, steps: int, share: float) -> Array:
    """A share of so many steps, at least one, each as likely as any other: int32 [T], ascending.

    Args:
        key: a typed PRNG key, consumed.
    """
    count = max(1, round(share * steps))
    return jnp.sort(jax.random.permutation(key, steps)[:count])


def _play(
    network: "BinAwareConfig",
    view: View,
    params: Params,
    instances: Instance,
    keys: Array | None,
    kinds: int | None,
    temperature: float,
    cuts: tuple[float, ...],
    share: float = 0.0,
) -> tuple[Decisions, list[Trace]]:
    """(leaves [B, N]; a trace of this share of the steps of every stretch, none where it is 0)."""
    last = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), instances)
    state = reset(view, last, kinds)
    items = instances.mask.shape[1]
    ways = 1 if instances.turned is None else instances.turned.shape[2]

    noise = jnp.zeros((items, view.rules * len(state.remaining), len(instances.mask)))
    if keys is not None:
        draw = jax.vmap(lambda key: jax.random.gumbel(key, noise.shape[:2]), out_axes=-1)
        noise = draw(keys)

    def play(state: State, noise: Array) -> tuple[State, Choice, tuple[Sight, Array]]:
        choices = observe(view, state)
        sight = look(network, view, state, choices)
        preference = scores(network, params, sight)
        row = jnp.argmax(preference + temperature * noise, 0).astype(jnp.int32)
        choice = choice_of(view, state, choices, row)
        after = step(view, state, choice)
        done = ~sight.fits.any(0)
        choice = choice._replace(kind=jnp.where(done, items, choice.kind))
        return after, choice, (sight, row)

    def play_only(state: State, noise: Array) -> tuple[State, Choice]:
        """Without a trace to fill, the steps after the last item has been placed cost nothing."""

        def turn(state: State) -> tuple[State, Choice]:
            return play(state, noise)[:2]

        def rest(state: State) -> tuple[State, Choice]:
            nothing = jnp.zeros(noise.shape[-1:], jnp.int32)
            corner = (nothing.astype(view.dtype),) * 2 if view.rules > 1 else None
            return state, Choice(nothing + items, nothing, corner)

        return jax.lax.cond(state.remaining.any(), turn, rest, state)

    chosen: list[Choice] = []
    trace: list[Trace] = []
    cuts = cuts if state.remaining.shape[0] > FEW_KINDS else ()
    for start, end in pairwise((0, *(round(share * items) for share in cuts), items)):
        state = compact(state, ways * (items - start))
        noises = noise[start:end, : view.rules * len(state.remaining)]
        if share:
            assert keys is not None
            # A key of its own: those of the orders are used up.
            steps = draw_steps(jax.random.fold_in(keys[0], start), end - start, share)
            state, choice, seen = _remember(play, state, noises, steps)
            weight = jnp.float32((end - start) / len(steps))
            trace.append(Trace(*seen, start + steps, weight))
        else:
            state, choice = jax.lax.scan(play_only, state, noises)
        chosen.append(choice)
    choices = jax.tree.map(lambda *stretches: jnp.concatenate(stretches), *chosen)
    return decisions_of(state.kinds, choices), trace


def _remember(
    play: Callable, state: State, noises: Array, steps: Array
) -> tuple[State, Choice, tuple[Sight, Array]]:
    """Plays a stretch: (after it, all choices, what was seen and chosen at `steps`)."""
    *_, seen = jax.eval_shape(play, state, noises[0])
    kept = jax.tree.map(lambda leaf: jnp.zeros((len(steps) + 1, *leaf.shape), leaf.dtype), seen)

    def turn(carry: tuple, inputs: tuple[Array, Array]) -> tuple[tuple, Choice]:
        (state, kept), (step, noise) = carry, inputs
        state, choice, seen = play(state, noise)
        # A place is written over until its step has come. Behind the last there is one more.
        place = (steps < step).sum()
        put = partial(jax.lax.dynamic_update_index_in_dim, index=place, axis=0)
        return (state, jax.tree.map(put, kept, seen)), choice

    (state, kept), choice = jax.lax.scan(turn, (state, kept), (jnp.arange(len(noises)), noises))
    return state, choice, jax.tree.map(lambda leaf: leaf[:-1], kept)
