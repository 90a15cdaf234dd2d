"""The independent check of a plan: it accepts what the rules allow and names what they do not."""

import cProfile
import math
import tracemalloc
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from large_plans import backwards, column, cubes, fine, heap
from plain_check import plain_check

from jaxpack.errors import UserError
from jaxpack.model.box_check import Rule
from jaxpack.model.exact import exact
from jaxpack.model.figures import PlanFigures, fill, plan_figures, total_cost
from jaxpack.model.job import (
    FLAT_TURNED,
    ORIENTATIONS,
    BinType,
    ItemType,
    Job,
    PackedBin,
    Placement,
    Plan,
)
from jaxpack.model.pairs import best, pairs, tree_of
from jaxpack.model.plan_check import InvalidPlanError, check_plan, plan_violations
from jaxpack.model.rules import Rules
from jaxpack.model.violations import sentence

# A plan by hand in steps of 0.1, a side view along x with z upwards:
#
#   bin 0   z=0.3-0.4  0 0 0 . . .      item 0: 0.3 x 0.3 x 0.1, three of them
#           z=0.1-0.3  1 1 1 1 1 1      item 1: 0.6 x 0.3 x 0.2, may be turned flat
#           z=0.0-0.1  0 0 0 0 0 0      item 2: 0.2 x 0.2 x 0.5, alone in bin 1
SHARE = Rules(stability="share")  # the share of a base is all that carries

JOB = Job(
    items=(
        ItemType((0.3, 0.3, 0.1), copies=3, weight=0.1),
        ItemType((0.6, 0.3, 0.2), weight=5, orientations=("XYZ", "YXZ")),
        ItemType((0.2, 0.2, 0.5)),
    ),
    bins=(
        BinType((1.0, 0.6, 0.5), copies=1, max_weight=5.3, cost=7),
        BinType((0.5, 0.5, 0.5)),
    ),
)
FIRST = (
    Placement(0, "XYZ", (0, 0, 0)),
    Placement(0, "XYZ", (0.3, 0, 0)),
    Placement(1, "XYZ", (0, 0, 0.1)),
    Placement(0, "XYZ", (0, 0, 0.3)),
)
SECOND = (Placement(2, "XYZ", (0.3, 0.3, 0)),)
PLAN = Plan((PackedBin(0, FIRST), PackedBin(1, SECOND)))


def found(plan=PLAN, job=JOB, **rules):
    """What is found, in words."""
    return [
        sentence(violation)
        for violation in plan_violations(job, plan, Rules(**rules, stability="share"))
    ]


def moved(turn, *corner, orientation="XYZ"):
    """The plan with another place for one item of bin 0."""
    first = list(FIRST)
    first[turn] = Placement(first[turn].item, orientation, corner)
    return with_first(*first)


def with_first(*placements, kind=0):
    return Plan((PackedBin(kind, tuple(placements)), PLAN.bins[1]))


def test_the_plan_by_hand_is_valid():
    assert found() == []
    assert found(support=1.0) == []
    check_plan(JOB, PLAN, SHARE)
    check_plan(JOB, moved(3, 0.3, 0.0, 0.3), SHARE)
    turned = moved(2, 0, 0, 0.1, orientation="YXZ").bins[0].placements[:3]
    check_plan(
        JOB, replace(with_first(*turned), left_out=(0,)), Rules(inclusive=True, stability="share")
    )


def named(plan, turn, rule):
    """The message about one item of bin 0."""
    return f"bin 0 item {plan.bins[0].placements[turn].item} (loaded as number {turn}): {rule}"


OVERLAPS = "overlaps the item loaded as number {} by {} along {}"
OVER = "the item loaded as number {} is over it: not reachable from above"
HALF = "50 % of its footprint is supported, not more than 50 %"
FLOATS = "floats: its bottom is at {}, but what it can rest on at {}"


