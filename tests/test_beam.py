"""The beam that fills a bin: of width 1 it is the greedy, wider it is no worse, and it keeps twins
out.
"""

from itertools import islice

import numpy as np
import pytest

from jaxpack.model.encoding import load_job, plan_of
from jaxpack.model.job import ORIENTATIONS, BinType, ItemType, Job
from jaxpack.model.plan_check import check_plan
from jaxpack.model.rules import Rules
from jaxpack.search import filling
from jaxpack.search.beam import _twins, fill, fill_by_beam
from jaxpack.search.bin_types import cheapest_types
from jaxpack.search.bin_values import search_values
from jaxpack.search.draws import by_size, drawn
from jaxpack.search.fillings import kinds_of


def never():
    return False


def loading_of(seed, kinds=5, copies=4, support=0.5, profits=False):
    rng = np.random.default_rng(seed)
    items = tuple(
        ItemType(
            tuple(map(float, rng.integers(3, 9, 3))),
            int(rng.integers(1, copies + 1)),
            orientations=tuple(ORIENTATIONS),
            profit=float(rng.integers(1, 50)) if profits else None,
        )
        for _ in range(kinds)
    )
    bins = (BinType((14.0, 13.0, 12.0), copies=1),)
    return load_job(Job(items, bins, objective="value"), Rules(support))


def goods_of(kinds, draws, seed=0):
    K, lanes = len(kinds.count), np.arange(draws)
    which = np.repeat(np.arange(K)[:, None], draws, 1)
    value, left = by_size(kinds)[:, None], kinds.count[:, None]
    sums, random = kinds.sums(kinds.count), np.random.default_rng(seed)
    return drawn(kinds, which, value, left, 0 * lanes, sums, 0 * lanes, lanes, random)[0]


def worth(kinds, full):
    return kinds.size @ (kinds.count[:, None] - full.left)


def beam(kinds, goods, width, children):
    return fill_by_beam(kinds, goods, kinds.size, width, children, never)


@pytest.mark.parametrize("seed", range(4))
def test_of_width_one_it_is_the_greedy(seed):
    kinds = kinds_of(loading_of(seed))
    goods = goods_of(kinds, 8)
    greedy = fill(kinds, goods, never)
    for mine, theirs in zip(beam(kinds, goods, 1, 1), greedy, strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize("seed", range(4))
def test_it_is_never_worse_than_the_greedy_and_mostly_better(seed):
    kinds = kinds_of(loading_of(seed, kinds=8))
    goods = goods_of(kinds, 8)
    greedy, wide = worth(kinds, beam(kinds, goods, 1, 1)), worth(kinds, beam(kinds, goods, 4, 3))
    assert (wide >= greedy).all()
    assert (wide > greedy).mean() >= 0.5


def test_lanes_do_not_see_each_other():
    kinds = kinds_of(loading_of(1, kinds=8))
    goods = goods_of(kinds, 6)
    together = beam(kinds, goods, 3, 3)
    for lane in range(6):
        alone = beam(kinds, filling.some_lanes(goods, np.array([lane])), 3, 3)
        for mine, theirs in zip(alone, together, strict=True):
            np.testing.assert_array_equal(mine[..., 0], theirs[..., lane])


def test_sequences_of_the_same_blocks_are_one_child():
    kinds = kinds_of(loading_of(2))
    goods = goods_of(kinds, 4)
    full = fill(kinds, goods, never)
    used, random = int(full.used[0]), np.random.default_rng(0)
    assert used > 2
    order = np.arange(len(full.row))
    order[:used] = random.permutation(used)
    shuffled = full._replace(
        row=full.row[order], grid=full.grid[:, order], near=full.near[:, order], far=full.far
    )
    np.testing.assert_array_equal(_twins(full)[0], _twins(shuffled)[0])
    moved = full._replace(near=full.near + (np.arange(3) == 0)[:, None, None])
    assert _twins(full)[0] != _twins(moved)[0]


@pytest.mark.parametrize("support", [0.0, 0.5, 1.0])
def test_a_best_subset_is_a_plan_and_the_same_again(support):
    loading = loading_of(3, kinds=9, support=support, profits=True)
    costs = []
    for _ in range(2):
        found = [best for best, _ in islice(search_values(loading, 5, never), 4) if best]
        costs.append([best.cost for best in found])
        for best in found:
            types = cheapest_types(loading, best.genes.turn, best.bin, best.corner)
            genes = best.genes
            plan = plan_of(loading, genes.order, genes.turn, best.bin, best.corner, types)
            check_plan(loading.job, plan, loading.rules)
    assert costs[0] == costs[1]
    assert costs[0] == sorted(costs[0], reverse=True)


def test_one_that_is_stopped_has_what_it_met():
    loading = loading_of(4, kinds=9)
    kinds, asked = kinds_of(loading), iter(range(10**9))
    goods = goods_of(kinds, 4)
    full = fill_by_beam(kinds, goods, kinds.size, 4, 3, lambda: next(asked) > 60)
    assert (worth(kinds, full) > 0).all()
