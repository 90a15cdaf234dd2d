"""The policy that chooses blocks: what it sees, and that it packs more than the score by hand."""

import importlib.util
import sys
from functools import partial
from itertools import islice
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpack.model.encoding import load_job
from jaxpack.model.rules import Rules
from jaxpack.search import filling
from jaxpack.search.beam import fill
from jaxpack.search.bin_values import search_values
from jaxpack.search.block_policy import FEATURES, Weights, score, shipped
from jaxpack.search.blocks import step
from jaxpack.search.draws import drawn
from jaxpack.search.fillings import kinds_of
from jaxpack.search.portfolio import SolveOptions, solve_job

EXPERIMENTS = Path(__file__).parents[1] / "experiments"


@pytest.fixture(scope="module")
def training():
    spec = importlib.util.spec_from_file_location("train_blocks", EXPERIMENTS / "train_blocks.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["train_blocks"] = module
    spec.loader.exec_module(module)
    return module


def never():
    return False


def greedy(job, support, judge):
    """(share of the bin that is filled in both directions [2], the fillings)."""
    kinds = kinds_of(load_job(job, Rules(support)), judge)
    lanes, which = np.arange(2), np.arange(len(kinds.count))[:, None]
    random, sums = np.random.default_rng(0), kinds.sums(kinds.count)
    value, left = kinds.size[:, None], kinds.count[:, None]
    which = np.repeat(which, 2, 1)
    goods, _ = drawn(kinds, which, value, left, 0 * lanes, sums, 0 * lanes, lanes, random)
    full = fill(kinds, goods, never)
    room = kinds.loading.stock.bins[0].astype(float).prod()
    return kinds.size @ (left - full.left) / room, full


def test_it_sees_shares(training):
    seen, random = [], np.random.default_rng(3)

    def judge(features):
        seen.append(features)
        return np.zeros(features.shape[1], np.float32)

    for _ in range(6):
        job, support = training.made_order(random)
        shares, full = greedy(job, support, judge)
        same, by_hand = greedy(job, support, None)
        # What adds nothing changes nothing: the score is one of the space, whatever its size.
        np.testing.assert_array_equal(full.left, by_hand.left)
        np.testing.assert_array_equal(shares, same)
    features = np.concatenate(seen, 1)
    assert features.shape[0] == FEATURES
    assert features.shape[1] > 1000
    assert features.min() >= 0
    assert features.max() <= 1


def test_it_fills_more_than_the_score_by_hand(training):
    """On made orders that it was not trained on."""
    random, gains = np.random.default_rng(99), []
    for _ in range(24):
        job, support = training.made_order(random)
        gains.append(greedy(job, support, shipped())[0] - greedy(job, support, None)[0])
    assert np.mean(gains) > 0.01


def test_a_search_may_do_without(training):
    job, _ = training.made_order(np.random.default_rng(12))
    loading = load_job(job)
    *_, best = (best for best, _ in islice(search_values(loading, 0, never), 5) if best)
    volumes = [np.prod(job.items[item].size) for item in loading.items[best.bin >= 0]]
    without, learned = (
        solve_job(job, SolveOptions(packings=6, policy=policy)) for policy in (False, True)
    )
    assert without.measure == sum(volumes)
    assert learned.measure != without.measure


def test_an_update_moves_the_weights_towards_what_packed_more(training, monkeypatch):
    monkeypatch.setattr(training, "BATCH", 4)
    monkeypatch.setattr(training, "PAIRS", 2)
    monkeypatch.setattr(training, "NOISES", Weights(0.5, 0.5, 0.5))
    goods, weights = training.made_goods(2, 5), training.first_weights(0)
    nothing = jax.tree.map(jnp.zeros_like, weights)
    state = training.State(weights, nothing, nothing)
    after = training.update(goods, state, jax.random.key(0), jnp.float32(1), jnp.float32(0.1))
    moved = np.asarray(after.weights.out - weights.out)
    assert np.isfinite(moved).all()
    assert moved.any()
    again = training.update(goods, state, jax.random.key(0), jnp.float32(1), jnp.float32(0.1))
    np.testing.assert_array_equal(again.weights.out, after.weights.out)


def test_compiled_it_scores_the_same(training):
    goods = training.made_goods(3, 7)
    weights = training.first_weights(1)._replace(out=jnp.linspace(-0.1, 0.1, 8))
    kinds_axes = training.AXES
    here = filling.Goods(*map(np.asarray, goods))
    bins = [filling.empty(xp, of, 32) for xp, of in ((np, here), (jnp, goods))]

    def filled(xp, of, now):
        return step(xp, kinds_axes, of, now, judge=lambda seen: score(xp, weights, seen))

    compiled = jax.jit(partial(filled, jnp))
    for _ in range(3):
        bins = filled(np, here, bins[0]), compiled(goods, bins[1])
    for mine, theirs in zip(*bins, strict=True):
        np.testing.assert_array_equal(mine, theirs)