@pytest.mark.parametrize(
    ("change", "plan", "expected"),
    [
        (
            "a block a step sideways, into the next",
            moved(0, 0.1, 0, 0),
            [(1, OVERLAPS.format(0, 0.1, "x"))],
        ),
        ("the block on top lifted", moved(3, 0, 0, 0.4), [(3, FLOATS.format(0.4, 0.3))]),
        (
            "the block on top beside the others, in the air",
            moved(3, 0.7, 0, 0.3),
            [(3, FLOATS.format(0.3, 0))],
        ),
        (
            "the block on top sunk",
            moved(3, 0, 0, 0.2),
            [(3, OVERLAPS.format(2, 0.1, "z"))],
        ),
        (
            "the plank and the block on it loaded in the other order",
            with_first(FIRST[0], FIRST[1], FIRST[3], FIRST[2]),
            [(3, OVER.format(2)), (2, FLOATS.format(0.3, 0.1))],
        ),
        (
            "a block loaded after the plank that is over it",
            with_first(FIRST[0], FIRST[2], FIRST[1], FIRST[3]),
            [(2, OVER.format(1)), (1, HALF)],
        ),
        (
            "out at the end",
            moved(3, 0.8, 0, 0),
            [(3, "outside the bin: along x it reaches to 1.1, the bin to 1")],
        ),
        (
            "out at the front",
            moved(3, 0.7, -0.1, 0),
            [(3, "outside the bin: along y it begins at -0.1, the bin at 0")],
        ),
        (
            "an orientation that is not allowed",
            moved(3, 0.7, 0, 0, orientation="ZYX"),
            [(3, "orientation ZYX is not allowed")],
        ),
    ],
)
def test_a_changed_place_is_reported(change, plan, expected):
    messages = [named(plan, turn, rule) for turn, rule in expected]
    assert found(plan) == messages, change
    with pytest.raises(InvalidPlanError) as error:
        check_plan(JOB, plan, SHARE)
    assert str(error.value) == "; ".join(messages)


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        (with_first(*FIRST[:3]), "item 0: 3 to pack, but 2 packed (bins 0) and 0 left out"),
        (
            replace(PLAN, left_out=(2,)),
            "item 2: 1 to pack, but 1 packed (bins 1) and 1 left out",
        ),
        (
            Plan((*PLAN.bins, PLAN.bins[1])),
            "item 2: 1 to pack, but 2 packed (bins 1, 2) and 0 left out",
        ),
        (
            Plan((PLAN.bins[0], PackedBin(0, SECOND))),
            "bin 1: there are only 1 of bin type 0",
        ),
        (Plan((*PLAN.bins, PackedBin(1, ()))), "bin 2: it holds no item"),
        (with_first(*FIRST, kind=2), "bin 0: there is no bin type 2"),
        (
            with_first(*FIRST, Placement(-1, "XYZ", (0.7, 0, 0))),
            "bin 0 (loaded as number 4): there is no item -1",
        ),
        (replace(PLAN, left_out=(3,)), "there is no item 3, which is left out"),
        (
            moved(3, 0.7, 0, 0, orientation="ABC"),
            "bin 0 item 0 (loaded as number 3): there is no orientation 'ABC'",
        ),
        (
            moved(3, 0, math.nan, 0.3),
            "bin 0 item 0 (loaded as number 3): there is no position (0, nan, 0.3)",
        ),
    ],
)
def test_a_changed_list_is_reported(plan, message):
    assert found(plan) == [message]


def test_weight():
    """Three times 0.1 and 5 are 5.3: the limit itself is allowed, whatever floats add up to."""
    over = replace(JOB, items=(replace(JOB.items[0], weight=0.11), *JOB.items[1:]))
    assert found(job=over) == ["bin 0: its items weigh 5.33, more than 5.3; the heaviest is item 1"]
    free = replace(over, bins=(replace(JOB.bins[0], max_weight=math.inf), JOB.bins[1]))
    assert found(job=free) == []


