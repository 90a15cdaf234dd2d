"""Learning what a partly filled bin is worth, from greedy play: see `online_value`.

An update is one XLA program. B bins go on being filled, each by some steps; every bin that was met
is then told what became of it (lambda returns), and Adam moves the weights a few times. A bin is
seen in one of its eight reflections, the same for a whole minibatch.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax import Array

from jaxpack.learning.online_value import Step, greedy_step, init_value, worth
from jaxpack.learning.parameters import Params
from jaxpack.packing.online import Setting, State, empty

LANES = 16
"""Bins that a core fills at once: what is looked at of them stays in its cache."""


@dataclass(frozen=True)
class OnlineConfig:
    """How a value is learned. Hashable, static under jit."""

    setting: Setting  # the bin and its rules
    updates: int  # in all
    bins: int = 256  # B, filled side by side, a multiple of LANES
    steps: int = 16  # items that each takes in an update
    minibatch: int = 512  # bins of which a gradient is the mean
    trace: float = 0.7  # lambda: 0 is told the next value alone, 1 what the bin held in the end
    learning_rate: float = 2e-3  # of Adam, at the start; a cosine down to 3 % of it
    warm: int = 20  # updates until the rate is there
    average: float = 0.01  # share of the new weights in the averaged ones, at every step


class OnlineState(NamedTuple):
    """All that a run carries from update to update."""

    params: Params
    averaged: Params  # what is kept in the end
    optimizer: optax.OptState
    bins: State  # leaves [B / LANES, ...]
    used: Array  # float32 [B / LANES, LANES], share of each bin
    key: Array  # typed PRNG key[]; never changes
    update: Array  # int32[], updates done


class Steps(NamedTuple):
    """T steps of bins: [T, LANES], but for heights and firm [T, L, W, LANES]."""

    heights: Array
    firm: Array
    value: Array  # float32
    gain: Array  # float32, share of a bin that the item takes, 0 where there is no place for it
    fits: Array  # bool
    full: Array  # float32, what the bin held if the item did not fit, else -1


class OnlineMetrics(NamedTuple):
    """Of an update, float32 [] each."""

    loss: Array  # mean square of what the values are off by, in tenths of a bin
    use: Array  # mean share that was used of the bins that were filled
    filled: Array  # how many were


OPTIMIZER = optax.chain(optax.clip_by_global_norm(1.0), optax.scale_by_adam(b2=0.99))


def init_online(config: OnlineConfig, key: Array) -> OnlineState:
    """A run's first state. `key` gives weights, items and minibatches."""
    params = init_value(config.setting, jax.random.fold_in(key, 0))
    chunks = config.bins // LANES
    bins = jax.tree.map(
        lambda leaf: jnp.broadcast_to(leaf, (chunks, *leaf.shape)), empty(config.setting, LANES)
    )
    used, done = jnp.zeros((chunks, LANES)), jnp.int32(0)
    return OnlineState(params, params, OPTIMIZER.init(params), bins, used, key, done)


@partial(jax.jit, static_argnames="config")
def online_update(config: OnlineConfig, state: OnlineState) -> tuple[OnlineState, OnlineMetrics]:
    """One update."""
    of_items, of_batches = jax.random.split(jax.random.fold_in(state.key, state.update + 1))
    keys = jax.random.split(of_items, len(state.used))
    fill = partial(_fill, config, state.params)
    (bins, used), played = jax.lax.map(lambda chunk: fill(*chunk), (state.bins, state.used, keys))
    learn = partial(_learn, config, state.update, of_batches)
    (params, averaged, optimizer), losses = learn(
        (state.params, state.averaged, state.optimizer), played
    )
    full = played.full >= 0
    use = jnp.where(full, played.full, 0).sum() / jnp.maximum(full.sum(), 1)
    metrics = OnlineMetrics(losses.mean(), use, full.sum() * 1.0)
    now = OnlineState(params, averaged, optimizer, bins, used, state.key, state.update + 1)
    return now, metrics


