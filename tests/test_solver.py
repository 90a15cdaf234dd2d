"""From a job to a plan: valid, in the time given, and no worse than its parts."""

import math
import time
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from jaxpack.errors import UserError
from jaxpack.io.weights import load_policy
from jaxpack.model.encoding import (
    Genes,
    compiles,
    lane_genes,
    load_job,
    most_together,
    padded_genes,
    plan_of,
)
from jaxpack.model.figures import plan_figures
from jaxpack.model.job import ORIENTATIONS, BinType, ItemType, Job
from jaxpack.model.limits import ItemLimits
from jaxpack.model.objectives import bounds
from jaxpack.model.plan_check import check_plan
from jaxpack.model.rules import Rules
from jaxpack.model.units import units_of
from jaxpack.search import portfolio
from jaxpack.search.bin_types import cheapest_types
from jaxpack.search.compiled import first_genes, packer_of, search
from jaxpack.search.local_search import advance, bred, exchange, join, packed
from jaxpack.search.packer import encode, first_fit, pack_lanes
from jaxpack.search.policy_orders import policy_genes
from jaxpack.search.portfolio import SolveOptions, improve, solve_job
from jaxpack.search.quick import (
    cost_of,
    genes_of,
    pack_quickly,
    quick_plan,
    runs_of,
    search_quickly,
)
from jaxpack.search.record import End

WAYS = tuple(ORIENTATIONS)


@pytest.fixture
def uncompiled(monkeypatch):
    """The search in NumPy alone."""
    monkeypatch.setattr("jaxpack.search.portfolio.compiles", lambda loading: False)


def cartons(seed, kinds=5, ways=("XYZ", "YXZ")):
    rng = np.random.default_rng(seed)
    sides = rng.choice([150.0, 200.0, 250.5, 300.0, 400.0], (kinds, 3))
    return tuple(
        ItemType(
            tuple(row), copies=int(rng.integers(1, 4)), weight=float(weight), orientations=ways
        )
        for row, weight in zip(sides.tolist(), rng.uniform(1, 9, kinds).round(1), strict=True)
    )


PALLET = BinType((800.0, 600.0, 700.0))


def flat(type):
    flattened = replace(type, size=(type.size[0], 1.0, type.size[2]))
    if isinstance(type, BinType):
        return flattened
    return replace(flattened, orientations=("XYZ", "ZYX")[: len(type.orientations)])


def searched(job, seconds=1.0, **options):
    """The best plan of a short search."""
    return solve_job(job, SolveOptions(seconds, **options))


def plan_from(loading, best):
    """The plan of a packing."""
    arrays = best.genes.turn, best.bin, best.corner
    return plan_of(loading, best.genes.order, *arrays, cheapest_types(loading, *arrays))


def test_a_two_dimensional_job_has_no_widths():
    deep = replace(flat(cartons(1)[0]), size=(100.0, 2.0, 100.0))
    Job((flat(cartons(1)[0]),), (flat(PALLET),), 2)
    for items, bin in (((deep,), flat(PALLET)), ((flat(cartons(1)[0]),), PALLET)):
        with pytest.raises(UserError, match="width"):
            Job(items, (bin,), 2)


def test_a_plan_is_valid_and_complete_and_comes_in_time(uncompiled):
    job = Job(cartons(1), (PALLET,))
    begun = time.perf_counter()
    plans = list(improve(job, SolveOptions(1.0)))
    for progress in plans:
        check_plan(job, progress.plan)
        assert progress.bounds.bins <= progress.bins == len(progress.plan.bins)
    assert time.perf_counter() - begun < 30, "a second, and what a busy machine adds"
    assert sum(len(packed.placements) for packed in plans[-1].plan.bins) == job.count
    assert [p.bins for p in plans] == sorted((p.bins for p in plans), reverse=True)
    assert [p.end for p in plans[:-1]] == [None] * (len(plans) - 1)
    assert plans[-1].end in (End.TIME, End.BOUND)