@pytest.mark.parametrize(
    ("x", "rules", "message"),
    [
        (0, {}, "50 % of its footprint is supported, not more than 50 %"),
        (0, {"inclusive": True}, None),
        (0, {"support": 0.4999}, None),
        (0.001, {}, "49.8333333 % of its footprint is supported, not more than 50 %"),
        (
            0.001,
            {"inclusive": True},
            "49.8333333 % of its footprint is supported, not at least 50 %",
        ),
        (0.001, {"support": 0.4}, None),
        (0, {"support": 1.0}, "50 % of its footprint is supported, not at least 100 %"),
        (0.299, {"support": 0}, None),
        (0.299, {"support": 0, "inclusive": True}, None),
        (0.3, {"support": 0}, "floats: its bottom is at 0.1, but what it can rest on at 0"),
    ],
)
def test_support(x, rules, message):
    """The plank over one block, at first just half of it."""
    job = replace(JOB, items=(replace(JOB.items[0], copies=1), JOB.items[1]))
    plan = Plan((PackedBin(0, (FIRST[0], Placement(1, "XYZ", (x, 0, 0.1)))),))
    expected = [] if message is None else [f"bin 0 item 1 (loaded as number 1): {message}"]
    assert found(plan, job, **rules) == expected


def test_only_what_ends_at_its_bottom_supports():
    """Two blocks of different heights under a plank: the lower one carries nothing."""
    job = Job(
        (ItemType((2, 1, 2)), ItemType((2, 1, 1)), ItemType((4, 1, 1))), (BinType((4, 1, 4)),)
    )
    places = [(0, (0, 0, 0)), (1, (2, 0, 0)), (2, (0, 0, 2))]
    plan = Plan((PackedBin(0, tuple(Placement(item, "XYZ", at) for item, at in places)),))
    assert found(plan, job, inclusive=True) == []
    assert found(plan, job) == [
        "bin 0 item 2 (loaded as number 2): 50 % of its footprint is supported, not more than 50 %"
    ]


@pytest.mark.parametrize("inclusive", [True, False])
@pytest.mark.parametrize(("held", "length"), [(1, 5), (3, 10), (1, 8), (7, 1000), (6667, 10_000)])
def test_exactly_the_share_that_is_asked_for(held, length, inclusive):
    """0.3 is three tenths, though no float is; a digit more or less is another share."""
    job = Job((ItemType((held, 1, 1)), ItemType((length, 1, 1))), (BinType((10_000, 9, 9)),))
    plan = Plan((PackedBin(0, (Placement(0, "XYZ", (0, 0, 0)), Placement(1, "XYZ", (0, 0, 1)))),))
    share = held / length
    assert bool(found(plan, job, support=share, inclusive=inclusive)) != inclusive
    assert not found(plan, job, support=share - 1e-12, inclusive=inclusive)
    assert found(plan, job, support=share + 1e-12, inclusive=inclusive)


def test_the_whole_base_is_enough_where_all_of_it_is_asked_for():
    assert found(support=1.0, inclusive=False) == []


@pytest.mark.parametrize("support", [-0.1, 1.1, math.nan, math.inf])
def test_a_support_that_is_no_share(support):
    with pytest.raises(UserError, match=r"^support.*: (give a share of the base|nan|inf)"):
        check_plan(JOB, PLAN, Rules(support))


@pytest.mark.parametrize(
    "z", [0.1 + 0.2, 0.3 + 9e-13, 0.3 - 9e-13, float(np.nextafter(0.3, 1)), np.float32(0.3).item()]
)
def test_the_noise_of_floats_is_no_length(z):
    """The bin is 1 long: what misses 0.3 by less than 1e-12 is 0.3."""
    assert bool(found(moved(3, 0, 0, z))) == (abs(z - 0.3) > 1e-12)


@pytest.mark.parametrize("scale", [1, 100, 0.001, 1e6])
def test_what_misses_by_more_than_noise_is_another_length(scale):
    def scaled(size):
        return tuple(side * scale for side in size)

    job = replace(
        JOB,
        items=tuple(replace(item, size=scaled(item.size)) for item in JOB.items),
        bins=tuple(replace(kind, size=scaled(kind.size)) for kind in JOB.bins),
    )

    def shifted(by):
        first = [replace(put, corner=scaled(put.corner)) for put in FIRST]
        x, y, z = first[3].corner
        first[3] = replace(first[3], corner=(x, y, z + by * scale))
        second = tuple(replace(put, corner=scaled(put.corner)) for put in SECOND)
        return Plan((PackedBin(0, tuple(first)), PackedBin(1, second)))

    assert found(shifted(0), job) == []
    assert found(shifted(5e-13), job) == found(shifted(-5e-13), job) == []
    assert "floats" in found(shifted(2e-12), job)[0]
    assert "overlaps" in found(shifted(-2e-12), job)[0]


