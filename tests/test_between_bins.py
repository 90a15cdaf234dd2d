"""Bins that are emptied into the others: nothing is lost, nothing gets worse, and bins go."""

import numpy as np
import pytest
from test_bin_values import UPRIGHT, job_of, plan

from jaxpack.model.encoding import lane_genes, load_job
from jaxpack.model.job import BinType, ItemType, Job
from jaxpack.model.plan_check import check_plan
from jaxpack.model.rules import Rules
from jaxpack.search.beam import alone
from jaxpack.search.between_bins import Between, filled_bins
from jaxpack.search.bin_values import search_values
from jaxpack.search.fillings import best_of, kinds_of
from jaxpack.search.quick import quick_plan


def sorted_packing(loading):
    """A packing, the first sort's."""
    return quick_plan(loading, lane_genes(loading, 0, 0))


def improved(loading, rounds, seed=0, start=None):
    """(prices before and after every round, the packing after the last)."""
    kinds = kinds_of(loading)
    between = Between(kinds, np.random.default_rng(seed))
    between.begin(filled_bins(kinds, start or sorted_packing(loading)))
    prices = [between.price_of(between.bins)]
    for _ in range(rounds):
        list(alone(between.round(lambda: False), lambda: False))
        prices.append(between.price_of(between.bins))
    return prices, best_of(kinds, between.bins)


CASES = [
    (Rules(), {"kinds": 12, "copies": 1}),
    (Rules(), {"weights": True, "types": 3}),
    (Rules(1.0), {"types": 2, "ways": UPRIGHT, "kinds": 9, "copies": 2}),
    (Rules(0.0), {"kinds": 14, "copies": 1, "ways": ("XYZ",)}),
    (Rules(0.7), {"dimension": 2, "kinds": 20, "copies": 2}),
    (Rules(0.5, True), {"dimension": 2, "types": 2, "weights": True, "kinds": 20, "copies": 1}),
]


@pytest.mark.parametrize(("rules", "how"), CASES)
def test_everything_stays_packed_and_no_round_is_for_the_worse(rules, how):
    for seed in range(2):
        loading = load_job(job_of(seed, **how), rules)
        start = sorted_packing(loading)
        assert (start.bin >= 0).all()
        prices, best = improved(loading, 12, seed, start)
        assert prices == sorted(prices, reverse=True)
        assert best is not None
        found = plan(loading, best)
        check_plan(loading.job, found, rules)
        assert not found.left_out


def test_a_packing_as_fillings_is_the_same_packing():
    for seed in range(6):
        loading = load_job(job_of(seed, types=2, weights=True))
        kinds, start = kinds_of(loading), sorted_packing(loading)
        best = best_of(kinds, filled_bins(kinds, start))
        assert best is not None
        check_plan(loading.job, plan(loading, best))
        assert best.cost == pytest.approx(start.cost)
        places = [
            sorted(zip(kinds.rows.tolist(), map(tuple, one.corner.tolist()), strict=True))
            for one in (start, best)
        ]
        assert places[0] == places[1]


def test_the_same_seed_gives_the_same():
    loading = load_job(job_of(5, kinds=9, copies=2, types=2, ways=UPRIGHT))
    (one, first), (other, second) = (improved(loading, 12, seed=4) for _ in range(2))
    assert one == other
    np.testing.assert_array_equal(first.bin, second.bin)
    np.testing.assert_array_equal(first.corner, second.corner)


def spread(loading):
    """A packing with every item alone in a bin."""
    start = sorted_packing(loading)
    N = len(start.bin)
    return start._replace(bin=np.arange(N, dtype=np.int32), corner=np.zeros((N, 3), np.int32))


def test_bins_go_until_all_is_in_one():
    sides = [(3, 3, 4), (3, 3, 6), (3, 2, 5), (3, 4, 5), (3, 1, 10), (3, 5, 10)]
    items = tuple(ItemType(tuple(map(float, size))) for size in sides)
    loading = load_job(Job(items, (BinType((6.0, 10.0, 10.0)),)))
    prices, best = improved(loading, 60, start=spread(loading))
    assert prices[0] > prices[-1]
    assert set(best.bin.tolist()) == {0}


def test_cheaper_types_are_taken_while_there_are_some():
    items = (ItemType((5.0, 5.0, 5.0), 6),)
    small, large = BinType((5.0, 5.0, 5.0), 1.0, 2), BinType((10.0, 10.0, 5.0), 5.0)
    loading = load_job(Job(items, (large, small)))
    start = spread(loading)
    _, best = improved(loading, 200, start=start)
    used = sorted(one.bin for one in plan(loading, best).bins)
    assert used == [0, 1, 1]


def test_a_search_by_value_goes_on_from_what_is_known():
    loading = load_job(job_of(2, kinds=16, copies=1))
    known = []
    tried = search_values(loading, 0, lambda: False, known=lambda: known[-1] if known else None)
    costs = []
    for _ in range(16):
        best, _ = next(tried)
        if best:
            check_plan(loading.job, plan(loading, best))
            costs.append(best.cost)
            known.append(best)
    assert costs == sorted(costs, reverse=True)


@pytest.mark.parametrize("turned", [False, True])
def test_sheets_of_few_kinds_are_cut_in_ways_that_differ_from_block_to_block(turned):
    """Only blocks that are shorter here, but not there, come to one sheet in time."""
    pieces, room = [(95, 412, 9), (136, 262, 18)], (889.0, 1.0, 1194.0)
    items = tuple(
        ItemType((float(x), 1.0, float(z)), copies, orientations=("XYZ", "ZYX"))
        for x, z, copies in pieces
    )
    bins = (BinType(room[::-1] if turned else room),)
    tried = search_values(load_job(Job(items, bins, 2)), 0, lambda: False)
    for _ in range(400):
        best, _ = next(tried)
        if best and len(set(best.bin.tolist())) == 1:
            return
    pytest.fail("two sheets")