CASES = {
    # items, their orientations, the bin, the bins that are right
    "cubes": ([(1, 1, 1)] * 1000, ("XYZ",), (10, 10, 10), 1),
    "cartons": ([(32, 24, 13)] * 3150, WAYS, (589, 233, 240), 1),
    "20,000 cubes": ([(100, 100, 100)] * 20_000, ("XYZ",), (1200, 800, 1600), 14),
    "labels": ([(40, 1, 20)] * 600, ("XYZ",), (1000, 1, 700), 1),
    "three in a row": ([(40, 30, 30)] * 3, WAYS, (90, 40, 30), 1),
    "a floor beside": ([(600, 200, 300), (200, 400, 300)], ("XYZ", "YXZ"), (600, 400, 600), 1),
    "a decimal more": (
        [(1200, 800, 1500)] * 34 + [(300.1, 200, 100)], WAYS, (13600, 2450, 2600), 1
    ),
    "exactly its size": ([(57.457, 1, 1)], WAYS, (100.123, 57.457, 3), 1),
    "a thousandth": ([(20, 10, 10)] * 3 + [(30.001, 5, 2)], WAYS, (60, 10, 12), 1),
    "noise": ([(0.1 + 0.2, 1, 1)], ("XYZ",), (0.3, 1, 1), 1),
}  # fmt: skip


def job_of(sizes, ways, room, **bin):
    """Equal sizes that follow each other are copies."""
    items = []
    for size in sizes:
        if items and items[-1].size == size:
            items[-1] = replace(items[-1], copies=items[-1].copies + 1)
        else:
            items.append(ItemType(size, orientations=ways))
    flat = room[1] == 1 and all(size[1] == 1 for size in sizes) and room[0] == 1000
    return Job(tuple(items), (BinType(room, **bin),), 2 if flat else 3)


@pytest.mark.parametrize("name", CASES)
def test_a_bin_holds_what_fits_into_it(name, uncompiled):
    *case, right = CASES[name]
    job = job_of(*case)
    found = searched(job, seconds=20.0)
    assert (found.bins, found.end, found.plan.left_out) == (right, End.BOUND, ())
    check_plan(job, found.plan)


def test_half_a_base_does_not_carry_unless_that_is_asked_for(uncompiled):
    items = (ItemType((2, 4, 3)), ItemType((4, 4, 3)))
    job = Job(items, (BinType((4, 4, 6)),))
    for inclusive in (False, True):
        rules = Rules(0.5, inclusive, stability="share")
        check_plan(job, searched(job, rules=rules).plan, rules)
    upside = Job(items, (BinType((4, 4, 6), copies=1),))
    loading = load_job(upside, Rules(0.5, True, stability="share"))
    tower = Genes(np.arange(2), np.zeros(2, np.int32), np.arange(1))
    assert (pack_quickly(loading, tower)[0] == 0).all()
    assert pack_quickly(load_job(upside, Rules(0.5, False)), tower)[0].tolist() == [0, -1]


@pytest.mark.parametrize(
    ("dimension", "rules", "copies", "resolution"),
    [
        (2, Rules(), None, None),
        pytest.param(3, Rules(1.0), None, None, marks=pytest.mark.long),
        (3, Rules(0.7), 1, None),
        pytest.param(3, Rules(0.0), None, 70.0, marks=pytest.mark.long),
        (2, Rules(stability="centre"), None, None),
        (3, Rules(stability="centre"), None, None),
        (3, Rules(0.0, stability="static"), None, 70.0),
    ],
)
def test_plans_made_without_compiling_are_those_of_the_kernel(dimension, rules, copies, resolution):
    items, pallet = cartons(3, kinds=9), replace(PALLET, max_weight=20.0, copies=copies)
    other = replace(pallet, size=(450.0, 600.0, 500.0), copies=2, cost=2.0)
    if dimension == 2:
        items, pallet, other = tuple(map(flat, items)), flat(pallet), flat(other)
    job = Job(items, (other, pallet), dimension)
    loading = load_job(job, rules, resolution)
    packer, stock = packer_of(loading)
    kernel = packer(first_genes(loading, stock, 0, 32))
    orders = set()
    for lane in range(0, 32, 3):
        own = lane_genes(loading, 0, lane)
        bin, corner = pack_quickly(loading, own, blocks=False)
        expected, corners = (leaf[lane][: job.count] for leaf in kernel[:2])
        np.testing.assert_array_equal(bin, expected)
        np.testing.assert_array_equal(corner[bin >= 0], corners[bin >= 0])
        np.testing.assert_allclose(cost_of(loading, own, bin, corner), kernel[2][lane], rtol=1e-9)
        assert (bin >= 0).all() == (copies is None), "nothing was left out, or all packed"
        orders.add((tuple(own.order.tolist()), tuple(own.turn.tolist())))
        # Many at once are as valid.
        best = quick_plan(loading, own)
        check_plan(job, plan_from(loading, best), rules)
    assert len(orders) == 11


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7])
def test_what_is_left_when_the_time_is_up_stands_in_columns(share):
    items = cartons(6, kinds=40)
    job = Job((*items, ItemType((10, 20, 30), 500, 0.1)), (replace(PALLET, max_weight=90.0),))
    for resolution in (None, 7.0):
        loading = load_job(job, Rules(1.0), resolution)
        asked, stops = 0, int(share * 150)

        def stop():
            nonlocal asked
            asked += 1
            return asked > stops  # noqa: B023

        best = quick_plan(loading, lane_genes(loading, 0, 0), stop)
        assert (best.bin >= 0).all()
        check_plan(job, plan_from(loading, best), Rules(1.0))
    few = Job(job.items, (replace(PALLET, copies=1),))
    loading = load_job(few)
    best = quick_plan(loading, lane_genes(loading, 0, 0), lambda: True)
    assert (best.bin < 0).any()
    check_plan(few, plan_from(loading, best))


