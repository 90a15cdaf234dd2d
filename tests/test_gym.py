"""The environments of gymnasium: its own checkers, and what they say of the packing."""

import warnings
from functools import partial

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.spaces import Discrete
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from jaxpack import Distribution, Problem, Table, UserError, observe, reset, step
from jaxpack.gym import SEEDS, PackingEnv, PackingVectorEnv

NAME = "jaxpack.gym:jaxpack/Packing-v0"
FLAT = {"problem": Problem(bin=(6, 1, 6), largest=(4, 1)), "distribution": Distribution(9, 1, 4)}
SOLID = {
    "problem": Problem(bin=(5, 4, 6), largest=(3, 3)),
    "distribution": Distribution(8, 1, 3, "all"),
}
BOTH = pytest.mark.parametrize("world", [FLAT, SOLID], ids=["2D", "3D turned"])


@BOTH
def test_gymnasiums_checker_finds_nothing(world):
    env = gymnasium.make(NAME, **world)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)
    assert env.spec.id == "jaxpack/Packing-v0"
    assert isinstance(env.action_space, Discrete)


def play(env, seed, choose):
    """(observations, rewards) of an episode."""
    seen, info = env.reset(seed=seed)
    observations, rewards, over = [seen], [], False
    while not over:
        np.testing.assert_array_equal(info["mask"], seen["mask"])
        seen, reward, over, truncated, info = env.step(choose(seen))
        assert seen in env.observation_space
        assert not truncated
        observations.append(seen)
        rewards.append(reward)
    return observations, rewards


@BOTH
def test_the_return_is_minus_the_bins_of_the_same_choices(world):
    env = PackingEnv(**world)
    rng = np.random.default_rng(0)
    chosen = []

    def choose(seen):
        chosen.append(rng.choice(np.flatnonzero(seen["mask"])))
        return chosen[-1]

    observations, rewards = play(env, 7, choose)
    assert len(rewards) == world["distribution"].items
    assert not observations[-1]["remaining"].any()
    assert set(rewards) <= {0.0, -1.0}
    assert rewards[0] == -1
    # The same by the pure functions: the instance of this seed, and what stands where.
    view, seed = Table(world["problem"]), np.random.default_rng(7).integers(SEEDS)
    one = world["distribution"].draw(world["problem"], jax.random.key(seed))
    state = reset(view, jax.tree.map(lambda leaf: leaf[..., None], one))
    go = jax.jit(partial(step, view))
    tops = [0]
    for seen, row in zip(observations, chosen, strict=False):
        assert observe(view, state).allowed[row, 0]
        x, y, z = seen["corners"][row]
        length, width, height = seen["sizes"][row]
        under = seen["heights"][x : x + length, y : y + width]
        assert under.shape == (length, width)
        assert under.max() == z
        tops.append(z + height)
        state = go(state, state.kinds.choice(np.asarray([row])))
    assert -sum(rewards) == state.opened[0]
    assert max(tops) <= world["problem"].bin[2]


@BOTH
def test_an_action_that_is_not_allowed_ends_the_episode_and_does_not_pay(world):
    env = PackingEnv(**world)
    observations, rewards = play(env, 3, lambda seen: np.argmin(seen["mask"]))
    assert len(rewards) == 1, "every row is allowed: the test shows nothing"
    assert rewards == [-world["distribution"].items]
    np.testing.assert_array_equal(observations[0]["remaining"], observations[1]["remaining"])


@BOTH
def test_many_at_once_do_what_each_does_alone(world):
    count, rng = 5, np.random.default_rng(1)
    many = gymnasium.make_vec(NAME, num_envs=count, **world)
    assert isinstance(many, PackingVectorEnv)
    assert many.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    alone = SyncVectorEnv([lambda: PackingEnv(**world)] * count)
    for name in ("observation_space", "action_space", "single_observation_space"):
        assert getattr(many, name) == getattr(alone, name)
    assert many.single_action_space == alone.single_action_space
    told = [envs.reset(seed=11) for envs in (many, alone)]
    ends = 0
    for _ in range(3 * world["distribution"].items):
        seen, info = told[0][0], told[0][-1]
        assert seen in many.observation_space
        for ours, theirs in zip(jax.tree.leaves(told[0]), jax.tree.leaves(told[1]), strict=True):
            np.testing.assert_array_equal(ours, theirs)
            assert ours.dtype == theirs.dtype
        # Some of the actions are not allowed, so that episodes end at different times.
        likely = info["mask"] + 2 * (rng.random(info["mask"].shape) < 0.01)
        actions = (likely * rng.random(likely.shape)).argmax(1)
        told = [envs.step(actions) for envs in (many, alone)]
        ends += told[0][2].sum()
    assert ends > 2 * count
    seeds = [3, None, 4, None, 5]
    for ours, theirs in zip(
        *(jax.tree.leaves(envs.reset(seed=seeds)) for envs in (many, alone)), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs)
    many.close()


def test_presets_are_named_and_what_cannot_be_is_one_line():
    assert gymnasium.make(NAME, preset="bin-aware-3d").unwrapped.action_space.n == 64
    assert PackingEnv().action_space.n == 25
    for wrong, message in (
        ({"preset": "paper-9d"}, "unknown preset 'paper-9d'"),
        ({"problem": Problem((4, 1, 4))}, "larger than the bin"),
        ({"problem": Problem((9, 9, 9), rule="nearest-corner")}, "one of cells whose rule is"),
    ):
        with pytest.raises(UserError, match=message):
            PackingEnv(**wrong)
    with pytest.raises(UserError, match="num_envs 0: give at least 1"):
        PackingVectorEnv(0)
