"""The bin-aware policy's gradient: rollouts, judgement, advantage, loss."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.learning.bin_network import Sight, scores
from jaxpack.learning.losses import Outcome, judge, leave_one_out
from jaxpack.learning.parameters import Params
from jaxpack.learning.rollout import LANES, Trace, trace_choices
from jaxpack.model.problem import Instance, Packing
from jaxpack.packing.first_fit import pack_decisions
from jaxpack.packing.surface_view import view_of
from jaxpack.xla.target import target

if TYPE_CHECKING:
    from jaxpack.learning.bin_aware import BinAwareConfig
    from jaxpack.learning.recipe import TrainConfig


def bin_aware_gradient(
    network: "BinAwareConfig",
    config: "TrainConfig",
    params: Params,
    instances: Instance,
    keys: Array,
) -> tuple[Params, Outcome]:
    """Rollouts without gradient, then a pass over what they saw; piece by piece of the batch.

    A piece holds all samples of its instances, so that its advantages are known when its
    rollouts are, and what it saw never leaves the cache for long. `keys`: [B, S].
    """
    batch, samples = instances.mask.shape[0], config.samples
    most = max(1, target().lanes(LANES) // samples)
    piece = max(n for n in range(1, min(most, batch) + 1) if batch % n == 0)
    pieces = jax.tree.map(lambda leaf: leaf.reshape(-1, piece, *leaf.shape[1:]), instances)

    def work(total: Params, inputs: tuple[Instance, Array]) -> tuple[Params, Outcome]:
        instances, keys = inputs
        repeated = jax.tree.map(lambda leaf: jnp.repeat(leaf, samples, 0), instances)
        decided, trace = trace_choices(
            network,
            view_of(config.problem, network.positions),
            params,
            repeated,
            keys,
            config.kinds,
            config.loss_steps,
        )
        orders = decided.order
        repeated, packings = pack_decisions(config.problem, repeated, decided)
        judged = jax.vmap(partial(judge, config))(repeated, packings)
        if config.learner == "self-label":
            trace, weight = _best_of_each(trace, judged[0].reshape(piece, samples))
        elif config.learner in COST_TO_GO:
            to_go = COST_TO_GO[config.learner](config, repeated, packings)
            weight = _bin_advantages(to_go, samples, packings, orders)
        else:
            weight = leave_one_out(judged[0].reshape(piece, samples)).reshape(-1)
        weight = jnp.broadcast_to(weight, (orders.shape[1], weight.shape[-1]))
        gradient, loss, entropy = _trace_gradient(config, network, params, trace, weight)
        total = jax.tree.map(jnp.add, total, gradient)
        means = [x.mean() for x in judged]
        entropy /= instances.mask[0].sum()
        return total, Outcome._make([*means, loss, jnp.float32(0), entropy])

    zero = jax.tree.map(jnp.zeros_like, params)
    total, outcomes = jax.lax.scan(
        work, zero, (pieces, keys.reshape(batch // piece, piece * samples))
    )
    gradient = jax.tree.map(lambda leaf: leaf * piece / batch, total)
    return gradient, jax.tree.map(jnp.mean, outcomes)


def _best_of_each(trace: list[Trace], cost: Array) -> tuple[list[Trace], Array]:
    """Self-labelling: only the best sample of every instance, to be made more probable.

    Corsini et al. 2024; Pirnay and Grimm 2024. Where all samples cost the same nothing is learned.

    Args:
        cost: float32 [instances, S].
    """
    piece, samples = cost.shape
    lanes = jnp.arange(piece) * samples + jnp.argmin(cost, 1)
    told_apart = (cost.max(1) > cost.min(1)) * 1.0
    labels = [
        stretch._replace(
            sight=Sight(
                rows=sight.rows[:, :, lanes],
                context=sight.context[:, lanes],
                remaining=sight.remaining[:, :, lanes],
                fits=sight.fits[:, :, lanes],
            ),
            row=stretch.row[:, lanes],
        )
        for stretch in trace
        for sight in (stretch.sight,)
    ]
    return labels, -told_apart


def _bins_to_go(config: "TrainConfig", instances: Instance, packings: Packing) -> Array:
    """What the bins from each on cost, of the objective: float32 [B, bin slots]."""
    used = packings.volume > 0
    loose = _loose(instances, packings)
    per_bin = 1 + config.alpha * loose / jnp.maximum(used.sum(1, keepdims=True), 1)
    per_bin = jnp.where(used, per_bin, 0)
    return jnp.cumsum(per_bin[:, ::-1], 1)[:, ::-1]


def _waste_to_go(config: "TrainConfig", instances: Instance, packings: Packing) -> Array:
    """What the bins from each on waste, discounted: float32 [B, bin slots].

    Nothing is added to a bin that is full, so what is free in it is lost: the fewer bins, the less
    of that, and unlike their number it says something of every bin. In the last one it is what
    lies below the top, `alpha` times.
    """
    used = packings.volume > 0
    last = jnp.cumsum(used[:, ::-1], 1)[:, ::-1] == 1
    capacity = instances.bin.astype(jnp.float32).prod(1, keepdims=True)
    waste = jnp.where(
        last, config.alpha * _loose(instances, packings), 1 - packings.volume / capacity
    )

    def add(later: Array, own: Array) -> tuple[Array, Array]:
        to_go = own + config.discount * later
        return to_go, to_go

    nothing = jnp.zeros(len(waste))
    return jax.lax.scan(add, nothing, jnp.where(used, waste, 0).T, reverse=True)[1].T


COST_TO_GO = {"leave-one-out-by-bin": _bins_to_go, "leave-one-out-by-waste": _waste_to_go}
"""What a choice answers for, by learner: that from its own bin on."""


def _loose(instances: Instance, packings: Packing) -> Array:
    """What is free below the top of each bin, as a share: float32 [B, bin slots]."""
    region = (instances.bin[:, 0] * instances.bin[:, 1])[:, None] * packings.top
    return 1 - packings.volume / jnp.maximum(region, 1)


def _bin_advantages(to_go: Array, samples: int, packings: Packing, orders: Array) -> Array:
    """Advantage of every choice for its own bin and those after it: float32 [N, B * S].

    A choice cannot change the bins that were full before it, so their cost is left out, and so
    is theirs from what the other samples of the instance are compared by. Padding gets that of
    the first bin; it never has a choice.
    """
    grouped = to_go.reshape(-1, samples, to_go.shape[1])
    advantage = jnp.moveaxis(leave_one_out(jnp.moveaxis(grouped, 1, -1)), -1, 1)
    slot = jnp.take_along_axis(packings.bin, orders, 1)
    return jnp.take_along_axis(advantage.reshape(to_go.shape), jnp.maximum(slot, 0), 1).T


def _trace_gradient(
    config: "TrainConfig",
    network: "BinAwareConfig",
    params: Params,
    trace: list[Trace],
    weight: Array,
) -> tuple[Params, Array, Array]:
    """Gradient of the mean over B of sum_t weight log P(choice), less the entropy bonus.

    Of a share of the steps it is an estimate: its mean over the steps that could have been drawn is
    what it would be with all of them.

    Args:
        weight: float32 [N, B], of every step and order.

    Returns:
        (gradient, the loss without the bonus, the orders' mean entropy summed over steps).
    """
    lanes = weight.shape[1]

    def loss(params: Params, step: tuple[Sight, Array, Array]) -> tuple[Array, tuple[Array, Array]]:
        sight, row, weight = step
        log_probs = scores(network, params, sight)
        chosen = jnp.take_along_axis(log_probs, row[None], 0)[0]
        weighted = (weight * jnp.where(sight.fits.any(0), chosen, 0)).sum() / lanes
        entropy = -jnp.where(sight.fits, jnp.exp(log_probs) * log_probs, 0).sum() / lanes
        return weighted - config.entropy * entropy, (weighted, entropy)

    step_gradient: Callable = jax.grad(loss, has_aux=True)

    def add(total: tuple, step: tuple[Sight, Array, Array]) -> tuple[tuple, None]:
        return jax.tree.map(jnp.add, total, step_gradient(params, step)), None

    nothing = (jax.tree.map(jnp.zeros_like, params), (jnp.float32(0), jnp.float32(0)))
    total = nothing
    for sight, row, steps, each in trace:
        found, _ = jax.lax.scan(add, nothing, (sight, row, weight[steps]))
        total = jax.tree.map(lambda sum_, part, each=each: sum_ + each * part, total, found)
    gradient, (loss_sum, entropy) = total
    return gradient, loss_sum, entropy
