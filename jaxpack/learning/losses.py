"""Losses as pure functions of one batch of outcomes."""

from typing import TYPE_CHECKING, NamedTuple

import chex
import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.model.metrics import bins_used, compactness, pyramid
from jaxpack.model.problem import Instance, Packing

if TYPE_CHECKING:
    from jaxpack.learning.recipe import TrainConfig


class Outcome(NamedTuple):
    """Means over the orders of one update, float32[] each."""

    cost: Array  # what is minimised
    compactness: Array
    pyramid: Array
    bins: Array
    actor_loss: Array
    critic_loss: Array
    entropy: Array  # nats per item


def judge(config: "TrainConfig", instance: Instance, packing: Packing) -> tuple[Array, ...]:
    """The first four of `Outcome` for one packing."""
    measures = (compactness(instance, packing), pyramid(packing), bins_used(packing))
    return config.cost(instance, packing), *measures


class Losses(NamedTuple):
    """The two losses of Eq. (10), means over the batch: float32 scalars."""

    actor: Array
    critic: Array


def actor_critic_losses(log_prob: Array, cost: Array, value: Array) -> Losses:
    """REINFORCE with a critic, Eq. (10) of the paper, for a cost that is to be minimised.

    actor: mean of (R - V) * log P(order), in which R - V is a constant;
    critic: mean of (R - V)^2, in which R is a constant.

    Args:
        log_prob: float32 [B, S] or [B], log-probability of each sampled order.
        cost: float32, the same shape: R of Eq. (9).
        value: float32, the same shape, or [B, 1]: the critic's V, which no sample changes.

    Raises:
        AssertionError: where ranks, shapes or dtypes are others. While tracing; it costs no run.
    """
    chex.assert_type([log_prob, cost, value], float)
    chex.assert_rank([log_prob, cost, value], {1, 2})
    chex.assert_equal_rank([log_prob, cost, value])
    chex.assert_equal_shape([log_prob, cost])
    chex.assert_equal_shape_prefix([cost, value], 1)
    chex.assert_is_broadcastable(value.shape, cost.shape)
    cost = jax.lax.stop_gradient(cost)
    advantage = jax.lax.stop_gradient(cost - value)
    return Losses(actor=jnp.mean(advantage * log_prob), critic=jnp.mean((cost - value) ** 2))


def leave_one_out(cost: Array) -> Array:
    """Advantage of each sample over the others of its instance (Kool et al. 2019).

    cost_s - mean of the other samples' costs: unbiased, since the baseline does not depend on
    sample s.

    Args:
        cost: float32 [..., S], S at least 2.

    Returns:
        float32 [..., S].

    Raises:
        AssertionError: where S is less or the dtype another.
    """
    chex.assert_type(cost, float)
    chex.assert_axis_dimension_gteq(cost, -1, 2)
    samples = cost.shape[-1]
    return (cost - cost.mean(-1, keepdims=True)) * (samples / (samples - 1))