def test_a_difference_of_large_numbers_is_the_length_that_is_meant():
    """The bin is 1200 long; 1200 - 1199.7 is 0.2999999999999545."""
    job = Job((ItemType((0.3, 1, 1)), ItemType((1199.7, 1, 1))), (BinType((1200, 1, 1)),))
    places = (Placement(0, "XYZ", (0, 0, 0)), Placement(1, "XYZ", (1200 - 1199.7, 0, 0)))
    assert found(Plan((PackedBin(0, places),)), job) == []
    places = (places[0], Placement(1, "XYZ", (0.29999999, 0, 0)))
    assert len(found(Plan((PackedBin(0, places),)), job)) == 1


def test_a_position_between_the_units_is_what_it_shows():
    """Cubes of 10 at thirds of it: no multiple of the unit, and they fit."""
    job = Job((ItemType((10, 10, 10), copies=2),), (BinType((20, 10, 10)),))

    def at(*xs):
        return Plan((PackedBin(0, tuple(Placement(0, "XYZ", (x, 0, 0)) for x in xs)),))

    assert found(at(0, 10), job) == []
    assert found(at(10 / 3, 10), job) != []
    wide = replace(job, bins=(BinType((40, 10, 10)),))
    assert found(at(10 / 3, 10 + 10 / 3), wide) == []
    assert found(at(10 / 3, 13.33333333), wide) == [
        "bin 0 item 0 (loaded as number 1): overlaps the item loaded as number 0 by "
        "3.33e-09 along x"
    ]


@pytest.mark.parametrize("scale", [1, 0.001, 1e5 + 0.123, 5e5 + 0.001])
def test_units_change_nothing(scale):
    """Also where areas are beyond 64 bits: valid stays valid, and a touch is no overlap."""
    items = tuple(ItemType((side * scale, scale, scale)) for side in (1, 1, 2))
    speck = ItemType((0.001, 0.001, 0.001), copies=0)  # makes a fine unit of it
    job = Job((*items, speck), (BinType((2 * scale, scale, 2 * scale)),))
    corners = [(0, 0, 0), (scale, 0, 0), (0, 0, scale)]
    places = tuple(Placement(item, "XYZ", corner) for item, corner in enumerate(corners))
    assert found(Plan((PackedBin(0, places),)), job, support=1.0) == []
    assert len(found(Plan((PackedBin(0, places[::-1]),)), job)) == 3


def test_against_a_height_map():
    """Random plans on whole numbers, every second one valid: both judge them alike."""
    random, verdicts = np.random.default_rng(0), []
    for _ in range(400):
        sizes = random.integers(1, 4, (6, 3))
        map_, places, valid = np.zeros((5, 5), int), [], True
        for item, (x_side, y_side, z_side) in enumerate(sizes.tolist()):
            x, y = random.integers(0, 6 - x_side), random.integers(0, 6 - y_side)
            under = map_[x : x + x_side, y : y + y_side]
            z = max(under.max() + (random.random() < 0.05) - (random.random() < 0.05), 0)
            fits, rests = z + z_side <= 9, z == under.max()
            valid &= bool(fits and rests and (under == z).mean() >= 0.3)
            places.append(Placement(item, "XYZ", (int(x), int(y), int(z))))
            under[:] = np.maximum(under, z + z_side)
        job = Job(tuple(ItemType(tuple(size)) for size in sizes.tolist()), (BinType((5, 5, 9)),))
        plan = Plan((PackedBin(0, tuple(places)),))
        assert (not found(plan, job, support=0.3, inclusive=True)) == valid, (sizes, places)
        verdicts.append(valid)
    assert 0.2 < np.mean(verdicts) < 0.8


