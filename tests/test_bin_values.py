"""Bins filled by value: what comes out is a plan, and it is a good one."""

from dataclasses import replace
from functools import partial
from itertools import islice, product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpack
from jaxpack.model.encoding import load_job, plan_of
from jaxpack.model.job import ORIENTATIONS, BinType, ItemType, Job
from jaxpack.model.plan_check import check_plan
from jaxpack.model.rules import Rules
from jaxpack.search import bin_values, filling
from jaxpack.search.beam import alone, fill
from jaxpack.search.bin_types import cheapest_types
from jaxpack.search.bin_values import has_values, search_values
from jaxpack.search.blocks import step
from jaxpack.search.fillings import best_of, cover, kinds_of, longest_sums

WAYS = tuple(ORIENTATIONS)
UPRIGHT = ("XYZ", "YXZ")


def job_of(seed, dimension=3, kinds=4, copies=6, types=1, weights=False, ways=WAYS):
    rng = np.random.default_rng(seed)
    sides = rng.integers(2, 9, (kinds, 3)).astype(float)
    rooms = rng.integers(10, 16, (types, 3)).astype(float)
    if dimension == 2:
        sides[:, 1] = rooms[:, 1] = 1
        ways = ("XYZ", "ZYX") if len(ways) > 1 else ways
    heavy = rng.integers(1, 9, kinds) if weights else np.zeros(kinds)
    items = tuple(
        ItemType(tuple(side), int(rng.integers(1, copies + 1)), float(weight), ways)
        for side, weight in zip(sides, heavy, strict=True)
    )
    bins = tuple(
        BinType(tuple(room), float(cost), None if n == 0 else 2, 30.0 if weights else np.inf)
        for n, (room, cost) in enumerate(zip(rooms, rng.integers(1, 5, types), strict=True))
    )
    return Job(items, bins, dimension)


def plan(loading, best):
    types = cheapest_types(loading, best.genes.turn, best.bin, best.corner)
    return plan_of(loading, best.genes.order, best.genes.turn, best.bin, best.corner, types)


def found(loading, passes, seed=0):
    return [best for best, _ in islice(search_values(loading, seed, lambda: False), passes) if best]


@pytest.mark.parametrize(
    ("rules", "how"),
    [
        (Rules(), {}),
        (Rules(), {"weights": True, "types": 3}),
        (Rules(0.5, True), {"copies": 1, "kinds": 12}),
        (Rules(1.0), {"types": 2, "ways": UPRIGHT}),
        (Rules(0.0), {"ways": ("XYZ",)}),
        (Rules(0.7), {"dimension": 2, "copies": 9}),
        pytest.param(Rules(0.0), {"dimension": 2, "kinds": 9}, marks=pytest.mark.long),
        pytest.param(Rules(0.0, True), {"kinds": 12, "ways": ("XYZ",)}, marks=pytest.mark.long),
        (Rules(stability="centre"), {"copies": 9}),
        pytest.param(Rules(0.0, True, stability="centre"), {"kinds": 12}, marks=pytest.mark.long),
        (Rules(0.0, True, stability="static"), {"kinds": 12, "copies": 3}),
        pytest.param(
            Rules(0.6, stability="centre"), {"dimension": 2, "kinds": 9}, marks=pytest.mark.long
        ),
    ],
)
def test_every_packing_is_a_plan_of_everything(rules, how):
    for seed in range(6):
        loading = load_job(job_of(seed, **how), rules)
        assert has_values(loading)
        packings = found(loading, 9)
        for best in packings:
            one = plan(loading, best)
            check_plan(loading.job, one, rules)
            assert not one.left_out
        costs = [best.cost for best in packings]
        assert costs == sorted(costs, reverse=True)
        assert packings, "there are bins enough"


def never():
    return False


def finished(search):
    """What a search returns whose bins are filled for it alone."""
    steps = alone(search, never)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def test_nothing_floats_though_nothing_has_to_be_carried():
    rng = np.random.default_rng(0)
    for seed in range(8):
        sides = rng.integers(1, 8, (14, 3)).astype(float)
        items = tuple(ItemType(tuple(side), int(rng.integers(1, 9))) for side in sides)
        room = tuple(rng.integers(10, 30, 3).astype(float))
        loading = load_job(Job(items, (BinType(room),)), Rules(0.0, True))
        for best in found(loading, 4, seed):
            check_plan(loading.job, plan(loading, best), Rules(0.0, True))


