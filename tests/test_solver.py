"""From a job to a plan: valid, in the time given, and no worse than its parts."""

import threading
import time
from dataclasses import replace

import jax
import numpy as np
import pytest

from jaxpack.errors import UserError
from jaxpack.loading import quick
from jaxpack.loading.figures import plan_figures
from jaxpack.loading.job import ORIENTATIONS, BinType, ItemType, Job, PackedBin, Placement, Plan
from jaxpack.loading.learned import policy_genes
from jaxpack.loading.local_search import (
    AS_GIVEN,
    BREED,
    advance,
    exchange,
    fresh_lanes,
    join,
    pack_lanes,
)
from jaxpack.loading.solver import THREAD, SolveOptions, improve, solve_job, with_cheapest_bins
from jaxpack.loading.stock import first_genes, load_job
from jaxpack.loading.units import units_of
from jaxpack.loading.validate import check_plan
from jaxpack.solution import drawing_policy

WAYS = tuple(ORIENTATIONS)


@pytest.fixture(autouse=True)
def no_compilation_left():
    """What came too late for one test is not in the way of the next."""
    yield
    for thread in threading.enumerate():
        if thread.name == THREAD:
            thread.join()


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
    return replace(type, size=(type.size[0], 1.0, type.size[2]))


def after(turns):
    """Ends a search after so many turns: the first of those that breed, then one that anneals."""
    answers = iter([False] * turns)
    return lambda: next(answers, True)


def searched(job, **options):
    """The best of the first packings, however long the search takes to compile."""
    *_, last = improve(job, SolveOptions(60.0, **options), stop=after(0))
    return last


def test_a_two_dimensional_job_has_no_widths():
    Job((flat(cartons(1)[0]),), (flat(PALLET),), 2)
    for items, bin in (((cartons(1)[0],), flat(PALLET)), ((flat(cartons(1)[0]),), PALLET)):
        with pytest.raises(UserError, match="width"):
            Job(items, (bin,), 2)


def test_a_plan_is_valid_and_complete_and_comes_in_time():
    job = Job(cartons(1), (PALLET,))
    begun = time.perf_counter()
    plans = list(improve(job, SolveOptions(1.0)))
    for progress in plans:
        check_plan(job, progress.plan)
        assert progress.bound <= progress.bins == len(progress.plan.bins)
    assert time.perf_counter() - begun < 10
    assert sum(len(packed.placements) for packed in plans[-1].plan.bins) == job.count
    assert [p.bins for p in plans] == sorted((p.bins for p in plans), reverse=True)


@pytest.mark.slow
@pytest.mark.parametrize(("dimension", "ways"), [(2, ("XYZ",)), (3, ("XYZ", "YXZ"))])
def test_the_policy_and_the_search_together_lose_to_neither(dimension, ways):
    items, pallet = cartons(8, kinds=8, ways=ways), PALLET
    if dimension == 2:
        items, pallet = [flat(item) for item in items], flat(PALLET)
    job = Job(tuple(items), (pallet,), dimension)
    loading, _ = load_job(job, units_of(job), 0.5, True, False)
    policy = drawing_policy(job)
    genes = policy_genes(loading, policy, seed=0)
    lanes, N = genes.order.shape
    np.testing.assert_array_equal(np.sort(genes.order, 1), np.tile(np.arange(N), (lanes, 1)))
    assert (np.asarray(genes.order)[:, : job.count] < job.count).all(), "padding before items"
    assert len(np.unique(np.asarray(genes.order), axis=0)) > lanes // 4
    turned = np.asarray(genes.turn)[:, : job.count]
    assert (turned < np.asarray(loading.stock.ways)[: job.count]).all()
    assert len(np.unique(turned)) == len(ways)

    def packed(first):
        some = jax.tree.map(lambda leaf: leaf[first : first + 32], genes)
        start = fresh_lanes(jax.random.key(0), some)
        return advance(loading.rules, loading.stock, start, 1, 0.0, AS_GIVEN)

    one, other = packed(0), packed(32)
    assert (np.asarray(one.bin)[:, : job.count] >= 0).all()
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
    bred = advance(loading.rules, loading.stock, one, 12, 0.0, BREED)
    np.testing.assert_array_equal(np.sort(bred.genes.order, 1), np.tile(np.arange(N), (32, 1)))
    assert (np.asarray(bred.genes.order)[:, : job.count] < job.count).all()
    assert (np.asarray(bred.genes.turn)[:, : job.count] < loading.stock.ways[: job.count]).all()
    assert (np.sort(bred.cost)[:6] <= np.sort(one.cost)[:6]).all(), "the elite stays"
    assert np.median(bred.cost) < np.median(one.cost)
    # What the search ends with is what it has met at best, the policy's orders among it.
    fewest = min(len(set(row[row >= 0])) for row in np.asarray(both.bin))
    assert any(found.bins <= fewest for found in improve(job, SolveOptions(60.0), policy))


def test_a_search_is_one_program():
    before = advance._cache_size()
    job = Job((ItemType((2.0, 2.0, 3.0), 9),), (BinType((5.0, 5.0, 5.0)),))
    *_, last = improve(job, SolveOptions(60.0), stop=after(2))
    assert last.bins == 3 > last.bound
    assert last.packings > 32
    assert advance._cache_size() == before + 1


