"""Valid plans, damaged in every way there is: each damage is found, under its own rule."""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from plain_check import plain_check

from jaxpack.model.box_check import Rule
from jaxpack.model.exact import clean, exact
from jaxpack.model.job import BinType, ItemType, Job, PackedBin, Placement, Plan
from jaxpack.model.plan_check import InvalidPlanError, check_plan, plan_violations
from jaxpack.model.rules import Rules

SHARE = Rules(stability="share")  # the share of a base is all that carries

UPRIGHT = ("XYZ", "YXZ")


def shelf_plan(seed, digits):
    """(job, plan): rows of items from the floor up, each layer on pillars of equal height.

    Args:
        seed: of the sides.
        digits: after the point of every length.
    """
    random = np.random.default_rng(seed)
    room = [clean(round(float(side), digits)) for side in random.uniform(80, 120, 3)]
    heights = [clean(round(float(random.uniform(5, 20)), digits)) for _ in range(3)]
    items, bins = [], []
    for _ in range(3):
        puts, z = [], Fraction(0)
        for height in heights:
            y = Fraction(0)
            while True:
                depth = clean(round(float(random.uniform(15, 30)), digits))
                if y + exact(depth) > exact(room[1]):
                    break
                x = Fraction(0)
                while True:
                    length = clean(round(float(random.uniform(15, 40)), digits))
                    if x + exact(length) > exact(room[0]):
                        break
                    puts.append(Placement(len(items), "XYZ", tuple(map(float, (x, y, z)))))
                    grams = round(float(random.uniform(0.1, 3)), 6)
                    items.append(ItemType((length, depth, height), 1, grams, UPRIGHT))
                    x += exact(length)
                y += exact(depth)
            z += exact(height)
        bins.append(puts)
    packed = tuple(PackedBin(n, tuple(puts)) for n, puts in enumerate(bins))
    job, plan = without_falling(
        Job(tuple(items), (BinType(tuple(room), copies=1),) * 3), Plan(packed)
    )
    kinds = tuple(
        replace(kind, max_weight=weight(job, plan.bins[n])) for n, kind in enumerate(job.bins)
    )
    return replace(job, bins=kinds), plan


def weight(job, packed):
    """Of a bin's items, to the last digit."""
    return float(sum(exact(job.items[put.item].weight) for put in packed.placements))


def without_falling(job, plan):
    """The job and plan without the items that rest on too little, from below upwards."""
    while True:
        rules = [
            v for v in plan_violations(job, plan, SHARE) if v.rule in (Rule.SUPPORT, Rule.FLOATING)
        ]
        if not rules:
            return job, plan
        fallen = {(violation.bin, violation.turn) for violation in rules}
        gone = {violation.item for violation in rules}
        items = tuple(
            replace(item, copies=0) if index in gone else item
            for index, item in enumerate(job.items)
        )
        job = replace(job, items=items)
        plan = Plan(
            tuple(
                replace(
                    packed,
                    placements=tuple(
                        put
                        for turn, put in enumerate(packed.placements)
                        if (number, turn) not in fallen
                    ),
                )
                for number, packed in enumerate(plan.bins)
            )
        )


CASES = [(0, 0), (1, 3), (2, 6)]


@pytest.fixture(scope="module", params=CASES, ids=str)
def case(request):
    """A job and a valid plan of more than two layers and bins."""
    job, plan = shelf_plan(*request.param)
    assert plain_check(job, plan, Fraction(1, 2), False) == []
    check_plan(job, plan, SHARE)
    assert len(plan.bins) == 3
    assert all(len({put.corner[2] for put in packed.placements}) == 3 for packed in plan.bins)
    return job, plan


def damaged(plan, number, turn, **change):
    """The plan with one item changed."""
    puts = list(plan.bins[number].placements)
    puts[turn] = replace(puts[turn], **change)
    return with_puts(plan, number, puts)


def with_puts(plan, number, puts):
    bins = list(plan.bins)
    bins[number] = replace(bins[number], placements=tuple(puts))
    return replace(plan, bins=tuple(bins))


def assert_found(job, plan, *wanted):
    """Each (rule, bin, turn) is reported and the plan refused."""
    records = list(plan_violations(job, plan, SHARE))
    found = {(record.rule, record.bin, record.turn) for record in records}
    assert set(wanted) <= found, (wanted, found)
    with pytest.raises(InvalidPlanError):
        check_plan(job, plan, SHARE)


