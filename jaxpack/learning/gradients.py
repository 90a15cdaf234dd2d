"""From a batch of instances to a gradient: rollouts, judgement, advantage, loss."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.sharding import Mesh

from jaxpack.learning.bin_network import BinAwareConfig, Sight, scores
from jaxpack.learning.losses import actor_critic_losses, leave_one_out
from jaxpack.learning.parameters import Params, PointerConfig
from jaxpack.learning.pointer import apply_value, sample_order
from jaxpack.learning.recipe import TrainConfig
from jaxpack.learning.rollout import LANES, Trace, trace_choices
from jaxpack.model.metrics import bins_used, compactness, pyramid
from jaxpack.model.problem import Instance, Packing, in_orientation
from jaxpack.packing.first_fit import pack
from jaxpack.xla.devices import PART, WHOLE, mean_over_batch
from jaxpack.xla.target import target


class Outcome(NamedTuple):
    """Means over the orders of one update, float32[] each."""

    cost: Array  # what is minimised
    compactness: Array
    pyramid: Array
    bins: Array
    actor_loss: Array
    critic_loss: Array
    entropy: Array  # nats per item


def policy_gradient(
    config: TrainConfig, params: Params, instances: Instance, key: Array, mesh: Mesh | None = None
) -> tuple[Params, Outcome]:
    """The gradient of the config's loss on a batch of instances (leaves [B, ...]).

    Args:
        mesh: the devices that share the batch, from `data_mesh`; it does not change the result.
    """
    network = config.policy
    # A key for every order of the whole batch, whichever device draws it.
    keys = jax.random.split(key, (instances.mask.shape[0], config.samples))

    def gradient(params: Params, instances: Instance, keys: Array) -> tuple[Params, Outcome]:
        if isinstance(network, PointerConfig):
            return _pointer_gradient(config, network, params, instances, keys)
        return _bin_aware_gradient(config, network, params, instances, keys)

    mean = mean_over_batch(mesh, gradient, (WHOLE, PART, PART))
    result: tuple[Params, Outcome] = mean(params, instances, keys)
    return result


def _judge(config: TrainConfig, instance: Instance, packing: Packing) -> tuple[Array, ...]:
    measures = (compactness(instance, packing), pyramid(packing), bins_used(packing))
    return config.cost(instance, packing), *measures


def _pointer_gradient(
    config: TrainConfig, network: PointerConfig, params: Params, instances: Instance, keys: Array
) -> tuple[Params, Outcome]:
    """Sampling and loss in one differentiable pass, Eq. (10). `keys`: [B, S]."""

    def loss(params: Params) -> tuple[Array, Outcome]:
        def outcome(instance: Instance, key: Array) -> tuple:
            rollout = sample_order(config.problem, network, params, instance, key)
            packing = pack(config.problem, instance, rollout.order)
            return rollout, _judge(config, instance, packing)

        def value(instance: Instance) -> Array:
            return apply_value(config.problem, network, params, instance)

        rollout, (cost, *measures) = jax.vmap(jax.vmap(outcome, (None, 0)))(instances, keys)
        if config.learner == "critic":
            baseline = jax.vmap(value)(instances)[:, None]
        else:
            baseline = cost - leave_one_out(cost)
        losses = actor_critic_losses(rollout.log_prob, cost, baseline)
        total = losses.actor + losses.critic
        if config.entropy:
            total -= config.entropy * (rollout.entropy.mean(1) * instances.mask.sum(1)).mean()
        means = [x.mean() for x in (cost, *measures)]
        entropy = rollout.entropy.mean()
        return total, Outcome._make([*means, losses.actor, losses.critic, entropy])

    return jax.grad(loss, has_aux=True)(params)


def _bin_aware_gradient(
    config: TrainConfig, network: BinAwareConfig, params: Params, instances: Instance, keys: Array
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
        orders, turns, trace = trace_choices(
            config.problem, network, params, repeated, keys, config.kinds
        )
        repeated = jax.vmap(in_orientation)(repeated, turns)
        packings = jax.vmap(partial(pack, config.problem))(repeated, orders)
        judged = jax.vmap(partial(_judge, config))(repeated, packings)
        if config.learner == "self-label":
            trace, weight = _best_of_each(trace, judged[0].reshape(piece, samples))
        elif config.credit == "bin":
            weight = _bin_advantages(config, repeated, packings, orders)
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
        Trace(
            Sight(
                rows=sight.rows[:, :, lanes],
                context=sight.context[:, lanes],
                remaining=sight.remaining[:, :, lanes],
                fits=sight.fits[:, :, lanes],
            ),
            kind[:, lanes],
        )
        for sight, kind in trace
    ]
    return labels, -told_apart


def _bin_advantages(
    config: TrainConfig, instances: Instance, packings: Packing, orders: Array
) -> Array:
    """Advantage of every choice for its own bin and those after it: float32 [N, B * S].

    A choice cannot change the bins that were full before it, so their cost is left out, and so
    is theirs from what the other samples of the instance are compared by. Padding gets that of
    the first bin; it never has a choice.
    """
    used = packings.volume > 0
    region = (instances.bin[:, 0] * instances.bin[:, 1])[:, None] * packings.top
    loose = 1 - packings.volume / jnp.maximum(region, 1)
    per_bin = 1 + config.alpha * loose / jnp.maximum(used.sum(1, keepdims=True), 1)
    per_bin = jnp.where(used, per_bin, 0)
    to_go = jnp.cumsum(per_bin[:, ::-1], 1)[:, ::-1]  # [B * S, bin slots]
    grouped = to_go.reshape(-1, config.samples, to_go.shape[1])
    advantage = jnp.moveaxis(leave_one_out(jnp.moveaxis(grouped, 1, -1)), -1, 1)
    slot = jnp.take_along_axis(packings.bin, orders, 1)
    return jnp.take_along_axis(advantage.reshape(to_go.shape), jnp.maximum(slot, 0), 1).T


def _trace_gradient(
    config: TrainConfig, network: BinAwareConfig, params: Params, trace: list[Trace], weight: Array
) -> tuple[Params, Array, Array]:
    """Gradient of the mean over B of sum_t weight log P(choice), less the entropy bonus.

    Args:
        weight: float32 [N, B], of every step and order.

    Returns:
        (gradient, the loss without the bonus, the orders' mean entropy summed over steps).
    """
    lanes = weight.shape[1]

    def loss(params: Params, step: tuple[Trace, Array]) -> tuple[Array, tuple[Array, Array]]:
        (sight, kind), weight = step
        log_probs = scores(network, params, sight)
        chosen = jnp.take_along_axis(log_probs, kind[None], 0)[0]
        weighted = (weight * jnp.where(sight.fits.any(0), chosen, 0)).sum() / lanes
        entropy = -jnp.where(sight.fits, jnp.exp(log_probs) * log_probs, 0).sum() / lanes
        return weighted - config.entropy * entropy, (weighted, entropy)

    step_gradient: Callable = jax.grad(loss, has_aux=True)

    def add(total: tuple, step: tuple[Trace, Array]) -> tuple[tuple, None]:
        return jax.tree.map(jnp.add, total, step_gradient(params, step)), None

    total = (jax.tree.map(jnp.zeros_like, params), (jnp.float32(0), jnp.float32(0)))
    first = 0
    for stretch in trace:
        last = first + stretch.kind.shape[0]
        total, _ = jax.lax.scan(add, total, (stretch, weight[first:last]))
        first = last
    gradient, (loss_sum, entropy) = total
    return gradient, loss_sum, entropy
