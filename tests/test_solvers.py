"""Makers of orders: the sorts, random keys, the best of many and the genetic algorithm."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import packer
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxpack.errors import UserError
from jaxpack.learning.presets import PAPER_2D
from jaxpack.model.instances import Distribution, sample
from jaxpack.model.metrics import bins_first_cost, paper_cost
from jaxpack.model.problem import Instance
from jaxpack.search.breeding import BrkgaConfig
from jaxpack.search.brkga import brkga, keys_of
from jaxpack.search.heuristics import (
    decode_keys,
    footprint_order,
    height_order,
    random_order,
    volume_order,
)
from jaxpack.search.sampling import best_of

ITEMS = 9
SIDES = st.tuples(*[st.integers(1, 3)] * 3)  # few sides, so that many items are equal
MASKS = st.lists(st.booleans(), min_size=ITEMS, max_size=ITEMS)


def instance_of(sizes, mask):
    return Instance(np.array(sizes, np.int32), np.array(mask), np.array([9, 9, 9], np.int32))


@jax.jit
def all_orders(seed, instance):
    return (
        volume_order(instance),
        footprint_order(instance),
        height_order(instance),
        random_order(jax.random.key(seed), instance),
    )


@settings(max_examples=150, deadline=None)
@given(st.lists(SIDES, min_size=ITEMS, max_size=ITEMS), MASKS, st.integers(0, 2**31 - 1))
def test_sorts_sort_by_their_keys_and_every_order_has_its_padding_last(sizes, mask, seed):
    volume, footprint, height, random = all_orders(seed, instance_of(sizes, mask))

    def by(key):
        """Real items by descending key, equal ones by index, then the padding by index."""
        real = [item for item in range(ITEMS) if mask[item]]
        padding = [item for item in range(ITEMS) if not mask[item]]
        return sorted(real, key=lambda item: ([-k for k in key(*sizes[item])], item)) + padding

    assert volume.tolist() == by(lambda length, width, height: [length * width * height])
    assert footprint.tolist() == by(lambda length, width, height: [length * width, height])
    assert height.tolist() == by(lambda length, width, height: [height, length * width])
    assert sorted(random.tolist()) == list(range(ITEMS))
    assert not any(mask[item] for item in random.tolist()[sum(mask) :])
    assert random.dtype == volume.dtype == jnp.int32


def test_random_order_is_uniform():
    # 4 items and one of padding in slot 2: each of the 24 orders 1,000 times in 24,000 keys.
    # Chi-square with 23 degrees of freedom: beyond 65 less than once in 100,000.
    mask = np.array([True, True, False, True, True])
    instance = instance_of([(1, 1, 1)] * 5, mask)
    keys = jax.random.split(jax.random.key(0), 24_000)
    orders = np.asarray(jax.jit(jax.vmap(random_order, (0, None)))(keys, instance))
    assert (orders[:, 4] == 2).all()
    seen, counts = np.unique(orders, axis=0, return_counts=True)
    assert len(seen) == 24
    assert ((counts - 1000) ** 2 / 1000).sum() < 65


DECODE, KEYS_OF = jax.jit(decode_keys), jax.jit(keys_of)
EXTREMES = [0, 1, 15, 16, 2**32 - 33, 2**32 - 17, 2**32 - 16, 2**32 - 1]


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.sampled_from(EXTREMES) | st.integers(0, 2**32 - 1), min_size=ITEMS, max_size=ITEMS),
    MASKS,
)
def test_decode_keys_sorts_by_key_then_index_with_padding_last(keys, mask):
    # Nine items take 4 bits for the index: keys that agree in the upper 28 are equal, and the
    # largest 28-bit pattern is the padding's.
    order = DECODE(np.array(keys, np.uint32), np.array(mask)).tolist()
    upper = [
        min(key >> 4, 2**28 - 2) if real else 2**28 for key, real in zip(keys, mask, strict=True)
    ]
    assert order == sorted(range(ITEMS), key=lambda item: (upper[item], item))


@settings(max_examples=60, deadline=None)
@given(st.permutations(range(ITEMS)), MASKS)
def test_keys_of_an_order_decode_to_it(order, mask):
    keys = KEYS_OF(np.array(order, np.int32))
    assert DECODE(keys, np.ones(ITEMS, bool)).tolist() == order
    # Padding goes to the end and leaves the others in their order.
    real = [item for item in order if mask[item]]
    assert DECODE(keys, np.array(mask)).tolist()[: len(real)] == real


@pytest.mark.parametrize("items", [1, 2, 8, 33, 1000])
def test_keys_of_round_trip_at_other_lengths(items):
    order = np.random.default_rng(items).permutation(items).astype(np.int32)
    assert DECODE(KEYS_OF(order), np.ones(items, bool)).tolist() == order.tolist()


# 24 instances of the paper's 2D items, 30 of them and in half of the instances 24 and padding,
# for everything that searches.
PROBLEM = PAPER_2D
COUNT, SLOTS = 24, 30
INSTANCES = sample(PROBLEM, Distribution(SLOTS, 1, 5), jax.random.key(4), COUNT)
INSTANCES = jax.tree.map(np.array, INSTANCES)
INSTANCES.mask[::2, :6] = False
KEYS = jax.random.split(jax.random.key(5), COUNT)
COSTS = {objective: jax.jit(jax.vmap(objective)) for objective in (bins_first_cost, paper_cost)}


def cost_of(objective, orders):
    """Cost [COUNT] of one order per instance."""
    return np.asarray(COSTS[objective](INSTANCES, packer(PROBLEM)(INSTANCES, orders)))


def assert_orders(orders):
    orders = np.asarray(orders)
    assert orders.dtype == np.int32
    assert (np.sort(orders, axis=-1) == np.arange(SLOTS)).all()
    masked = np.take_along_axis(INSTANCES.mask, orders, axis=-1)
    assert (masked[:, :-1] >= masked[:, 1:]).all()  # padding last


@pytest.mark.parametrize(
    ("objective", "samples", "chunk"), [(bins_first_cost, 13, 4), (paper_cost, 20, 50)]
)
def test_best_of_is_the_first_minimum_of_its_draws(objective, samples, chunk):
    # Sample i comes from fold_in(key, i): the answer for 13 samples is the best of the first 13 of
    # 20, so more are never worse, and how they are cut into chunks does not matter.
    @jax.jit
    @jax.vmap
    def draws(key, instance):
        keys = jax.vmap(jax.random.fold_in, (None, 0))(key, jnp.arange(20))
        return jax.vmap(random_order, (0, None))(keys, instance)

    def search(keys, instances):
        draw = jax.vmap(random_order)
        return best_of(PROBLEM, keys, instances, draw, samples, objective, chunk)

    orders = np.asarray(draws(KEYS, INSTANCES))
    costs = np.stack([cost_of(objective, orders[:, i]) for i in range(20)], axis=1)
    found = np.asarray(jax.jit(search)(KEYS, INSTANCES))
    first = costs[:, :samples].argmin(1)
    np.testing.assert_array_equal(found, orders[np.arange(COUNT), first])
    assert (costs[:, :13].min(1) > costs.min(1)).any()  # there is something to gain


CONFIG = BrkgaConfig(population=30, generations=20)


def genetic_orders(objective, keys, instances, seeds):
    return brkga(PROBLEM, keys, instances, CONFIG, objective, lambda keys, instances: seeds)


SEARCH = {
    objective: jax.jit(partial(genetic_orders, objective))
    for objective in (bins_first_cost, paper_cost)
}
SORTS = jax.jit(jax.vmap(lambda i: jnp.stack([height_order(i), volume_order(i)])))


def random_orders(key, count):
    """[COUNT, count, SLOTS] orders, as good a start as the algorithm's own."""
    keys = jax.random.split(key, (COUNT, count))
    return jax.jit(jax.vmap(jax.vmap(random_order, (0, None))))(keys, INSTANCES)