@pytest.mark.parametrize(
    ("dimension", "support", "copies"),
    [(2, 0.5, None), (3, 1.0, None), (3, 0.7, 1), (3, 0.0, None)],
)
def test_plans_made_without_compiling_are_those_of_the_kernel(
    dimension, support, copies, monkeypatch
):
    items, pallet = cartons(3, kinds=9), replace(PALLET, max_weight=20.0, copies=copies)
    other = replace(pallet, size=(450.0, 600.0, 500.0), copies=2, cost=2.0)
    if dimension == 2:
        items, pallet, other = tuple(map(flat, items)), flat(pallet), flat(other)
    job = Job(items, (other, pallet), dimension)
    loading, _ = load_job(job, units_of(job), support, True, False)
    genes = first_genes(loading, np.random.default_rng(0), 32)
    packed = jax.jit(pack_lanes, static_argnums=0)(loading.rules, loading.stock, genes)
    monkeypatch.setattr(quick, "TABLE", 50)  # the table of places in several pieces
    orders = set()
    for lane in quick.LANES:
        plan = quick.quick_plan(loading, 0, lane, lambda: False)
        bin, corner = (np.asarray(leaf[lane])[: job.count] for leaf in packed[:2])
        np.testing.assert_array_equal(plan.bin[: job.count], bin)
        np.testing.assert_array_equal(
            np.asarray(plan.corner)[: job.count][bin >= 0], corner[bin >= 0]
        )
        np.testing.assert_allclose(plan.cost, packed[2][lane], rtol=1e-6)
        assert (bin >= 0).all() == (copies is None), "nothing was left out, or all packed"
        orders.add((tuple(plan.genes.order.tolist()), tuple(plan.genes.turn.tolist())))
    assert len(orders) == len(quick.LANES)
    assert quick.quick_plan(loading, 0, 0, lambda: True) is None


def test_a_plan_is_there_when_the_time_is_up_though_nothing_is_compiled(monkeypatch):
    compiling = threading.Event()
    monkeypatch.setattr("jaxpack.loading.solver.advance", lambda *_: compiling.wait(30))
    job = Job(cartons(4), (PALLET,))
    try:
        begun = time.perf_counter()
        plan = solve_job(job, SolveOptions(time_limit=0.5)).plan
        assert time.perf_counter() - begun < 10, "it waited for the compiler"
        check_plan(job, plan)
        assert sum(len(packed.placements) for packed in plan.bins) == job.count
    finally:
        compiling.set()


def test_the_weight_limit_binds():
    light = Job(cartons(2), (PALLET,))
    total = plan_figures(light, searched(light).plan).weight
    heavy = Job(light.items, (replace(PALLET, max_weight=round(total / 3, 2)),))
    plan = searched(heavy).plan
    check_plan(heavy, plan)
    assert len(plan.bins) >= 4 or total <= 3 * round(total / 3, 2)
    assert len(plan.bins) >= 3


def test_the_cheapest_bins_are_used_and_their_copies_respected():
    items = (ItemType((2.0, 2.0, 2.0), copies=6),)
    bins = (
        BinType((2.0, 2.0, 2.0), cost=3.0),
        BinType((4.0, 2.0, 2.0), cost=4.0, copies=2),
        BinType((9.0, 9.0, 9.0), cost=100.0),
    )
    job = Job(items, bins)
    *_, last = cheaper = list(improve(job, SolveOptions(60.0), stop=after(2)))
    assert [one.cost for one in cheaper] == sorted((one.cost for one in cheaper), reverse=True)
    plan = last.plan
    check_plan(job, plan)
    # Two pairs at 4 each and two single ones at 3 each; six single ones would be 18.
    assert plan_figures(job, plan).cost == pytest.approx(14)


def test_a_bin_is_exchanged_for_the_cheapest_that_holds_the_same():
    item = ItemType((2.0, 2.0, 2.0), weight=5.0)
    large, light, small = (
        BinType((9.0, 9.0, 9.0), cost=9.0),
        BinType((2.0, 2.0, 2.0), cost=1.0, max_weight=4.0),
        BinType((3.0, 2.0, 2.0), cost=2.0, copies=1),
    )
    job = Job((replace(item, copies=2),), (large, light, small))
    inside = (Placement(0, "XYZ", (0.0, 0.0, 0.0)),)
    plan = with_cheapest_bins(job, Plan((PackedBin(0, inside), PackedBin(0, inside))))
    assert sorted(packed.bin for packed in plan.bins) == [0, 2]
    check_plan(job, plan)


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


def test_a_search_that_is_told_to_stop_stops_with_its_best_plan():
    job = Job(cartons(5, kinds=12), (PALLET,))
    begun = time.perf_counter()
    *_, last = improve(job, SolveOptions(time_limit=600.0), stop=lambda: True)
    assert last.limited_by in ("an interrupt", "the bound")
    assert time.perf_counter() - begun < 120
    check_plan(job, last.plan)


def test_decimals_are_exact_and_fine_sizes_are_rounded_up():
    tenths = Job((ItemType((0.1, 0.2, 0.3), copies=20),), (BinType((0.3, 0.6, 0.9)),))
    units = units_of(tenths)
    assert units.exact
    assert float(units.length) == 0.1
    assert len(searched(tenths).plan.bins) == 1  # 27 would fit
    fine = Job((ItemType((1 / 3, 1 / 7, 1 / 9), copies=5),), (BinType((1.0, 1.0, 1.0)),))
    assert not units_of(fine).exact
    check_plan(fine, searched(fine).plan, slack=float(units_of(fine).length))


def test_a_coarser_resolution_rounds_items_up_and_bins_down():
    job = Job((ItemType((14.0, 14.0, 14.0), copies=8),), (BinType((28.0, 28.0, 29.0)),))
    assert len(searched(job).plan.bins) == 1
    loading, _ = load_job(job, units_of(job, 10), 0.5, True, False)
    assert np.asarray(loading.stock.sizes)[0, 0].tolist() == [2, 2, 2]
    assert np.asarray(loading.stock.bins)[0].tolist() == [2, 2, 2]
    coarse = searched(job, resolution=10.0).plan
    assert len(coarse.bins) == 8
