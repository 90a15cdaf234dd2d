"""The training program: pure, traced once, the same in pieces as in one go."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import TINY

from jaxpack import Cell, Distribution, TrainConfig, make_train
from jaxpack.errors import UserError
from jaxpack.io.configs import config_from_dict, config_to_dict
from jaxpack.learning import trainer
from jaxpack.learning.losses import Outcome
from jaxpack.learning.pointer import PointerConfig
from jaxpack.learning.presets import PRESETS, preset
from jaxpack.learning.shuffle import shuffled
from jaxpack.learning.trainer import (
    ChunkMetrics,
    init_state,
    train_chunk,
    train_step,
    train_updates,
    training_instances,
    validation_set,
)

SMALL = replace(
    TINY,
    policy=PointerConfig(hidden=16, critic=8),
    train_instances=64,
    valid_instances=16,
    batch=16,
    epochs=2,
)
NOTHING = ChunkMetrics(Outcome(*[jnp.float32(0)] * len(Outcome._fields)), *[jnp.float32(0)] * 2)


def assert_same_bits(one, two):
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(two), strict=True):
        if jnp.issubdtype(a.dtype, jax.dtypes.prng_key):
            a, b = jax.random.key_data(a), jax.random.key_data(b)
        np.testing.assert_array_equal(a, b)


def assert_close(one, two):
    difference = jax.tree.map(lambda a, b: jnp.abs(a - b).max(), one, two)
    assert max(jax.tree.leaves(difference)) < 1e-5


@pytest.mark.slow
def test_three_seeds_and_rates_train_at_once_and_the_cost_falls():
    config = replace(SMALL, train_instances=3200, batch=32)
    train = make_train(config)
    seeds, rates = jnp.arange(3), jnp.asarray([5e-3, 5e-3, 0.0])
    states, metrics = jax.jit(jax.vmap(lambda seed, rate: train(jax.random.key(seed), rate)))(
        seeds, rates
    )
    assert metrics.outcome.cost.shape == (3, config.epochs)
    assert (states.update == config.updates).all()
    assert (metrics.finite == 1).all()
    assert (metrics.outcome.cost[:2, 1] < 0.98 * metrics.outcome.cost[:2, 0]).all()
    # A rate of zero is no training: the third run ends with the weights it began with.
    untrained = init_state(config, jax.random.key(2)).params
    assert_same_bits(jax.tree.map(lambda leaf: leaf[2], states.params), untrained)


@pytest.mark.long
def test_chunks_of_any_length_give_the_same_bits_from_one_trace_each():
    before = train_chunk._cache_size()
    start = init_state(SMALL, jax.random.key(0))
    state = jax.tree.map(jnp.copy, start)
    for _ in range(2):
        state, _ = train_chunk(SMALL, state, 2)
    assert train_chunk._cache_size() == before + 1
    epoch, _ = train_chunk(SMALL, start, 4)
    assert_same_bits(state, epoch)
    assert jax.tree.leaves(start.params)[0].is_deleted(), "the state was copied, not donated"
    # The pure function, vmapped over three keys, trains the same policy.
    train = make_train(replace(SMALL, epochs=1))
    many, _ = jax.jit(jax.vmap(lambda seed: train(jax.random.key(seed))))(jnp.asarray([7, 0, 8]))
    second = jax.tree.map(lambda leaf: leaf[1], many.params)
    assert_close(second, epoch.params)


def test_an_epoch_uses_every_instance_once_in_another_order_each_time(monkeypatch):
    sizes = training_instances(SMALL, jax.random.key(0), jnp.arange(64)).size
    row_of = {np.asarray(size).tobytes(): row for row, size in enumerate(sizes)}
    assert len(row_of) == 64
    seen = []

    def record(config, state, instances, mesh):
        jax.debug.callback(lambda size: seen.extend(np.asarray(size)), instances.size, ordered=True)
        return state._replace(update=state.update + 1), NOTHING

    monkeypatch.setattr(trainer, "train_step", record)
    state = init_state(SMALL, jax.random.key(0))
    epochs = []
    for _ in range(2):
        seen.clear()
        state, _ = train_updates(SMALL, state, SMALL.updates_per_epoch)
        jax.effects_barrier()
        epochs.append([row_of[size.tobytes()] for size in seen])
        assert sorted(epochs[-1]) == list(range(64))
    assert epochs[0] != epochs[1]


@pytest.mark.slow
def test_updates_take_turns_over_bins_and_distributions():
    config = replace(SMALL, others=(Cell((5, 5, 5), Distribution(6, 1, 3)),))
    own, other = config.turns
    assert own == SMALL
    assert (other.problem.bin, other.distribution.items) == ((5, 1, 5), 6)
    assert config_from_dict(TrainConfig, json.loads(json.dumps(config_to_dict(config)))) == config
    start = init_state(config, jax.random.key(0))
    both, _ = train_chunk(config, jax.tree.map(jnp.copy, start), 2)
    key = jax.random.fold_in(jax.random.fold_in(start.key, 4), 0)
    whole = shuffled(key, jnp.arange(64), 64)
    state = start
    for turn, rows in ((own, whole[:16]), (other, whole[16:32])):
        instances = training_instances(turn, state.key, rows)
        state, _ = jax.jit(train_step, static_argnums=0)(turn, state, instances)
    assert_close(both.params, state.params)


@pytest.mark.long
def test_the_mean_of_the_weights_is_over_all_updates_first_and_then_over_the_last():
    config = replace(SMALL, average=0.3)
    state = init_state(config, jax.random.key(0))
    update = jax.jit(train_step, static_argnums=0)
    mean = state.params
    for done, decay in enumerate((1 / 10, 2 / 11, 3 / 12, 0.3, 0.3)):
        instances = training_instances(config, state.key, 16 * (done % 4) + jnp.arange(16))
        state, _ = update(config, state, instances)
        mean = jax.tree.map(lambda m, p, d=decay: d * m + (1 - d) * p, mean, state.params)
        assert_close(state.kept, mean)
    plain = init_state(SMALL, jax.random.key(0))
    assert plain.kept is plain.params
    # What a checkpoint from before these fields holds, and has to be read as.
    assert plain._fields == ("params", "optimizer", "key", "update", "learning_rate")
    assert type(plain.optimizer).__name__ == "ScaleByAdamState"


def test_a_shuffle_has_every_number_once_and_everywhere_as_often():
    shuffle = jax.jit(shuffled, static_argnums=2)
    for count in (1, 2, 3, 5, 64, 1000, 4097):
        whole = np.asarray(shuffle(jax.random.key(count), np.arange(count), count))
        np.testing.assert_array_equal(np.sort(whole), np.arange(count))
        some = np.arange(count - 1, -1, -3)
        np.testing.assert_array_equal(shuffle(jax.random.key(count), some, count), whole[some])
    many = jax.vmap(lambda key: shuffled(key, jnp.arange(5), 5))
    drawn = np.asarray(jax.jit(many)(jax.random.split(jax.random.key(0), 24_000)))
    for place in range(5):
        often = np.bincount(drawn[:, place], minlength=5)
        np.testing.assert_allclose(often / 24_000, 0.2, atol=0.015)
    orders = np.unique(drawn, axis=0, return_counts=True)[1]
    assert len(orders) == 120
    assert orders.max() < 2 * orders.min(), "not every shuffle is as likely: 200 of each expected"


@pytest.mark.long
def test_some_turns_have_half_of_the_items():
    config = replace(SMALL, halves=2, others=(Cell((5, 5, 5), Distribution(6, 1, 3)),))
    sizes = [turn.distribution.items for turn in config.turns]
    assert sizes == [8, 4, 4, 6]
    assert config.turns[1] == replace(SMALL, distribution=replace(SMALL.distribution, items=4))
    assert replace(SMALL, distribution=Distribution(5, 1, 4), halves=1).turns[1] == replace(
        SMALL, distribution=Distribution(3, 1, 4)
    )
    start = init_state(replace(SMALL, halves=1), jax.random.key(0))
    key = jax.random.fold_in(jax.random.fold_in(start.key, 4), 0)
    rows = shuffled(key, jnp.arange(64), 64)
    half = replace(SMALL, distribution=replace(SMALL.distribution, items=4))
    state = start
    for at, turn in enumerate((SMALL, half, SMALL)):
        instances = training_instances(turn, state.key, rows[16 * at : 16 * (at + 1)])
        state, _ = jax.jit(train_step, static_argnums=0)(turn, state, instances)
    found, _ = train_chunk(replace(SMALL, halves=1), jax.tree.map(jnp.copy, start), 3)
    assert_close(found.params, state.params)


def test_sets_differ_and_are_fixed_by_the_key():
    key = jax.random.key(7)
    train = training_instances(SMALL, key, jnp.arange(16)).size
    valid = validation_set(SMALL, key, jnp.arange(16)).size
    assert not (train == valid).all()
    np.testing.assert_array_equal(
        train[3], training_instances(SMALL, key, jnp.asarray([3])).size[0]
    )
    assert not (train == training_instances(SMALL, jax.random.key(8), jnp.arange(16)).size).all()


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_builds(name):
    config = preset(name)
    state = jax.eval_shape(lambda: init_state(config, jax.random.key(0)))
    rows = jax.ShapeDtypeStruct((config.batch,), jnp.int32)
    instances = jax.eval_shape(
        lambda rows: training_instances(config, jax.random.key(0), rows), rows
    )
    after, metrics = jax.eval_shape(lambda s, i: train_step(config, s, i), state, instances)
    assert jax.tree.map(jnp.shape, after.params) == jax.tree.map(jnp.shape, state.params)
    assert metrics.outcome.cost.shape == ()


def test_the_papers_recipe():
    for name, items, sides in (("paper-2d", 40, (1, 5)), ("paper-3d", 70, (2, 5))):
        config = preset(name)
        assert config.updates == 10_000  # 100,000 / 50 * 5
        assert (config.train_instances, config.valid_instances) == (100_000, 10_000)
        assert (config.batch, config.epochs, config.learning_rate) == (50, 5, 5e-4)
        assert (config.alpha, config.beta) == (0.5, 0.5)
        d = config.distribution
        assert (d.items, (d.low, d.high)) == (items, sides)
    assert preset("paper-2d").problem.bin == (10, 1, 10)
    assert preset("paper-2d").problem.inclusive
    assert preset("paper-3d").problem.bin == (10, 10, 10)
    assert not preset("paper-3d").problem.inclusive


def test_bad_recipes_are_refused():
    with pytest.raises(UserError, match="unknown preset 'paper-4d': choose one of bin-aware-2d"):
        preset("paper-4d")
    common = {"problem": SMALL.problem, "distribution": SMALL.distribution}
    for wrong, message in (
        ({"batch": 0}, "batch 0"),
        ({"epochs": 0}, "epochs 0"),
        ({"batch": 100, "train_instances": 10}, "larger than train_instances"),
        ({"learning_rate": 0.0}, "learning_rate 0.0"),
        ({"distribution": Distribution(8, 1, 7)}, "larger than the bin"),
        ({"halves": -1}, "halves -1: give at least 0"),
        ({"average": 1.0}, "average 1.0: give a decay, 0 or more and below 1"),
        ({"loss_steps": 0.5}, "loss_steps 0.5: give 1, the pointer network learns from whole"),
    ):
        with pytest.raises(UserError, match=message):
            TrainConfig(**(common | wrong))