def some_items(plan):
    """Every third one."""
    for number, packed in enumerate(plan.bins):
        for turn, put in list(enumerate(packed.placements))[::3]:
            yield number, turn, put


def smallest(job):
    """What counts as a length: a unit, and little more than noise."""
    longest = max(job.bins[0].size)
    return float(job.unit), 3e-12 * longest


def test_an_item_that_is_lifted_floats(case):
    job, plan = case
    for number, turn, put in some_items(plan):
        x, y, z = put.corner
        for step in smallest(job):
            assert_found(
                job,
                damaged(plan, number, turn, corner=(x, y, z + step)),
                (Rule.FLOATING, number, turn),
            )


def test_an_item_that_is_sunk_is_inside_another_or_below_the_floor(case):
    job, plan = case
    for number, turn, put in some_items(plan):
        x, y, z = put.corner
        for step in smallest(job):
            rule = Rule.OVERLAP if z else Rule.OUTSIDE
            sunk = damaged(plan, number, turn, corner=(x, y, z - step))
            assert_found(job, sunk, (rule, number, turn))


@pytest.mark.parametrize("axis", [0, 1])
def test_an_item_that_is_pushed_back_is_inside_its_neighbour_or_the_wall(case, axis):
    """Rows are tight: what starts where another ends cannot move towards it."""
    job, plan = case
    pushed = 0
    for number, turn, put in some_items(plan):
        if put.corner[axis] == 0:
            rule = Rule.OUTSIDE
        elif axis == 0:  # the one before it in the row
            rule = Rule.OVERLAP
        else:
            continue
        for step in smallest(job):
            corner = list(put.corner)
            corner[axis] -= step
            back = damaged(plan, number, turn, corner=tuple(corner))
            left = [one for one in plan.bins[number].placements[:turn] if ends_at(job, one, put)]
            if rule is Rule.OVERLAP and not left:  # that one was taken away
                continue
            assert_found(job, back, (rule, number, turn))
            pushed += 1
    assert pushed > 10


def ends_at(job, one, put):
    """Whether one ends along x where the other begins, beside it."""
    end = exact(one.corner[0]) + exact(job.items[one.item].size[0])
    return end == exact(put.corner[0]) and one.corner[1:] == put.corner[1:]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_item_that_goes_through_a_wall_is_outside(case, axis):
    job, plan = case
    for number, turn, put in some_items(plan):
        side = job.items[put.item].size[axis]
        for step in smallest(job):
            corner = list(put.corner)
            corner[axis] = job.bins[number].size[axis] - side + step
            out = damaged(plan, number, turn, corner=tuple(corner))
            assert_found(job, out, (Rule.OUTSIDE, number, turn))


def test_items_in_one_place_overlap(case):
    job, plan = case
    for number, packed in enumerate(plan.bins):
        puts = packed.placements
        for turn in range(1, len(puts)):
            moved = damaged(plan, number, turn, corner=puts[turn - 1].corner)
            assert_found(job, moved, (Rule.OVERLAP, number, turn))


def test_an_item_that_is_loaded_too_late_is_blocked(case):
    """What carries something, loaded last, and what it carries first."""
    job, plan = case
    tried = 0
    for number, packed in enumerate(plan.bins):
        puts = list(packed.placements)
        for turn, put in enumerate(puts):
            if not any(rests_on(job, other, put) for other in puts):
                continue
            late = with_puts(plan, number, [*puts[:turn], *puts[turn + 1 :], put])
            assert_found(job, late, (Rule.BLOCKED, number, len(puts) - 1))
            tried += 1
    assert tried > 10


def test_the_whole_order_reversed_is_found(case):
    job, plan = case
    for number, packed in enumerate(plan.bins):
        back = with_puts(plan, number, packed.placements[::-1])
        assert_found(job, back, (Rule.FLOATING, number, 0))


def rests_on(job, upper, lower):
    """Whether the upper item touches the lower one's top."""
    meet = exact(lower.corner[2]) + exact(job.items[lower.item].size[2]) == exact(upper.corner[2])
    return meet and all(
        exact(a.corner[axis]) < exact(b.corner[axis]) + exact(job.items[b.item].size[axis])
        for axis in (0, 1)
        for a, b in ((upper, lower), (lower, upper))
    )


