"""Losses as pure functions of one batch of outcomes."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array


class Losses(NamedTuple):
    """The two losses of Eq. (10), means over the batch: float32 scalars."""

    actor: Array
    critic: Array


def actor_critic_losses(log_prob: Array, cost: Array, value: Array) -> Losses:
    """REINFORCE with a critic, Eq. (10) of the paper, for a cost that is to be minimised.

    actor: mean of (R - V) * log P(order), in which R - V is a constant;
    critic: mean of (R - V)^2, in which R is a constant.

    Args:
        log_prob: float32 [B, S], log-probability of each sampled order; or any other shape.
        cost: float32 of the same shape, R of Eq. (9).
        value: float32, the baseline V: the critic's [B, 1], or one for every order. It has to
            broadcast to that shape.
    """
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
    """
    samples = cost.shape[-1]
    return (cost - cost.mean(-1, keepdims=True)) * (samples / (samples - 1))
