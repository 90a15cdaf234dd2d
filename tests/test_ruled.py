"""Packing by the rules of loads: every plan obeys them, whatever is asked, and each rule tells."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from ruled_oracle import broken, groups_in

from jaxpack.model.encoding import lane_genes, load_job, plan_of
from jaxpack.model.job import BinType, ItemType, Job
from jaxpack.model.limits import BinLimits, ItemLimits, Obstacle
from jaxpack.model.plan_check import plan_violations
from jaxpack.model.rules import Rules
from jaxpack.model.shelves import fits_one_bin
from jaxpack.packing.ruled import filling
from jaxpack.packing.ruled.filling import RuledBin
from jaxpack.packing.ruled.load import Load
from jaxpack.search.portfolio import SolveOptions, solve_job
from jaxpack.search.quick import quick_plan

BARS = (Obstacle((0.0, 0.0, 0.0), (3.0, 1.0, 2.0)), Obstacle((5.0, 4.0, 3.0), (2.0, 3.0, 1.0)))
FLAT_BARS = (Obstacle((0.0, 0.0, 0.0), (3.0, 1.0, 2.0)), Obstacle((5.0, 0.0, 3.0), (2.0, 1.0, 1.0)))
LIMITS = {
    "weight_above": (0.0, 10.0, 30.0, inf, inf),
    "stackable": (True, True, True, False),
    "most_in_stack": (None, None, 1, 2, 3),
    "stack_id": (0, 1),
    "group": ("", "g", "h", "i"),
    "apart": ("", "", "", "a", "b"),
    "stop": (None, 1, 2, 3),
    "floor": (False, False, False, True),
}
ALL = Rules(0.3, False, "lowest", "static", 1.0, 1.0, "x", 0.4, True)
ASKED = {  # what is asked: of items, of bins, of all
    **{name: ((name,), False, Rules(0.4)) for name in LIMITS},
    "stops at a door": (("stop",), False, Rules(0.4, door="x")),
    "most items": ((), True, Rules()),
    "gap": ((), False, Rules(gap=1.0)),
    "half a gap": ((), False, Rules(gap=0.5)),
    "overhang": ((), False, Rules(overhang=1.0)),
    "door": ((), False, Rules(door="x")),
    "balance": ((), False, Rules(balance=0.3)),
    "balance beside bars": ((), True, Rules(balance=0.5)),
    "heavy below": ((), False, Rules(heavy_below=True)),
    "centre": (("stop",), False, Rules(0.0, stability="centre")),
    "all of items": (tuple(LIMITS), False, Rules(0.4)),
    "all": (tuple(LIMITS), True, ALL),
    "rule of positions": (("stop",), True, Rules(rule="most-contact", gap=1.0)),
}
FLAT = [name for name in ASKED if not ASKED[name][2].door]
SIZES = 4, 20


def order_of(seed, name, flat=False):
    """A small order at random, of which that is asked, and the rules."""
    limits, of_bins, rules = ASKED[name]
    random = np.random.default_rng(seed)
    ways = ("XYZ", "ZYX") if flat else ("XYZ", "YXZ", "ZXY")
    items = []
    for _ in range(int(random.integers(*SIZES))):
        x, y, z = random.integers(1, 6, 3).astype(float).tolist()
        asked = {key: LIMITS[key][random.integers(len(LIMITS[key]))] for key in limits}
        items.append(
            ItemType(
                (x, 1.0 if flat else y, z), int(random.integers(1, 4)),
                float(random.integers(1, 30)), ways, limits=ItemLimits(**asked),
            )
        )  # fmt: skip
    bars = FLAT_BARS if flat else BARS
    asked = BinLimits(int(random.integers(2, 9)), bars) if of_bins else BinLimits()
    most = float(random.choice([inf, 100.0]))
    large = BinType((10.0, 1.0 if flat else 8.0, 8.0), max_weight=most, limits=asked)
    small = BinType((7.0, 1.0 if flat else 7.0, 5.0), limits=replace(asked, obstacles=()))
    bins = (large, small) if random.random() < 0.5 else (large,)
    return Job(tuple(items), bins, 2 if flat else 3), rules


def packed(job, rules, lane=0, late=False):
    """The plan of one lane, at once or when it is late."""
    loading = load_job(job, rules, skip_unfit=True)
    best = quick_plan(loading, lane_genes(loading, 0, lane), lambda: late)
    types = {slot: int(loading.bins[slot]) for slot in best.bin[best.bin >= 0].tolist()}
    genes = best.genes
    return plan_of(loading, genes.order, genes.turn, best.bin, best.corner, types)


def obeys(job, plan, rules):
    assert not broken(job, plan, rules)
    assert not list(plan_violations(job, plan, rules))
    for group, count in groups_in(job, plan).items():
        own = [n for n, item in enumerate(job.items) if item.limits.group == group]
        if count > 1:
            assert not any(fits_one_bin(job, own, kind, rules) for kind in job.bins)


def obeyed(name, seeds, flat):
    for seed in seeds:
        job, rules = order_of(seed, name, flat)
        for lane, late in ((seed % 13, False), (0, True)):
            obeys(job, packed(job, rules, lane, late), rules)


@pytest.mark.parametrize("name", ASKED)
def test_plans_obey(name):
    obeyed(name, range(16), flat=False)


@pytest.mark.parametrize("name", FLAT)
def test_plans_of_sheets_obey(name):
    obeyed(name, range(16), flat=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", ASKED)
def test_plans_of_many_orders_obey(name):
    obeyed(name, range(16, 200), flat=False)
    if name in FLAT:
        obeyed(name, range(16, 200), flat=True)


@pytest.mark.parametrize("name", sorted(set(ASKED) - {"group", "half a gap", "rule of positions"}))
def test_each_rule_changes_a_plan(name):
    """Without it a plan is one that breaks it."""

    def breaks(seed):
        job, rules = order_of(seed, name)
        bins = tuple(replace(kind, limits=BinLimits()) for kind in job.bins)
        free = tuple(replace(item, limits=ItemLimits()) for item in job.items)
        plan = packed(replace(job, items=free, bins=bins), Rules(rules.support))
        return broken(job, plan, rules)

    if name == "overhang":
        job, rules = order_of(0, name)
        plan = packed(job, rules)
        assert min(put.corner[0] for one in plan.bins for put in one.placements) < 0
    else:
        assert any(breaks(seed) for seed in range(20))


@pytest.mark.parametrize("name", ["all of items", "heavy below", "balance", "gap"])
def test_everything_is_packed(name):
    """Where every item has a place in an empty bin, however little time there is."""
    for seed in range(20):
        job, rules = order_of(seed, name)
        for late in (False, True):
            assert not packed(job, rules, late=late).left_out


@pytest.mark.parametrize("objective", ["bins", "price", "value", "height"])
def test_searches_obey(objective):
    for seed in range(2):
        height = objective == "height"  # which has one bin: nothing can be apart
        job, rules = order_of(seed, "stop" if height else "all of items")
        bins = job.bins[:1] if height else job.bins
        job = replace(job, bins=bins, objective=objective)
        found = solve_job(job, SolveOptions(rules=rules, packings=14))
        obeys(job, found.plan, rules)
        again = solve_job(job, SolveOptions(rules=rules, packings=14))
        assert again.plan == found.plan


def test_search_gets_better():
    sums = [0, 0]
    for seed in range(6):
        job, rules = order_of(seed, "stackable")
        for n, packings in enumerate((1, 20)):
            found = solve_job(job, SolveOptions(rules=rules, packings=packings))
            sums[n] += found.bins
    assert sums[1] < sums[0]


def test_no_time_is_time_enough():
    job, rules = order_of(1, "all of items")
    found = solve_job(job, SolveOptions(time_limit=1e-6, rules=rules))
    obeys(job, found.plan, rules)
    assert not found.plan.left_out


def test_what_is_late_is_not_looked_for_among_all_places(monkeypatch):
    """In a large bin one look takes a good part of a second."""
    looks, resting = [], Load._resting
    monkeypatch.setattr(Load, "_resting", lambda *of: looks.append(of) or resting(*of))
    random = np.random.default_rng(0)
    for bins, rules in ((BinType((40.0, 30.0, 30.0)),), Rules()), (_barred(), Rules(door="x")):
        items = tuple(
            ItemType(size, limits=ItemLimits(stackable=n % 4 > 0, stop=1 + n % 3))
            for n, size in enumerate(map(tuple, random.integers(2, 9, (300, 3)).astype(float)))
        )
        looks.clear()
        plan = packed(Job(items, bins), rules, late=True)
        obeys(Job(items, bins), plan, rules)
        assert not plan.left_out
        assert not looks
        assert len(plan.bins) < 12


def test_corner_points_are_nearly_as_good_as_all_places(monkeypatch):
    """Where a bin may hold very many, looking everywhere would take minutes."""
    bins, most = {}, filling.MANY
    for many in (most, 0):
        monkeypatch.setattr(filling, "MANY", many)
        for seed, name in enumerate(("weight_above", "stackable", "stop", "gap", "door") * 3):
            job, rules = order_of(seed, name)
            plan = packed(replace(job, bins=job.bins[:1]), rules)
            obeys(job, plan, rules)
            bins[many, seed] = len(plan.bins) + len(plan.left_out)
    everywhere, points = (sum(bins[many, seed] for seed in range(15)) for many in (most, 0))
    assert everywhere <= points <= 1.15 * everywhere


def test_no_item_is_tried_at_very_many_places(monkeypatch):
    """Also if it is not late: with the square of the items in a bin a look takes ever longer."""
    looks, resting = [], Load._resting
    monkeypatch.setattr(
        Load,
        "_resting",
        lambda load, x, y, *of: looks.append(len(x) * len(y)) or resting(load, x, y, *of),
    )
    random = np.random.default_rng(0)
    items = tuple(
        ItemType(size, limits=ItemLimits(stackable=n % 4 > 0))
        for n, size in enumerate(map(tuple, random.integers(100, 600, (300, 3)).astype(float)))
    )
    job = Job(items, (BinType((6000.0, 2450.0, 2600.0), copies=2),))
    plan = packed(job, Rules())
    obeys(job, plan, Rules())
    assert not plan.left_out
    assert 2**14 < max(looks) <= 2**16


def test_what_finds_no_corner_point_is_tried_everywhere(monkeypatch):
    """In the last bin: wide items hardly begin at a corner of a narrow tower."""
    monkeypatch.setattr(filling, "MANY", 0)
    random = np.random.default_rng(0)
    sizes = random.integers(3, 25, (120, 3)).astype(float)
    limits = ItemLimits(weight_above=1e3)
    items = tuple(ItemType(tuple(size), limits=limits) for size in sizes.tolist())
    job = Job(items, (BinType((100.0, 60.0, 1e5), copies=1),), objective="height")
    plan = packed(job, Rules())
    obeys(job, plan, Rules())
    assert not plan.left_out


def test_what_fits_one_type_only_is_tried_everywhere_in_it(monkeypatch):
    """Though there are other bins enough, in which it cannot be."""
    monkeypatch.setattr(filling, "MANY", 0)
    random = np.random.default_rng(0)
    sizes = random.integers(3, 25, (120, 3)).astype(float)
    limits = ItemLimits(weight_above=1e3)
    large = tuple(ItemType(tuple(size), limits=limits) for size in sizes.tolist())
    items = (*large, ItemType((2.0, 2.0, 2.0), 60, limits=limits))
    job = Job(items, (BinType((100.0, 60.0, 120.0), copies=1), BinType((2.0, 2.0, 4.0))))
    for late in (False, True):
        plan = packed(job, Rules(), late=late)
        obeys(job, plan, Rules())
        assert not plan.left_out


def test_what_is_late_wastes_no_bins_of_which_there_are_few():
    few, many = BinType((10.0, 10.0, 10.0), copies=1), BinType((4.0, 4.0, 4.0))
    limits = ItemLimits(weight_above=100.0)
    items = ItemType((5.0, 5.0, 5.0), 8, limits=limits), ItemType((4.0, 4.0, 4.0), 9, limits=limits)
    job = Job(items, (few, many))
    assert not packed(job, Rules(), late=True).left_out


def _barred():
    bars = (Obstacle((15.0, 0.0, 0.0), (2.0, 30.0, 5.0)),)
    return (BinType((40.0, 30.0, 30.0), limits=BinLimits(obstacles=bars)),)


def test_a_group_that_is_late_is_not_tried_again_for_every_bin(monkeypatch):
    tried, take = [], RuledBin.take
    monkeypatch.setattr(
        RuledBin,
        "take",
        lambda bin, row, *more, **how: tried.append(row) or take(bin, row, *more, **how),
    )
    random = np.random.default_rng(0)
    items = tuple(
        ItemType(tuple(random.integers(2, 6, 3).astype(float).tolist()), limits=ItemLimits(group=g))
        for g in "ab" * 100
    )
    job = Job(items, (BinType((10.0, 8.0, 8.0)),))
    plan = packed(job, Rules(), late=True)
    obeys(job, plan, Rules())
    assert len(tried) < 2 * len(items)


def test_cheaper_types_obey():
    """A bin is of the cheapest type that may hold what is in it, by all rules."""
    item = ItemType((2.0, 2.0, 2.0), 3)
    dear = BinType((6.0, 2.0, 2.0), cost=5.0)
    cheap = BinType((6.0, 2.0, 2.0), cost=1.0, limits=BinLimits(most_items=2))
    found = solve_job(Job((item,), (dear, cheap)), SolveOptions(packings=60))
    assert sorted(len(one.placements) for one in found.plan.bins) == [1, 2]
    assert found.cost == 2


def test_corners_on_a_grid():
    for seed in range(12):
        job, rules = order_of(seed, "all")
        loading = load_job(job, rules, resolution=2.0, skip_unfit=True)
        for late in (False, True):
            best = quick_plan(loading, lane_genes(loading, 0, 0), lambda late=late: late)
            assert not (best.corner[:, :2] * float(loading.units.length) % 2).any()