def test_runs_are_a_way_to_write_an_order():
    loading = load_job(Job(cartons(7, kinds=9, ways=WAYS), (PALLET,)))
    for lane in range(24):
        genes = lane_genes(loading, 3, lane)
        runs = runs_of(loading, genes)
        again = genes_of(loading, runs, genes.pool)
        assert runs_of(loading, again) == runs
        assert sorted(again.order.tolist()) == list(range(len(genes.order)))
        for one, other in ((genes, again),):
            kinds = [loading.items[g.order].tolist() for g in (one, other)]
            assert kinds[0] == kinds[1]


def test_the_search_in_numpy_gets_better_than_the_sorts():
    job = Job(cartons(11, kinds=14, ways=WAYS), (replace(PALLET, size=(500.0, 500.0, 500.0)),))
    loading = load_job(job)
    first = quick_plan(loading, lane_genes(loading, 0, 0))
    found = [*islice(search_quickly(loading, 0, first, lambda: False), 300)]
    costs = [best.cost for best in found]
    assert min(costs) < min(costs[:11])
    for best in found[::25]:
        check_plan(job, plan_from(loading, best))
    assert [*search_quickly(loading, 0, first, lambda: True)] == [None]


@pytest.mark.parametrize(
    ("size", "copies", "room", "asked"),
    [((1, 1, 1), 8, (2, 2, 2), 1), ((330, 88, 88), 17, (320, 490, 290), 2)],
)
def test_bounds_that_take_time_are_worked_out_where_the_first_plans_need_them(
    size, copies, room, asked, monkeypatch
):
    """Eight cubes fill a bin; that 17 rods need two is not to be seen from their volume."""
    calls = []
    monkeypatch.setattr(portfolio, "bounds", lambda *given: calls.append(given) or bounds(*given))
    job = Job((ItemType(size, copies, orientations=WAYS),), (BinType(room),))
    found = solve_job(job, SolveOptions(20.0))
    assert found.end == End.BOUND
    assert found.bins == found.bounds.bins == asked == len(calls)


@pytest.mark.slow
def test_the_policy_turns_items_only_as_they_fit():
    """What has fewer orientations than others is drawn in none that it does not have."""
    rooms = BinType((230.0, 300.0, 240.0), 1.0), BinType((364.0, 374.0, 40.0), 1.0)
    sizes = ((338, 366, 10), 3), ((210, 297, 8), 20), ((148, 210, 5), 20), ((232, 232, 22), 2)
    items = tuple(
        ItemType(tuple(map(float, size)), copies, orientations=WAYS) for size, copies in sizes
    )
    loading = load_job(Job(items, rooms))
    _, stock = packer_of(loading)
    sorts = first_genes(loading, stock, 0, 64)
    for seed in range(4):
        genes = policy_genes(loading, stock, sorts, load_policy("bin-aware-3d-turned"), seed)
        assert (genes.turn < np.maximum(stock.ways, 1)).all()


