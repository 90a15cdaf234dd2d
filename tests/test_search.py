"""Searches in rounds: budgets are kept, more is never worse, bins are filled one by one."""

import itertools
import time
from functools import cache, partial

import jax
import numpy as np
import pytest
from cases import packer

from jaxpack.learning.presets import PAPER_2D
from jaxpack.model.instances import Distribution, sample
from jaxpack.model.metrics import bins_first_cost
from jaxpack.model.problem import Instance
from jaxpack.search.bin_by_bin import bin_by_bin, orders_found
from jaxpack.search.breeding import BrkgaConfig
from jaxpack.search.brkga import genetic
from jaxpack.search.evolved import evolved
from jaxpack.search.heuristics import height_order, random_order
from jaxpack.search.protocol import Search, compile_search, run_for, run_rounds
from jaxpack.search.sampling import sampling

COUNT, ITEMS = 30, 30
INSTANCES = sample(PAPER_2D, Distribution(ITEMS, 1, 5), jax.random.key(1), COUNT)
INSTANCES = Instance(INSTANCES.size, INSTANCES.mask.at[::2, :8].set(False), INSTANCES.bin)
KEYS = jax.random.split(jax.random.key(2), COUNT)
DRAW = jax.vmap(random_order)
HEIGHT = jax.vmap(height_order)
BIN_BY_BIN = bin_by_bin(
    PAPER_2D, lambda keys, instances: HEIGHT(instances), DRAW, bins_first_cost, 3, 4
)
BREEDING = genetic(PAPER_2D, BrkgaConfig(population=10))
SEARCHES = {
    "bin by bin": BIN_BY_BIN,
    "evolved": evolved(PAPER_2D, BIN_BY_BIN, orders_found, BREEDING, bins_first_cost, 3),
    "bred": BREEDING,
    "sampling": sampling(PAPER_2D, DRAW, bins_first_cost, 12),
}


def costs_of(orders):
    orders = np.asarray(orders)
    assert orders.dtype == np.int32
    assert (np.sort(orders, 1) == np.arange(ITEMS)).all()
    packings = packer(PAPER_2D)(INSTANCES, orders)
    return np.asarray(jax.vmap(bins_first_cost)(INSTANCES, packings))


@cache
def costs_after(name, rounds):
    return costs_of(jax.jit(partial(run_rounds, SEARCHES[name], rounds=rounds))(KEYS, INSTANCES))


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    [
        "bin by bin",
        pytest.param("evolved", marks=pytest.mark.slow),
        "sampling",
    ],
)
def test_more_rounds_are_never_worse_and_pay(name):
    costs = [costs_after(name, rounds) for rounds in (1, 4, 9)]
    assert (costs[1] <= costs[0]).all()
    assert (costs[2] <= costs[1]).all()
    assert costs[2].mean() < costs[0].mean()


def test_bin_by_bin_is_never_worse_than_what_it_starts_from_and_beats_whole_orders():
    # 9 rounds of 3 * 4 draws, against 108 whole orders and against the sort it starts from.
    found, start = costs_after("bin by bin", 9), costs_of(HEIGHT(INSTANCES))
    assert (found <= start).all()
    assert found.mean() < min(start.mean(), costs_after("sampling", 9).mean())


@pytest.mark.slow
def test_what_has_bred_is_never_worse_than_what_it_comes_from_and_better_than_either():
    # 4 rounds of 3 generations each, against 4 rounds and against 12 generations.
    evolved, found = costs_after("evolved", 4), costs_after("bin by bin", 4)
    assert (evolved <= found).all()
    assert evolved.mean() < min(found.mean(), costs_after("bred", 12).mean())


@pytest.mark.slow
def test_more_finds_than_individuals_breed_too():
    few = genetic(PAPER_2D, BrkgaConfig(population=3))
    search = evolved(PAPER_2D, BIN_BY_BIN, orders_found, few, bins_first_cost, 1)
    bred = costs_of(jax.jit(partial(run_rounds, search, rounds=1))(KEYS, INSTANCES))
    assert (bred <= costs_after("bin by bin", 1)).all()