@pytest.mark.parametrize("objective", [bins_first_cost, paper_cost])
def test_brkga_is_never_worse_than_the_orders_it_starts_from(objective):
    seeds = SORTS(INSTANCES)
    orders = SEARCH[objective](KEYS, INSTANCES, seeds)
    assert_orders(orders)
    start = np.stack([cost_of(objective, seeds[:, i]) for i in range(2)]).min(0)
    found = cost_of(objective, orders)
    assert (found <= start).all()
    assert (found < start).any()


@pytest.mark.long
def test_brkga_is_a_function_of_its_key_and_the_same_one_by_one():
    search, seeds = SEARCH[bins_first_cost], SORTS(INSTANCES)
    orders = np.asarray(search(KEYS, INSTANCES, seeds))
    np.testing.assert_array_equal(search(KEYS, INSTANCES, seeds), orders)
    assert (np.asarray(search(KEYS[::-1], INSTANCES, seeds)) != orders).any()
    for i in (0, 5, COUNT - 1):
        one = jax.tree.map(lambda leaf, i=i: leaf[i : i + 1], INSTANCES)
        np.testing.assert_array_equal(search(KEYS[i : i + 1], one, seeds[i : i + 1])[0], orders[i])


def test_brkga_beats_random_orders_at_the_same_number_of_packings():
    # 30 packings to start with, two of them given but as random as the rest, and in each of 20
    # generations all but the elite of 6. By R, which is gradual: over six keys the algorithm was
    # 0.009 to 0.043 better. The number of bins of 24 instances is too coarse for a comparison.
    seeds = random_orders(jax.random.key(6), 2)
    found = cost_of(paper_cost, SEARCH[paper_cost](KEYS, INSTANCES, seeds))
    packings = 30 + 20 * (30 - 6)

    def sampled(keys, instances):
        draw = jax.vmap(random_order)
        return best_of(PROBLEM, keys, instances, draw, packings, paper_cost, chunk=255)

    random = cost_of(paper_cost, jax.jit(sampled)(KEYS, INSTANCES))
    assert found.mean() < random.mean()


def test_brkgas_shares_add_up():
    assert BrkgaConfig(population=100).shares == (20, 14, 66)
    assert BrkgaConfig(population=5).shares == (1, 1, 3)  # 0.7 of an individual rounds to one


@pytest.mark.parametrize(
    "bad",
    [
        {"population": 0},
        {"population": 2},  # 0.4 of an individual is no elite
        {"elite": 0.0},
        {"elite": 1.0},
        {"mutants": 0.8},
        {"generations": -1},
    ],
)
def test_a_bad_brkga_configuration_is_refused(bad):
    with pytest.raises(UserError, match="leave at least one elite and one child") as caught:
        BrkgaConfig(**bad)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("bad", [{"bias": 1.5}, {"bias": -0.1}, {"elite": float("nan")}])
def test_shares_that_are_no_shares_are_refused(bad):
    with pytest.raises(UserError):
        BrkgaConfig(**bad)
