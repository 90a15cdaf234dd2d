"""Learning what a bin is worth: what is told against a plain loop, and that it helps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpack.learning.online_training import (
    LANES,
    OnlineConfig,
    Played,
    init_online,
    online_update,
    reflected,
    returns,
)
from jaxpack.model.problem import Problem
from jaxpack.packing.online import Setting


def played(value, gain, fits):
    nothing = jnp.zeros((*value.shape[:2], 1, 1, value.shape[2]))
    return Played(nothing, nothing, value, gain, fits, value)


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
    """From the first updates to the last ones; and the same key gives the same bits."""
    setting = Setting(Problem((6, 6, 6), (3, 3), support=0))
    config = OnlineConfig(setting, updates=120, bins=4 * LANES, steps=8, minibatch=64)
    runs = []
    for _ in range(2):
        state, use = init_online(config, jax.random.key(0)), []
        for _ in range(config.updates):
            state, metrics = online_update(config, state)
            use.append(float(metrics.use))
        runs.append((use, state.averaged))
    use = runs[0][0]
    assert np.mean(use[-30:]) > np.mean(use[4:20]) + 0.05
    for one, other in zip(*(jax.tree.leaves(run[1]) for run in runs), strict=True):
        np.testing.assert_array_equal(one, other)