def as_plain(violation):
    """A record in the form of the plain check."""
    rule, bin, item, turn, other, what, found, allowed, amount = violation
    if rule is Rule.UNKNOWN:
        return tuple(value for value in (rule, bin, turn) if value is not None)
    if rule is Rule.WEIGHT:
        return rule, bin, found, allowed
    rest = {
        Rule.COPIES: (found, allowed),
        Rule.COUNT: (amount,),
        Rule.OUTSIDE: (what,),
        Rule.OVERLAP: (other,),
        Rule.BLOCKED: (other,),
        Rule.FLOATING: (allowed,),
        Rule.SUPPORT: (found,),
    }
    return rule, bin, item, turn, *rest.get(rule, ())


def random_plan(random, flat, step, faults):
    """(job, plan): small whole sides times `step`, each item dropped at a random place.

    Args:
        random: a generator.
        flat: two-dimensional.
        step: the job's lengths are multiples of it.
        faults: how likely one item is shifted, turned, lifted, left out or put twice.
    """
    room = np.array([5, 1 if flat else 4, 7])
    axes = (0, 2) if flat else (0, 1, 2)
    scale = np.where(np.isin(range(3), axes), step, 1.0)
    sizes = random.integers(1, [4, 2 if flat else 4, 4], (int(random.integers(1, 12)), 3))
    ways = FLAT_TURNED if flat else tuple(ORIENTATIONS)
    items = tuple(
        ItemType(
            tuple((size * scale).tolist()),
            copies=int(random.integers(1, 3)),
            weight=float(random.integers(0, 4)) / 10,
            orientations=tuple(random.choice(ways, random.integers(1, len(ways)), replace=False)),
        )
        for size in sizes
    )
    sides = tuple((room * scale).tolist())
    limit = math.inf if random.random() < 0.5 else 0.6
    grain = float(f"{step / 1000:.3g}")
    speck = ItemType((grain, 1 if flat else grain, grain), copies=0)  # makes the unit a fine one
    job = Job(
        (*items, speck),
        (BinType(sides, max_weight=limit, copies=2), BinType(sides)),
        2 + (not flat),
    )
    copies = [index for index, item in enumerate(items) for _ in range(item.copies)]
    random.shuffle(copies)
    bins, left = [], []
    while copies:
        load = [copies.pop() for _ in range(min(len(copies), int(random.integers(1, 9))))]
        tops, puts = np.zeros(room[:2], int), []
        for item in load:
            if random.random() < faults / 3:
                left.append(item)
                continue
            allowed = items[item].orientations if random.random() > faults / 3 else ways
            way = str(random.choice(allowed))
            sides = sizes[item][list(ORIENTATIONS[way])]
            if (sides[:2] > room[:2]).any():
                left.append(item)
                continue
            x, y = random.integers(0, room[:2] - sides[:2] + 1)
            under = tops[x : x + sides[0], y : y + sides[1]]
            corner = np.array([x, y, under.max()], float)
            if random.random() < faults:
                corner[random.choice(axes)] += random.choice([-1, 1, 0.5, 1e-3, 1 / 3, -1e-9, 1e12])
            under[:] = corner[2] + sides[2]
            noise = 1 + random.integers(-2, 3, 3) * 2.0**-52
            puts.append(Placement(item, way, tuple((corner * scale * noise).tolist())))
        if random.random() < faults / 2:
            random.shuffle(puts)
        if random.random() < faults / 4 and puts:
            puts.append(puts[0])
        bins.append(PackedBin(int(random.integers(0, 2)), tuple(puts)))
    return job, Plan(tuple(bins), tuple(left))


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("step", [1.0, 0.1, 100.0, 123.457, 1e5, 1e-6])
@pytest.mark.parametrize("faults", [0.02, 0.3])
def test_it_finds_what_a_plain_check_finds(flat, step, faults):
    """On all rules; between the units of a large bin numbers are beyond 64 bits."""
    random, rules, valid = np.random.default_rng(7), Counter(), 0
    for _ in range(40):
        job, plan = random_plan(random, flat, step, faults)
        share, inclusive = random.choice([0, 1 / 3, 0.5, 0.75, 1]), bool(random.integers(2))
        records = list(plan_violations(job, plan, Rules(share, inclusive, stability="share")))
        wanted = plain_check(job, plan, exact(share), inclusive)
        assert sorted(map(as_plain, records), key=repr) == wanted, (job, plan, share, inclusive)
        rules.update(record.rule for record in records)
        valid += not records
    if faults < 0.1:
        assert valid > 5
    else:
        usual = {
            Rule.COUNT,
            Rule.COPIES,
            Rule.WEIGHT,
            Rule.OUTSIDE,
            Rule.OVERLAP,
            Rule.BLOCKED,
            Rule.FLOATING,
            Rule.SUPPORT,
        }
        assert set(rules) >= usual, rules