@pytest.mark.parametrize(("long", "short", "room"), [(6, 4, 10), (7, 5, 12), (9, 4, 13)])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("bins", [1, 10])
def test_pinwheels_are_found_at_once(long, short, room, dimension, bins):
    """Four items round a hole: ties between their orientations must not fall to one side."""
    sides, ways = ((long, 1, short), ("XYZ", "ZYX")) if dimension == 2 else ((long, short, 1), WAYS)
    size = (room, 1, room) if dimension == 2 else (room, room, 1)
    one = ItemType(tuple(map(float, sides)), 4 * bins, orientations=ways)
    loading = load_job(Job((one,), (BinType(tuple(map(float, size))),), dimension), Rules())
    for seed in range(3):
        least = min(len(np.unique(best.bin)) for best in found(loading, 12, seed))
        assert least == bins


def test_the_longest_sides_that_there_may_be_are_packed():
    items = (ItemType((4.0, 1.0, 2.0**30)), ItemType((3.0, 1.0, 5.0), 2))
    loading = load_job(Job(items, (BinType((10.0, 1.0, 2.0**30)),), 2))
    assert has_values(loading)
    (best,) = found(loading, 2)
    check_plan(loading.job, plan(loading, best))
    assert set(best.bin.tolist()) == {0}


def test_of_equal_values_the_one_in_fewer_bins_is_kept():
    job = Job(
        (ItemType((5.0, 5.0, 5.0), 8),), (BinType((10.0, 10.0, 5.0), 1.0, 3),), objective="value"
    )
    best = found(load_job(job), 3)[-1]
    assert len(set(best.bin.tolist())) == 2
    assert (best.bin >= 0).all()


def test_what_cannot_be_filled_by_value_is_no_error():
    """A weight of more digits than are kept, exactly at the limit."""
    item, room = ItemType((2.0, 2.0, 2.0), 1, 999_999_999.9), BinType((5.0, 5.0, 5.0))
    bins = tuple(replace(room, max_weight=limit) for limit in (item.weight, 0.1))
    loading = load_job(Job((item,), bins))
    tried = [*islice(search_values(loading, 0, lambda: False), 2 * bin_values.COVER)]
    assert len(tried) == 2 * bin_values.COVER
    solution = jaxpack.solve(loading.job, packings=30)
    assert len(solution.plan.bins) == 1


def test_the_same_seed_fills_the_same():
    loading = load_job(job_of(3, types=2))
    one, other = found(loading, 5, seed=7), found(loading, 5, seed=7)
    assert len(one) == len(other)
    for mine, theirs in zip(one, other, strict=True):
        np.testing.assert_array_equal(mine.bin, theirs.bin)
        np.testing.assert_array_equal(mine.corner, theirs.corner)


@pytest.mark.parametrize("stability", ["share", "centre"])
@pytest.mark.parametrize("copies", [6, 1])
def test_compiled_it_is_the_same_to_the_bit(copies, stability):
    job = job_of(1, copies=copies, kinds=5, types=2, weights=True)
    loading = load_job(job, Rules(stability=stability))
    kinds, random = kinds_of(loading), np.random.default_rng(0)
    types = np.arange(2)
    goods, _ = bin_values._drawn(kinds, kinds.size, kinds.count, types, random)

    @partial(jax.jit, static_argnums=0)
    def compiled(axes, goods):
        go_on = partial(step, jnp, axes, goods)
        empty = filling.empty(jnp, goods, kinds.blocks, kinds.firm)
        return jax.lax.while_loop(lambda now: filling.goes_on(now).any(), go_on, empty)

    ours = fill(kinds, goods, lambda: False)
    assert ours.used.min() > 0
    for mine, theirs in zip(ours, compiled(kinds.axes, goods), strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize("seed", range(5))
def test_longest_sums_are_those_of_all_combinations(seed):
    rng = np.random.default_rng(seed)
    edges, copies = rng.integers(2, 12, 3), rng.integers(1, 4, 3)
    combinations = product(*(range(most + 1) for most in copies.tolist()))
    sums = {
        sum(n * edge for n, edge in zip(ns, edges.tolist(), strict=True)) for ns in combinations
    }
    expected = [max(total for total in sums if total <= length) for length in range(31)]
    assert longest_sums(edges, copies, 30).tolist() == expected


def test_what_the_cover_has_too_much_is_taken_out_from_the_top():
    taken = 0
    for seed in range(12):
        loading = load_job(job_of(seed, copies=9))
        kinds, random = kinds_of(loading), np.random.default_rng(seed)
        pool = {}
        for _ in range(6):
            bins, _ = finished(bin_values._pass(kinds, kinds.size, np.ones(1), random, never))
            pool |= {one.held.tobytes(): one for one in bins}
        chosen = cover(kinds, [*pool.values()])
        assert (sum(one.times * one.held for one in chosen) >= kinds.count).all()
        taken += (sum(one.times * one.held for one in chosen) > kinds.count).any()
        if best := best_of(kinds, chosen):
            check_plan(loading.job, plan(loading, best))
            assert (best.bin >= 0).all()
    assert taken, "some hold more than there is"
