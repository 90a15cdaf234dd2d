"""The pointer network as a distribution over orders."""

from functools import partial
from itertools import permutations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpack import Instance, Problem, make_instance
from jaxpack.learning.pointer import PointerConfig
from jaxpack.learning.pointer_network import (
    apply_value,
    greedy_order,
    init_pointer,
    sample_order,
    score_order,
)

PROBLEM = Problem(bin=(10, 10, 10))
CONFIG = PointerConfig(hidden=16, critic=8)
greedy = jax.jit(partial(greedy_order, PROBLEM, CONFIG))
sampled = jax.jit(partial(sample_order, PROBLEM, CONFIG))
scored = jax.jit(partial(score_order, PROBLEM, CONFIG))
valued = jax.jit(partial(apply_value, PROBLEM, CONFIG))
SIZES = [[2, 3, 4], [5, 2, 3], [3, 3, 5], [4, 5, 2]]


@pytest.fixture(scope="module")
def params():
    return init_pointer(PROBLEM, CONFIG, jax.random.key(3))


def padded(instance: Instance, slots: int, first: int) -> Instance:
    """The instance with `first` slots of padding before its items and the rest after them."""
    items = instance.mask.shape[0]
    pad = (first, slots - first - items)
    return Instance(
        size=jnp.pad(instance.size, (pad, (0, 0)), constant_values=1),
        mask=jnp.pad(instance.mask, pad),
        bin=instance.bin,
    )


def test_probabilities_of_all_orders_sum_to_one(params):
    instance = make_instance(PROBLEM, SIZES)
    orders = jnp.asarray(list(permutations(range(4))))
    log_probs = jax.vmap(lambda order: scored(params, instance, order).log_prob)(orders)
    assert float(jnp.exp(log_probs).sum()) == pytest.approx(1, abs=1e-5)


def test_samples_follow_their_probabilities(params):
    instance = make_instance(PROBLEM, SIZES[:3])
    orders = jnp.asarray(list(permutations(range(3))))
    expected = jnp.exp(jax.vmap(lambda o: scored(params, instance, o).log_prob)(orders))
    draws = 20_000
    keys = jax.random.split(jax.random.key(0), draws)
    rollouts = jax.jit(jax.vmap(lambda key: sampled(params, instance, key)))(keys)
    hits = (rollouts.order[:, None] == orders[None]).all(-1)
    # Five standard errors of a frequency: a fair sampler misses it once in a million.
    allowed = 5 * np.sqrt(expected * (1 - expected) / draws)
    assert (np.abs(hits.mean(0) - expected) < allowed).all()
    # Each rollout carries the log-probability of its own order.
    np.testing.assert_allclose(rollouts.log_prob, jnp.log(expected)[hits.argmax(1)], atol=1e-5)


def test_greedy_takes_the_most_probable_item_at_every_step(params):
    instance = make_instance(PROBLEM, SIZES)
    order = [int(i) for i in greedy(params, instance)]
    probability = {
        tail: float(jnp.exp(scored(params, instance, jnp.asarray(tail)).log_prob))
        for tail in permutations(range(4))
    }
    for step in range(4):
        prefix = tuple(order[:step])
        options = {
            item: sum(p for o, p in probability.items() if o[: step + 1] == (*prefix, item))
            for item in range(4)
            if item not in prefix
        }
        assert order[step] == max(options, key=options.__getitem__)


def test_padding_is_inert(params):
    plain = make_instance(PROBLEM, SIZES)
    for first in (0, 2, 3):
        wide = padded(plain, 7, first)
        order = greedy(params, wide)
        real = order[:4] - first
        assert sorted(order.tolist()) == list(range(7))
        assert wide.mask[order[:4]].all(), "items come before padding"
        np.testing.assert_array_equal(real, greedy(params, plain))
        drawn = sampled(params, wide, jax.random.key(1))
        assert wide.mask[drawn.order[:4]].all()
        again = scored(params, plain, drawn.order[:4] - first)
        assert float(drawn.log_prob) == pytest.approx(float(again.log_prob), abs=1e-5)
        assert float(drawn.entropy) == pytest.approx(float(again.entropy), abs=1e-5)
        assert float(valued(params, wide)) == pytest.approx(float(valued(params, plain)), abs=1e-6)


def test_gradients_are_finite_with_padding(params):
    wide = padded(make_instance(PROBLEM, SIZES), 7, 2)

    def log_prob(params):
        return sampled(params, wide, jax.random.key(1)).log_prob

    grads = jax.grad(log_prob)(params)
    assert all(jnp.isfinite(leaf).all() for leaf in jax.tree.leaves(grads))


def test_the_critic_does_not_depend_on_the_order_of_the_items(params):
    values = [
        float(valued(params, make_instance(PROBLEM, sizes))) for sizes in (SIZES, SIZES[::-1])
    ]
    assert values[0] == pytest.approx(values[1], abs=1e-6)


def test_inputs_scale_with_the_bin(params):
    small = make_instance(PROBLEM, SIZES)
    double = small._replace(size=small.size * 2, bin=small.bin * 2)
    np.testing.assert_array_equal(greedy(params, small), greedy(params, double))