@pytest.mark.slow
@pytest.mark.parametrize(("dimension", "ways"), [(2, ("XYZ",)), (3, ("XYZ", "YXZ"))])
def test_the_policy_and_the_search_together_lose_to_neither(dimension, ways):
    items, pallet = cartons(8, kinds=8, ways=ways), PALLET
    if dimension == 2:
        items, pallet = [flat(item) for item in items], flat(PALLET)
    job = Job(tuple(items), (pallet,), dimension)
    loading = load_job(job)
    packer, stock = packer_of(loading)
    policy = load_policy(f"bin-aware-{dimension}d-turned")
    sorts = first_genes(loading, stock, 0, 64)
    genes = policy_genes(loading, stock, sorts, policy, 0)
    lanes, N = genes.order.shape
    np.testing.assert_array_equal(np.sort(genes.order, 1), np.tile(np.arange(N), (lanes, 1)))
    assert (genes.order[:, : job.count] < job.count).all(), "padding before items"
    assert len(np.unique(genes.order, axis=0)) > lanes // 4
    turned = genes.turn[:, : job.count]
    assert (turned < stock.ways[: job.count]).all()
    assert len(np.unique(turned)) == len(ways)

    one, other = (
        packed(
            packer,
            np.random.default_rng(first),
            Genes(*(leaf[first : first + 32] for leaf in genes)),
        )
        for first in (0, 32)
    )
    assert (one.bin[:, : job.count] >= 0).all()
    np.testing.assert_array_equal(one.genes.order, genes.order[:32])
    both = join(one, other)
    costs = np.sort(np.concatenate([one.cost, other.cost]))
    np.testing.assert_array_equal(both.cost, costs[:32])
    assert both.best.cost == costs[0]
    guests = exchange(one, other)
    for mine, theirs, after in ((one, other, guests[0]), (other, one, guests[1])):
        kept = [*np.sort(mine.cost)[:24], *np.sort(theirs.cost)[:8]]
        np.testing.assert_array_equal(np.sort(after.cost), np.sort(kept))
        assert after.best.cost == costs[0]
    after = advance(packer, stock, one, bred, rounds=12, heat=0.0)
    np.testing.assert_array_equal(np.sort(after.genes.order, 1), np.tile(np.arange(N), (32, 1)))
    assert (after.genes.order[:, : job.count] < job.count).all()
    assert (after.genes.turn[:, : job.count] < stock.ways[: job.count]).all()
    assert (np.sort(after.cost)[:6] <= np.sort(one.cost)[:6]).all(), "the elite stays"
    assert np.median(after.cost) < np.median(one.cost)
    # What the search ends with is what it has met at best, the policy's orders among it.
    least, found = both.best.cost, search(loading, 0, 300.0, policy=policy)
    assert any(best.cost <= least for best, _ in found)


def test_a_search_is_one_program_and_goes_on_from_what_it_is_given():
    before = first_fit._cache_size()
    # 33 in three types of bins: of a size that no other test has.
    bins = tuple(BinType((5.0, 5.0, height)) for height in (5.0, 6.0, 7.0))
    loading = load_job(Job((ItemType((2.0, 2.0, 3.0), 33),), bins))
    given = lane_genes(loading, 5, 40)
    turns = [*islice(search(loading, 0, 60.0, given), 4)]
    assert sum(tried for _, tried in turns) > 32
    costs = [float(best.cost) for best, _ in turns]
    assert costs == sorted(costs, reverse=True)
    packing = pack_quickly(loading, given, blocks=False)
    assert costs[0] <= cost_of(loading, given, *packing) + 1e-5
    assert first_fit._cache_size() == before + 1
    assert not [*islice(search(loading, 0, 60.0, wanted=lambda: False), 1, None)]


def test_there_is_a_compiled_search_where_bins_do_not_hold_too_much():
    many, room = ItemType((1, 1, 1), 600), BinType((10, 10, 10))
    assert not compiles(load_job(Job((many,), (room,))))
    assert compiles(load_job(Job((replace(many, size=(5, 1, 1)),), (room,))))
    wide = Job((many,), (BinType((30, 1, 30)),), 2)
    loading = load_job(wide)
    assert compiles(loading)
    assert most_together(loading.stock) == 600
    assert 600 <= encode(loading)[0].surface.most < 1200


def test_the_weight_limit_binds():
    light = Job(cartons(2), (PALLET,))
    total = plan_figures(light, searched(light).plan).weight
    heavy = Job(light.items, (replace(PALLET, max_weight=round(total / 3, 2)),))
    plan = searched(heavy).plan
    check_plan(heavy, plan)
    assert len(plan.bins) >= 4 or total <= 3 * round(total / 3, 2)
    assert len(plan.bins) >= 3


def test_the_cheapest_bins_are_used_and_their_copies_respected(uncompiled):
    items = (ItemType((2.0, 2.0, 2.0), copies=6),)
    bins = (
        BinType((2.0, 2.0, 2.0), cost=3.0),
        BinType((4.0, 2.0, 2.0), cost=4.0, copies=2),
        BinType((9.0, 9.0, 9.0), cost=100.0),
    )
    job = Job(items, bins)
    cheaper = [*improve(job, SolveOptions(2.0))]
    assert [one.cost for one in cheaper] == sorted((one.cost for one in cheaper), reverse=True)
    plan = cheaper[-1].plan
    check_plan(job, plan)
    # Two pairs at 4 each and two single ones at 3 each; six single ones would be 18.
    assert plan_figures(job, plan).cost == pytest.approx(14)


