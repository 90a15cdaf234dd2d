"""Eq. (10): its gradient is the gradient of the expected cost."""

from itertools import permutations

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from jaxpack import Problem, make_instance, pack
from jaxpack.learning.losses import actor_critic_losses, leave_one_out
from jaxpack.learning.pointer import PointerConfig
from jaxpack.learning.pointer_network import init_pointer, sample_order, score_order
from jaxpack.model.metrics import paper_cost

PROBLEM = Problem(bin=(5, 1, 5))
CONFIG = PointerConfig(hidden=8, critic=4)
# Sizes for which the order matters: no two of the six orders have the same cost.
INSTANCE = make_instance(PROBLEM, [[4, 2], [3, 1], [5, 3]])
ORDERS = jnp.asarray(list(permutations(range(3))))
COSTS = jax.vmap(lambda order: paper_cost(INSTANCE, pack(PROBLEM, INSTANCE, order)))(ORDERS)


def log_probs(params):
    return jax.vmap(lambda o: score_order(PROBLEM, CONFIG, params, INSTANCE, o).log_prob)(ORDERS)


def assert_trees_close(found, expected, rtol=1e-4, atol=1e-6):
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=rtol, atol=atol)


def test_reinforce_is_the_exact_gradient_over_all_orders():
    params = init_pointer(PROBLEM, CONFIG, jax.random.key(0))
    assert len(np.unique(np.round(COSTS, 6))) == 6

    def expected_cost(params):
        return (jnp.exp(log_probs(params)) * COSTS).sum()

    def actor_loss(params, order, cost, value):
        rollout = score_order(PROBLEM, CONFIG, params, INSTANCE, order)
        return actor_critic_losses(rollout.log_prob[None], cost[None], value[None]).actor

    exact = jax.jit(jax.grad(expected_cost))(params)
    gradients = jax.jit(jax.vmap(jax.grad(actor_loss), (None, 0, 0, None)))
    weights = jnp.exp(log_probs(params))
    # Any baseline that does not look at the order leaves the expectation as it is.
    for baseline in (0.0, 0.7, -3.0):
        each = gradients(params, ORDERS, COSTS, jnp.float32(baseline))
        mean = jax.tree.map(lambda leaf: jnp.tensordot(weights, leaf, 1), each)
        assert_trees_close(mean, exact)


def test_the_gradient_of_many_samples_approaches_the_exact_one():
    params = init_pointer(PROBLEM, CONFIG, jax.random.key(0))
    samples = 40_000

    def sampled_loss(params):
        keys = jax.random.split(jax.random.key(1), samples)
        rollouts = jax.vmap(lambda k: sample_order(PROBLEM, CONFIG, params, INSTANCE, k))(keys)
        costs = jax.vmap(lambda o: paper_cost(INSTANCE, pack(PROBLEM, INSTANCE, o)))(rollouts.order)
        value = jnp.full(samples, COSTS.mean())
        return actor_critic_losses(rollouts.log_prob, costs, value).actor

    found = jax.jit(jax.grad(sampled_loss))(params)
    exact = jax.jit(jax.grad(lambda p: (jnp.exp(log_probs(p)) * COSTS).sum()))(params)
    difference = jax.tree.map(lambda a, b: a - b, found, exact)
    assert optax.tree.norm(difference) < 0.1 * optax.tree.norm(exact)


def test_the_critic_learns_from_its_error_alone():
    cost, value = jnp.asarray([1.0, 3.0]), jnp.asarray([2.0, 2.5])
    losses = actor_critic_losses(jnp.asarray([-1.0, -2.0]), cost, value)
    # actor: mean of (1 - 2)(-1) and (3 - 2.5)(-2); critic: mean of 1 and 0.25.
    np.testing.assert_allclose(losses.actor, (1.0 - 1.0) / 2)
    np.testing.assert_allclose(losses.critic, (1.0 + 0.25) / 2)
    by_value = jax.grad(lambda v: actor_critic_losses(jnp.ones(2), cost, v).actor)(value)
    np.testing.assert_array_equal(by_value, 0)
    by_cost = jax.grad(lambda c: sum(actor_critic_losses(jnp.ones(2), c, value)))(cost)
    np.testing.assert_array_equal(by_cost, 0)


def test_a_critics_value_goes_for_all_samples_of_its_instance():
    log_prob, cost = jnp.asarray([[-1.0, -2.0], [-3.0, -1.0]]), jnp.asarray([[1.0, 3], [2, 4]])
    value = jnp.asarray([[2.0], [3.0]])
    losses = actor_critic_losses(log_prob, cost, value)
    # actor: mean of (-1)(-1), (1)(-2), (-1)(-3), (1)(-1); critic: every square is 1.
    np.testing.assert_allclose(losses, (1 / 4, 1.0))
    repeated = actor_critic_losses(log_prob, cost, jnp.broadcast_to(value, (2, 2)))
    np.testing.assert_allclose(repeated, losses)
    np.testing.assert_allclose(leave_one_out(cost), [[-2, 2], [-2, 2]])


def test_shapes_and_types_that_would_broadcast_to_something_else_are_refused():
    pairs, column, row = jnp.ones((3, 2)), jnp.ones((3, 1)), jnp.ones(3)
    for log_prob, cost, value in (
        (row, row, column),  # would be [3, 3]
        (column, pairs, pairs),
        (pairs, column, column),
        (pairs, pairs, row),
        (pairs, pairs, jnp.ones((1, 2))),
        (pairs, pairs, jnp.ones((3, 3))),
        (jnp.float32(1), jnp.float32(1), jnp.float32(1)),
        (pairs, pairs.astype(int), column),
    ):
        with pytest.raises(AssertionError):
            jax.eval_shape(actor_critic_losses, log_prob, cost, value)
    for cost in (column, pairs.astype(int), jnp.float32(1)):
        with pytest.raises(AssertionError):
            leave_one_out(cost)