def test_filled_bins_stay_as_they_were():
    search = SEARCHES["bin by bin"]
    before = jax.jit(search.advance)(INSTANCES, search.start(KEYS, INSTANCES))
    after = jax.jit(search.advance)(INSTANCES, before)
    passed = np.asarray(after.filled) == 2
    assert passed.sum() > 5
    firsts = [
        {tuple(np.flatnonzero(bins == 0)) for bins in np.asarray(beams)[passed][0]}
        for beams in (before.bin, after.bin)
    ]
    assert firsts[1] <= firsts[0], "a beam's first bin was drawn again"


class Clock:
    """Time passes only in the rounds of its search: what else runs on the machine is immaterial."""

    def __init__(self):
        self.now = 100.0

    def search(self, durations):
        """A search that counts its rounds; they take so many seconds, the last for ever after."""

        def advance(instances, state):
            self.now += durations[min(state, len(durations) - 1)]
            return state + 1

        return Search(lambda keys, instances: 0, advance, lambda state: state)


@pytest.mark.parametrize(
    ("limit", "durations", "rounds"),
    [
        (0.5, [0.0625], 8),  # used to the end
        (0.5, [0.07], 7),  # an eighth would end late
        (0.4, [0.3], 1),  # the first is begun blind, a second would end late
        (0.1, [0.3], 1),
        # After 0.625 s one as long as the longest still ends in time, not after 0.75.
        (1.0, [0.125, 0.375, 0.125], 4),
    ],
)
def test_a_time_limit_is_kept_and_used(limit, durations, rounds, monkeypatch):
    clock = Clock()
    monkeypatch.setattr("jaxpack.search.protocol.time.perf_counter", lambda: clock.now)
    assert run_for(clock.search(durations), KEYS, INSTANCES, limit) == rounds
    assert clock.now - 100 <= max(limit, durations[0])


def test_what_is_left_of_the_time_goes_to_smaller_rounds(monkeypatch):
    clock = Clock()
    monkeypatch.setattr("jaxpack.search.protocol.time.perf_counter", lambda: clock.now)

    def refine(instances, state):
        clock.now += 0.03125
        return state + 100

    search = clock.search([0.25])._replace(refine=refine)
    # Three whole rounds in 0.875 s; four small ones in the eighth that is left.
    assert run_for(search, KEYS, INSTANCES, 0.875) == 403
    assert clock.now == 100.875
    # None at all where the start took all the time.
    late = search._replace(start=lambda keys, instances: clock.search([1.0]).advance(None, -1))
    assert run_for(late, KEYS, INSTANCES, 0.5) == 0


@pytest.mark.slow
def test_the_smaller_rounds_of_what_has_bred_are_never_worse():
    search = SEARCHES["evolved"]
    state = search.start(KEYS, INSTANCES)
    costs = [costs_of(search.best(state))]
    for _ in range(3):
        state = jax.jit(search.refine)(INSTANCES, state)
        costs.append(costs_of(search.best(state)))
    assert all((after <= before).all() for before, after in itertools.pairwise(costs))
    assert costs[-1].mean() < costs[0].mean()


def test_a_time_limit_is_one_of_wall_time():
    def sleep(instances, state):
        time.sleep(0.02)  # which takes none of the processor's
        return state + 1

    search = Search(lambda keys, instances: 0, sleep, lambda state: state)
    assert run_for(search, KEYS, INSTANCES, 0.5) <= 25


def test_a_compiled_search_finds_the_same():
    search = SEARCHES["sampling"]
    compiled = compile_search(search, KEYS, INSTANCES)
    np.testing.assert_array_equal(
        run_rounds(search, KEYS, INSTANCES, 3),
        compiled.best(
            compiled.advance(
                INSTANCES,
                compiled.advance(
                    INSTANCES, compiled.advance(INSTANCES, compiled.start(KEYS, INSTANCES))
                ),
            )
        ),
    )