BOXES = {
    # what decides; items, bins, how many of each are right
    "the fewest bins without costs": ((2, 2, 2), 8, [((2, 2, 2), None), ((4, 4, 4), None)], [0, 1]),
    "then the least volume": ((2, 2, 2), 8, [((9, 9, 9), None), ((4, 4, 4), None)], [0, 1]),
    "in any order of rows": ((2, 2, 2), 8, [((4, 4, 4), None), ((9, 9, 9), None)], [1, 0]),
    "equal costs": ((2, 2, 2), 8, [((9, 9, 9), 5.0), ((4, 4, 4), 5.0)], [0, 1]),
    "as cheap in sum": ((2, 2, 2), 8, [((2, 2, 2), 1.0), ((4, 4, 4), 8.0)], [0, 1]),
    "the other way round": ((2, 2, 2), 8, [((4, 4, 4), 8.0), ((2, 2, 2), 1.0)], [1, 0]),
    "cheaper in sum": ((2, 2, 2), 8, [((2, 2, 2), 1.0), ((4, 4, 4), 9.0)], [8, 0]),
}


@pytest.mark.parametrize("name", BOXES)
def test_what_is_minimised(name, uncompiled):
    size, copies, bins, right = BOXES[name]
    job = Job((ItemType(size, copies),), tuple(BinType(room, cost) for room, cost in bins))
    found = searched(job)
    types = [packed.bin for packed in found.plan.bins]
    assert [types.count(kind) for kind in range(2)] == right
    assert found.end == End.BOUND


@pytest.mark.parametrize("ruled", [False, True])
def test_the_first_plan_is_in_few_bins_wherever_they_stand_in_the_file(ruled, uncompiled):
    """Of a large order it may be the only one that there is time for."""
    sides = np.random.default_rng(0).integers(2, 7, (60, 3)).astype(float)
    limits = ItemLimits(weight_above=5.0) if ruled else ItemLimits()
    items = tuple(ItemType(tuple(size), weight=1.0, limits=limits) for size in sides.tolist())
    kinds = BinType((8, 8, 8)), BinType((40, 20, 20))
    counts = [
        len(searched(Job(items, bins), packings=1).plan.bins) for bins in (kinds, kinds[::-1])
    ]
    assert counts[0] == counts[1] <= 2


def test_to_leave_something_out_is_worse_than_any_cost(uncompiled):
    items = (ItemType((100, 1, 0.1)), ItemType((10, 1, 10), 100))
    bins = (BinType((100, 1, 10), copies=1), BinType((10, 1, 10)))
    for costs in ((None, None), (1.0, 1.0), (1.0, 1000.0)):
        priced = tuple(replace(kind, cost=cost) for kind, cost in zip(bins, costs, strict=True))
        found = searched(Job(items, priced, 2))
        assert found.plan.left_out == ()
        assert found.bins >= 92


def test_a_bin_is_exchanged_for_the_cheapest_that_holds_the_same():
    item = ItemType((2.0, 2.0, 2.0), weight=5.0, copies=2)
    large, light, small = (
        BinType((9.0, 9.0, 9.0), cost=9.0),
        BinType((2.0, 2.0, 2.0), cost=1.0, max_weight=4.0),
        BinType((3.0, 2.0, 2.0), cost=2.0, copies=1),
    )
    loading = load_job(Job((item,), (large, light, small)))
    turn, corner = np.zeros(2, np.int32), np.zeros((2, 3), np.int32)
    bins = np.flatnonzero(loading.bins == 0)[:2]
    types = cheapest_types(loading, turn, bins, corner)
    assert sorted(types) == bins.tolist()
    assert sorted(types.values()) == [0, 2]
    order = Genes(np.arange(2), turn, np.arange(len(loading.bins)))
    check_plan(loading.job, plan_of(loading, order.order, turn, bins, corner, types))


