"""Packing a batch with the bin-aware policy: greedily, by sampling, and with a memory of it."""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.learning.bin_aware import BinState, Kinds, compact, order_of, reset, step
from jaxpack.learning.bin_network import BinAwareConfig, Sight, look, scores
from jaxpack.learning.parameters import Params
from jaxpack.packing.problem import Instance, Problem

T = TypeVar("T")
U = TypeVar("U")

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
    problem: Problem,
    config: BinAwareConfig,
    params: Params,
    instances: Instance,
    keys: Array | None = None,
    kinds: int | None = None,
    temperature: float = 1.0,
) -> Array:
    """Orders of a batch: sampled with a typed PRNG key each (keys [B]), greedy without.

    Args:
        instances: leaves [B, ...].
        kinds: K, at least the number of distinct sizes in an instance; N if not given. Fewer
            are faster.
        temperature: samples are drawn from probabilities to the power of 1 / temperature.

    Returns:
        int32 [B, N].
    """

    def orders(piece: tuple[Instance, Array | None]) -> Array:
        chosen, _ = _play(problem, config, params, *piece, kinds, temperature, remember=False)
        return chosen

    return in_pieces(orders, (instances, keys), LANES)


def in_pieces(function: Callable[[T], U], batch: T, size: int) -> U:
    """A batched function (leaves [B, ...] -> [B, ...]) in pieces of `size`, one after the other.

    The last piece is filled up with its last member.
    """
    count = len(jax.tree.leaves(batch)[0])
    rows = jnp.minimum(jnp.arange(-(-count // size) * size), count - 1).reshape(-1, size)
    done = jax.lax.map(lambda piece: function(jax.tree.map(lambda leaf: leaf[piece], batch)), rows)
    return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:])[:count], done)


def trace_choices(
    problem: Problem,
    config: BinAwareConfig,
    params: Params,
    instances: Instance,
    keys: Array,
    kinds: int,
) -> tuple[Array, list[Trace]]:
    """Sampled orders int32 [B, N] and what was seen and chosen: a trace per stretch of equal K."""
    return _play(problem, config, params, instances, keys, kinds, 1.0, remember=True)


def _play(
    problem: Problem,
    config: BinAwareConfig,
    params: Params,
    instances: Instance,
    keys: Array | None,
    kinds: int | None,
    temperature: float,
    remember: bool,
) -> tuple[Array, list[Trace]]:
    """(orders int32 [B, N], the traces if they are to be remembered)."""
    last = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), instances)
    fixed, state = reset(problem, last, kinds)
    items = instances.mask.shape[1]

    noise = jnp.zeros((items, *state.remaining.shape))
    if keys is not None:
        draw = jax.vmap(lambda key: jax.random.gumbel(key, noise.shape[:2]), out_axes=-1)
        noise = draw(keys)

    def choose(fixed: Kinds, state: BinState, noise: Array) -> tuple[BinState, tuple[Array, Trace]]:
        state, choices, sight = look(problem, config, fixed, state)
        preference = scores(config, params, sight)
        kind = jnp.argmax(preference + temperature * noise, 0).astype(jnp.int32)
        label = jnp.take_along_axis(fixed.label, kind[None], 0)[0]
        label = jnp.where(choices.fits.any(0), label, items)
        after = step(problem, fixed, state, choices, kind)
        return after, (label, Trace(sight, kind))

    def choose_label(fixed: Kinds, state: BinState, noise: Array) -> tuple[BinState, Array]:
        """Without a trace to fill, the steps after the last item has been placed cost nothing."""

        def turn(state: BinState) -> tuple[BinState, Array]:
            after, (label, _) = choose(fixed, state, noise)
            return after, label

        def rest(state: BinState) -> tuple[BinState, Array]:
            return state, jnp.full(noise.shape[1:], items)

        return jax.lax.cond(state.remaining.any(), turn, rest, state)

    labels: list[Array] = []
    trace: list[Trace] = []
    cuts = COMPACTED if state.remaining.shape[0] > FEW_KINDS else ()
    for start, end in pairwise((0, *(round(share * items) for share in cuts), items)):
        fixed, state = compact(fixed, state, items - start)
        rows = state.remaining.shape[0]
        noises = noise[start:end, :rows]
        if remember:
            state, (label, seen) = jax.lax.scan(partial(choose, fixed), state, noises)
            trace.append(seen)
        else:
            state, label = jax.lax.scan(partial(choose_label, fixed), state, noises)
        labels.append(label)
    return order_of(fixed, jnp.concatenate(labels)).T, trace