def _fill(
    config: OnlineConfig, params: Params, bins: State, used: Array, key: Array
) -> tuple[tuple[State, Array], Steps]:
    """Each of LANES bins takes some items; one that has no place for its next item is emptied."""
    setting = config.setting
    volume = setting.problem.bin[0] * setting.problem.bin[1] * setting.problem.bin[2]
    fresh = empty(setting, LANES)

    def one(now: tuple[State, Array], key: Array) -> tuple[tuple[State, Array], Steps]:
        bins, used = now
        items = jax.random.randint(key, (3, LANES), 1, setting.high + 1)
        step: Step = greedy_step(setting, params, bins, items)
        gain = jnp.where(step.fits, items.prod(0) / volume, 0)
        full = jnp.where(step.fits, -1.0, used)
        played = Steps(step.heights, step.firm, step.value, gain, step.fits, full)
        bins = jax.tree.map(partial(jnp.where, step.fits), step.state, fresh)
        return (bins, jnp.where(step.fits, used + gain, 0)), played

    return jax.lax.scan(one, (bins, used), jax.random.split(key, config.steps))


def _learn(
    config: OnlineConfig, update: Array, key: Array, now: tuple, played: Steps
) -> tuple[tuple, Array]:
    """((params, averaged, optimizer) after every minibatch, the losses)."""
    # [chunks, T, ..., LANES] -> [..., every bin that was met but the last]
    heights, firm = (
        jnp.moveaxis(leaf[:, :-1], (0, 1), (2, 3)).reshape(*leaf.shape[2:4], -1)
        for leaf in (played.heights, played.firm)
    )
    told = returns(config.trace, played).reshape(-1)
    counts = played.fits[:, :-1].reshape(-1).astype(jnp.float32)
    of_order, of_sides = jax.random.split(key)
    batches = len(told) // config.minibatch
    order = jax.random.permutation(of_order, len(told))[: batches * config.minibatch]
    order = order.reshape(batches, -1)
    rate = config.learning_rate * jnp.minimum(1, (update + 1) / config.warm)
    rate *= optax.cosine_decay_schedule(1.0, config.updates, 0.03)(update)

    def step(now: tuple, batch: tuple[Array, Array]) -> tuple[tuple, Array]:
        (params, averaged, optimizer), (rows, side) = now, batch
        seen = [reflected(leaf[..., rows], side) for leaf in (heights, firm)]

        def loss(params: Params) -> Array:
            off = 10 * (worth(config.setting, params, *seen) - told[rows])
            return (counts[rows] * off**2).sum() / jnp.maximum(counts[rows].sum(), 1)

        value, gradient = jax.value_and_grad(loss)(params)
        direction, optimizer = OPTIMIZER.update(gradient, optimizer)
        params = jax.tree.map(lambda p, d: p - rate * d, params, direction)
        share = config.average
        averaged = jax.tree.map(lambda a, p: a + share * (p - a), averaged, params)
        return (params, averaged, optimizer), value

    sides = jax.random.randint(of_sides, (batches,), 0, 8)
    return jax.lax.scan(step, now, (order, sides))


def returns(trace: float, played: Steps) -> Array:
    """What each bin but the last is told: float32 [chunks, T - 1, LANES].

    The gain of the next item, and of the worth of the bin then a share `1 - trace` as the network
    has it and a share `trace` as it turned out; nothing where the item does not fit.

    Args:
        trace: lambda.
        played: leaves [chunks, T, ...]; of the last step the network's value is what turned out.
    """

    def before(turned_out: Array, step: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        value, gain, fits = step
        worth = (1 - trace) * value + trace * turned_out
        told = jnp.where(fits, gain + worth, 0)
        return told, told

    steps = [jnp.moveaxis(leaf, 1, 0) for leaf in (played.value, played.gain, played.fits)]
    following = (steps[0][1:], steps[1][1:], steps[2][1:])
    _, told = jax.lax.scan(before, steps[0][-1], following, reverse=True)
    return jnp.moveaxis(told, 0, 1)


def reflected(cells: Array, side: Array) -> Array:
    """One of the eight reflections and rotations of [L, W, *batch], L = W."""
    cells = jnp.where(side & 1, cells[::-1], cells)
    cells = jnp.where(side & 2, cells[:, ::-1], cells)
    return jnp.where(side & 4, cells.swapaxes(0, 1), cells)