WEIGHTS = {
    "a bin without limit beside one with": (
        [(1, 1, 1, 100 / 3)] * 40, [((5, 5, 5), math.inf), ((5, 5, 5), 1000.0)], 1
    ),
    "exactly the limit": ([(1, 1, 1, 333.3333333333333)], [((5, 5, 5), 333.3333333333333)], 1),
    "heavy beside a small limit": (
        [(1, 1, 1, 3e7)] * 3, [((5, 5, 5), math.inf), ((5, 5, 5), 0.01)], 1
    ),
    "nine digits": ([(1, 1, 1, 0.123456789)] * 9, [((9, 1, 1), 9 * 0.123456789)], 1),
    "a billionth over": ([(1, 1, 1, 0.123456789)] * 9, [((9, 1, 1), 9 * 0.123456789 - 1e-9)], 2),
}  # fmt: skip


@pytest.mark.parametrize("compiling", [False, True], ids=["NumPy", "compiled"])
@pytest.mark.parametrize("name", WEIGHTS)
def test_weights_are_as_exact_as_lengths(name, compiling):
    rows, bins, right = WEIGHTS[name]
    items = tuple(ItemType(row[:3], weight=row[3]) for row in rows)
    job = Job(items, tuple(BinType(size, max_weight=limit) for size, limit in bins))
    loading = load_job(job)
    if compiling:
        best, _ = next(search(loading, 0, 60.0))
        bins = np.asarray(best.bin)[: job.count]
    else:
        bins = quick_plan(loading, lane_genes(loading, 0, 0)).bin
    assert (bins >= 0).all()
    assert len(set(bins.tolist())) == right


def test_what_no_bin_can_hold_is_named_and_left_out_on_demand():
    items = (*cartons(3), ItemType((900.0, 10.0, 10.0), copies=2, name="the long one"))
    job = Job(items, (PALLET,))
    with pytest.raises(
        UserError, match=r"item 5 \(the long one\): no bin can hold 900 x 10 x 10 in"
    ):
        searched(job)
    plan = searched(job, skip_unfit=True).plan
    assert plan.left_out == (5, 5)
    check_plan(job, plan)
    upright = Job((replace(items[-1], orientations=WAYS, size=(10.0, 10.0, 690.0)),), (PALLET,))
    check_plan(upright, searched(upright).plan)


def test_an_overweight_item_is_refused():
    job = Job(cartons(4), (replace(PALLET, max_weight=0.5),))
    with pytest.raises(
        UserError, match=r"item 0 and 4 more: weight 8 is over the limit .*--skip-unfit"
    ):
        searched(job)


def test_a_search_that_is_told_to_stop_stops_with_its_best_plan(uncompiled):
    job = Job(cartons(5, kinds=12), (PALLET,))
    begun = time.perf_counter()
    *_, last = improve(job, SolveOptions(time_limit=600.0), stop=lambda: True)
    assert last.end in (End.INTERRUPT, End.BOUND)
    assert time.perf_counter() - begun < 300
    check_plan(job, last.plan)


def test_corners_stand_on_the_grid_of_a_resolution(uncompiled):
    sizes = [(14.0, 14.0, 14.0)] * 8
    assert searched(job_of(sizes, WAYS, (28.0, 28.0, 29.0))).bins == 1
    coarse = searched(job_of(sizes, WAYS, (28.0, 28.0, 29.0)), resolution=10.0)
    assert coarse.bins == 4, "two on each other"
    exact = searched(job_of([(0.6, 0.6, 0.6)] * 25, WAYS, (3.0, 3.0, 0.6)), resolution=0.6 / 3)
    assert (exact.bins, exact.end) == (1, End.BOUND)
    room = (28.0, 28.0, 29.0)
    whole = searched(job_of([room], ("XYZ",), room), resolution=10.0)
    assert whole.bins == 1, "what fits is not refused"
    job = Job(cartons(9, kinds=9), (PALLET,))
    plan = searched(job, resolution=70.0, rules=Rules(0.8)).plan
    check_plan(job, plan, Rules(0.8))
    corners = [put.corner for packed in plan.bins for put in packed.placements]
    assert not any(x % 70 or y % 70 for x, y, _ in corners)
    assert units_of(job, 70.0).step * units_of(job, 70.0).length == 70


def test_padding_is_never_packed():
    loading = load_job(Job(cartons(2), (PALLET,)))
    rules, stock = encode(loading)
    genes = padded_genes(lane_genes(loading, 0, 0), len(stock.mask), len(stock.price))
    bin, _ = pack_lanes(rules, stock, Genes(*(row[None] for row in genes)))
    count = len(loading.items)
    assert (bin[0, :count] >= 0).all()
    assert (bin[0, count:] < 0).all()
