"""Learning what a bin is worth: what is told against a plain loop, and that it helps."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpack.learning.online_training import (
    LANES,
    OnlineConfig,
    Steps,
    init_online,
    online_update,
    reflected,
    returns,
)
from jaxpack.model.problem import Problem
from jaxpack.packing.online import Setting
from jaxpack.search.online import by_rule, play, value_rule


def played(value, gain, fits):
    nothing = jnp.zeros((*value.shape[:2], 1, 1, value.shape[2]))
    return Steps(nothing, nothing, value, gain, fits, value)


@pytest.mark.parametrize("trace", [0.0, 0.7, 1.0])
def test_what_a_bin_is_told(trace):
    random = np.random.default_rng(3)
    shape = (2, 9, 4)
    fits = random.random(shape) < 0.8
    value, gain = random.random(shape), random.random(shape) * fits
    told = returns(trace, played(*map(jnp.asarray, (value, gain, fits))))
    for chunk in range(2):
        for lane in range(4):
            for step in range(8):
                # Lambda returns by their definition: a mean over where one stops looking.
                expected, weight, so_far, ended = 0.0, 1.0, 0.0, False
                for after in range(step + 1, 9):
                    if not fits[chunk, after, lane]:
                        expected, ended = expected + weight * so_far, True
                        break
                    so_far += gain[chunk, after, lane]
                    stops = weight * (1 - trace) if after < 8 else weight
                    expected += stops * (so_far + value[chunk, after, lane])
                    weight -= stops
                assert ended or weight < 1e-12
                np.testing.assert_allclose(told[chunk, step, lane], expected, rtol=1e-5)


def test_reflections_are_the_eight():
    cells = jnp.arange(16).reshape(4, 4, 1)
    seen = {reflected(cells, jnp.int32(side)).tobytes() for side in range(8)}
    assert len(seen) == 8
    for side in range(8):
        assert sorted(reflected(cells, jnp.int32(side)).ravel().tolist()) == list(range(16))


@pytest.mark.slow
def test_a_value_that_is_learned_fills_more():
    """Than one that knows nothing yet; and the same key gives the same bits."""
    setting = Setting(Problem((6, 6, 6), (3, 3), support=0))
    config = OnlineConfig(setting, updates=120, bins=4 * LANES, steps=8, minibatch=64)
    learned = []
    for _ in range(2):
        state = start = init_online(config, jax.random.key(0))
        for _ in range(config.updates):
            state, _ = online_update(config, state)
        learned.append(state.averaged)
    for one, other in zip(*map(jax.tree.leaves, learned), strict=True):
        np.testing.assert_array_equal(one, other)
    items = jax.random.randint(jax.random.key(1), (60, 3, 128), 1, 4, jnp.int32)
    keys = jax.random.split(jax.random.key(2), 128)

    def use(params):
        found = jax.jit(partial(play, setting, by_rule(setting, value_rule(params))))(items, keys)
        return float(jnp.where(found.item >= 0, found.sides.prod(1), 0).sum(0).mean()) / 6**3

    assert use(learned[0]) > use(start.averaged) + 0.1