@pytest.mark.parametrize("count", [1, 2, 63, 64, 65, 700])
def test_pairs_are_those_of_a_table(count):
    """Of any columns in any order, in blocks or not."""
    random = np.random.default_rng(count)
    asked, given = random.integers(0, 9, (2, 3, count)).astype(np.int32)
    less = (asked[:, :, None] < given[:, None]).all(0)
    tree = tree_of(given, random.permutation(count))
    blocks = list(pairs(asked, tree))
    found = np.zeros_like(less)
    for rows, others in blocks:
        assert not found[rows, others].any(), "a pair is there once"
        found[rows, others] = True
    assert (found == less).all()
    first = best(asked, tree, 1)
    for row, other in enumerate(first):
        most = given[1][less[row]].max(initial=-1)
        assert (other < 0) == (most < 0)
        assert other < 0 or (less[row, other] and given[1, other] == most)


LARGE = {  # a plan, its violations, and more comparisons of lengths than it takes for an item
    "cubes": (lambda: cubes(27), {}, 1500),
    "a column": (lambda: column(20_000), {}, 1200),
    "small bins": (lambda: cubes(2, 3000), {}, 400),
    "fine": (lambda: fine(3000), {}, 6000),
    "a heap": (lambda: heap(5000), {Rule.OVERLAP: 4999}, 2000),
    "backwards": (lambda: backwards(10_000), {Rule.BLOCKED: 9999, Rule.FLOATING: 1}, 4000),
}


@pytest.mark.parametrize("name", LARGE)
def test_large_plans_take_little_work_and_memory(name, monkeypatch):
    """`python -m benchmarks check` has what that is in time."""
    make, wanted, most = LARGE[name]
    job, plan = make()
    compared, flatnonzero = [0], np.flatnonzero

    def counted(kept):
        compared[0] += np.size(kept)
        return flatnonzero(kept)

    monkeypatch.setattr(np, "flatnonzero", counted)
    tracemalloc.start()
    try:
        with cProfile.Profile() as profile:
            found = Counter(violation.rule for violation in plan_violations(job, plan, SHARE))
        assert tracemalloc.get_traced_memory()[1] < 80e6
    finally:
        tracemalloc.stop()
    assert found == wanted
    assert compared[0] < most * job.count
    assert sum(entry.callcount for entry in profile.getstats()) < 700 * job.count


def test_two_dimensions():
    """x is the width and z the height of the file, y one layer."""
    job = Job((ItemType((4, 1, 2), orientations=("XYZ", "ZYX")),), (BinType((3, 1, 4)),), 2)
    standing = Plan((PackedBin(0, (Placement(0, "ZYX", (1, 0, 0)),)),))
    lying = Plan((PackedBin(0, (Placement(0, "XYZ", (0, 0, 0)),)),))
    assert found(standing, job) == []
    assert "outside the bin: along x it reaches to 4, the bin to 3" in found(lying, job)[0]


def test_figures():
    volume = 3 * 0.3 * 0.3 * 0.1 + 0.6 * 0.3 * 0.2
    first, second = 1.0 * 0.6 * 0.5, 0.5**3
    figures = plan_figures(JOB, PLAN)
    expected = PlanFigures(
        bins=2,
        utilisation=pytest.approx((volume + 0.2 * 0.2 * 0.5) / (first + second)),
        weight=pytest.approx(5.3),
        cost=7.125,
        left_out=0,
    )
    assert figures == expected
    assert fill(JOB, PLAN.bins[0]) == pytest.approx(volume / first)
    assert total_cost(JOB, PLAN) == 7.125
    assert plan_figures(JOB, Plan((), left_out=(0, 0, 0, 1, 2))) == PlanFigures(0, 0, 0, 0, 5)
