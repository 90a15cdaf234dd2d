"""The pointer network's gradient is that of the loss, written down step by step."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import TINY, packer

from jaxpack.learning.losses import leave_one_out
from jaxpack.learning.pointer import PointerConfig
from jaxpack.learning.pointer_network import (
    apply_value,
    init_pointer,
    sample_order,
    score_order,
)
from jaxpack.learning.trainer import policy_gradient
from jaxpack.model.instances import sample

PROBLEM, NETWORK = TINY.problem, PointerConfig(hidden=8, critic=4)
PARAMS = init_pointer(PROBLEM, NETWORK, jax.random.key(1))


def padded_instances(batch):
    """Of 8 items, the first of which are padding in some."""
    instances = sample(PROBLEM, TINY.distribution, jax.random.key(2), batch)
    first = jnp.arange(batch)[:, None] % 4
    return instances._replace(mask=jnp.arange(8) >= first)


@pytest.mark.parametrize(
    "scale", [*(pytest.param(scale, marks=pytest.mark.long) for scale in (0.1, 2.0)), 4.0]
)
@pytest.mark.parametrize(
    "learner", ["critic", pytest.param("leave-one-out", marks=pytest.mark.long)]
)
def test_the_gradient_is_that_of_eq_10(learner, scale):
    """Of the orders that the same keys draw, also where tanh is flat."""
    given = jax.tree.map(lambda leaf: scale * leaf, PARAMS)
    samples = 1 if learner == "critic" else 3
    config = replace(TINY, policy=NETWORK, learner=learner, samples=samples, entropy=0.1)
    instances, key = padded_instances(config.batch), jax.random.key(5)
    keys = jax.random.split(key, (config.batch, samples))
    draw = partial(sample_order, PROBLEM, NETWORK, given)
    orders = jax.vmap(jax.vmap(draw, (None, 0)))(instances, keys).order
    repeated = jax.tree.map(lambda leaf: jnp.repeat(leaf, samples, 0), instances)
    packings = packer(PROBLEM)(repeated, orders.reshape(-1, 8))
    cost = jax.vmap(config.cost)(repeated, packings).reshape(-1, samples)

    def loss(params):
        total = 0.0
        for i in range(config.batch):
            one = jax.tree.map(lambda leaf, i=i: leaf[i], instances)
            value = apply_value(PROBLEM, NETWORK, params, one)
            advantage = leave_one_out(cost)[i] if learner != "critic" else cost[i] - value
            for s in range(samples):
                rollout = score_order(PROBLEM, NETWORK, params, one, orders[i, s])
                total += jax.lax.stop_gradient(advantage[s]) * rollout.log_prob / samples
                total -= 0.1 * rollout.entropy * one.mask.sum() / samples
            critic = (cost[i] - value) ** 2 if learner == "critic" else 0 * cost[i]
            total += critic.mean()
        return total / config.batch

    found, outcome = jax.jit(partial(policy_gradient, config))(given, instances, key)
    expected = jax.jit(jax.grad(loss))(given)
    for ours, theirs in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        largest = float(jnp.abs(theirs).max())
        np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=1e-5 * largest + 3e-5)
    assert float(outcome.cost) == pytest.approx(float(cost.mean()), rel=1e-5)