def test_an_item_over_the_edge_has_too_little_support():
    """Just more than half of it on a block, exactly half, just less."""
    job = Job((ItemType((10, 10, 10)), ItemType((10, 10, 1.234567))), (BinType((100, 100, 100)),))
    for x, fine in ((4.999999, True), (5, False), (5.000001, False)):
        for y in (0, 3):
            places = (Placement(0, "XYZ", (0, y, 0)), Placement(1, "XYZ", (x, y, 10)))
            plan = Plan((PackedBin(0, places),))
            if fine:
                check_plan(job, plan, SHARE)
            else:
                assert_found(job, plan, (Rule.SUPPORT, 0, 1))


def test_what_is_taken_away_or_doubled_is_counted(case):
    job, plan = case
    for number, turn, put in some_items(plan):
        puts = plan.bins[number].placements
        gone = with_puts(plan, number, [*puts[:turn], *puts[turn + 1 :]])
        assert_found(job, gone, (Rule.COUNT, None, None))
        twice = with_puts(plan, number, [*puts, put])
        assert_found(
            job,
            twice,
            (Rule.COUNT, None, None),
            (Rule.OVERLAP, number, len(puts)),
            (Rule.WEIGHT, number, None),
        )
        other = (number + 1) % 3
        elsewhere = with_puts(plan, other, [*plan.bins[other].placements, put])
        assert_found(job, elsewhere, (Rule.COUNT, None, None))
        assert_found(job, replace(plan, left_out=(put.item,)), (Rule.COUNT, None, None))


def test_what_is_exchanged_for_another_item_is_counted(case):
    job, plan = case
    for number, turn, put in some_items(plan):
        other = (put.item + 1) % len(job.items)
        assert_found(job, damaged(plan, number, turn, item=other), (Rule.COUNT, None, None))


def test_bins_too_many_empty_or_of_another_type(case):
    job, plan = case
    again = replace(plan, bins=(*plan.bins, plan.bins[0]))
    assert_found(job, again, (Rule.COPIES, 3, None), (Rule.COUNT, None, None))
    empty = replace(plan, bins=(*plan.bins, PackedBin(0, ())))
    assert_found(job, empty, (Rule.COPIES, 3, None), (Rule.EMPTY_BIN, 3, None))
    same = replace(plan, bins=tuple(replace(packed, bin=0) for packed in plan.bins))
    assert_found(job, same, (Rule.COPIES, 1, None), (Rule.COPIES, 2, None))


def test_a_billionth_over_the_limit_is_too_heavy(case):
    job, plan = case
    for number, packed in enumerate(plan.bins):
        for over in (0, 1):
            kinds = list(job.bins)
            limit = clean(weight(job, packed) - over * 1e-9)
            kinds[number] = replace(kinds[number], max_weight=limit)
            records = list(plan_violations(replace(job, bins=tuple(kinds)), plan, SHARE))
            assert [(one.rule, one.bin) for one in records] == [(Rule.WEIGHT, number)] * over


def test_an_orientation_that_is_not_allowed_is_found(case):
    job, plan = case
    for number, turn, _ in some_items(plan):
        for way in ("ZYX", "YZX", "XZY", "ZXY"):
            turned = damaged(plan, number, turn, orientation=way)
            assert_found(job, turned, (Rule.ORIENTATION, number, turn))


@pytest.mark.parametrize(
    "change",
    [
        {"item": -1},
        {"item": 10**6},
        {"item": 0.5},
        {"item": "0"},
        {"item": None},
        {"orientation": "XYX"},
        {"orientation": None},
        {"corner": (0, 0)},
        {"corner": (0, 0, math.nan)},
        {"corner": (0, -math.inf, 0)},
        {"corner": (0, 0, "0")},
        {"corner": (0, 0, 10**400)},
        {"corner": None},
    ],
    ids=str,
)
def test_what_names_nothing_is_unknown(case, change):
    job, plan = case
    records = list(plan_violations(job, damaged(plan, 1, 2, **change), SHARE))
    assert [(record.rule, record.bin, record.turn) for record in records] == [(Rule.UNKNOWN, 1, 2)]


@pytest.mark.parametrize("bin", [-1, 3, None, 0.5])
def test_a_bin_of_no_type_is_unknown(case, bin):
    job, plan = case
    bins = (replace(plan.bins[0], bin=bin), *plan.bins[1:])
    records = list(plan_violations(job, replace(plan, bins=bins), SHARE))
    assert [(record.rule, record.bin) for record in records] == [(Rule.UNKNOWN, 0)]
