"""Do items stand? The check against exact geometry of pairs of points, and a dense system."""

import itertools
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from jaxpack.errors import UserError
from jaxpack.model.box_check import Rule
from jaxpack.model.job import BinType, ItemType, Job, PackedBin, Placement, Plan
from jaxpack.model.plan_check import InvalidPlanError, check_plan, plan_violations
from jaxpack.model.rules import Rules
from jaxpack.model.violations import sentence

MARGIN = Fraction(1, 64)


def packed(*boxes, weights=None, scale=1, dimension=3, room=(1000, 1000, 1000)):
    """(job, plan): boxes (x, y, z, side x, y, z) in one bin, each an item of its own."""
    weights = weights or [0] * len(boxes)
    flat = dimension == 2
    scales = (scale, 1 if flat else scale, scale)

    def scaled(lengths):
        return tuple(float(length * by) for length, by in zip(lengths, scales, strict=True))

    items = tuple(
        ItemType(scaled(box[3:]), weight=weight) for box, weight in zip(boxes, weights, strict=True)
    )
    puts = tuple(Placement(row, "XYZ", scaled(box[:3])) for row, box in enumerate(boxes))
    room = (room[0], 1 if flat else room[1], room[2])
    return Job(items, (BinType(scaled(room)),), dimension), Plan((PackedBin(0, puts),))


def found(stability, *boxes, **given):
    """The violations of stability. The share of the base is not looked at."""
    job, plan = packed(*boxes, **given)
    records = list(plan_violations(job, plan, Rules(0, stability=stability)))
    assert {record.rule.value for record in records} <= {stability} - {"share"}
    return records


def fallen(stability, *boxes, **given):
    return [record.turn for record in found(stability, *boxes, **given)]


def plank(block, x=0, width=10):
    """A plank of 100 on a block as long as that."""
    return (0, 0, 0, block, width, 10), (x, 0, 10, 100, width, 10)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(
    ("block", "centre", "static"),
    [
        (40, 1, 1),
        (49, 1, 1),
        (50, 1, 0),
        (51, 1, 0),
        (Fraction(3300, 64), 0, 0),
        (52, 0, 0),
        (100, 0, 0),
    ],
)
def test_a_plank_on_a_block(block, centre, static, dimension):
    """The edge of the block has to be 1/64 of the plank beyond its middle; half is balance."""
    boxes = plank(block, width=1 if dimension == 2 else 10)
    assert len(found("centre", *boxes, dimension=dimension)) == centre
    assert len(found("static", *boxes, dimension=dimension)) == static
    assert not fallen("share", *boxes, dimension=dimension)


def test_what_is_said():
    (record,) = found("centre", *plank(40))
    assert record[:4] == (Rule.CENTRE, 0, 1, 1)
    assert (record.what, record.amount) == ("x", pytest.approx(10 + 100 / 64))
    words = "its centre is not inside what carries it"
    where = "bin 0 item 1 (loaded as number 1)"
    assert sentence(record) == f"{where}: {words}: it is 11.5625 too far out along x"
    assert sentence(found("static", *plank(40))[0]) == (
        f"{where}: its stack is not in equilibrium: it would tip along x"
    )
    (record,) = found("centre", *plank(60), (70, 0, 20, 30, 10, 10))
    assert (record.turn, record.what, record.amount) == (2, None, None)
    assert sentence(record).endswith(f"{words}: nothing firm is under it")
    with pytest.raises(InvalidPlanError, match="it would tip along x"):
        check_plan(*packed(*plank(40)), Rules(0, stability="static"))
    with pytest.raises(UserError, match="stability 'firm' is not known"):
        check_plan(*packed(*plank(40)), Rules(stability="firm"))


def test_the_length_is_in_the_units_of_the_job():
    (record,) = found("centre", *plank(40), scale=0.1)
    assert record.amount == pytest.approx(1.15625)
    turned = [(y, x, z, b, a, c) for x, y, z, a, b, c in plank(40)]
    (record,) = found("centre", *turned, scale=1e6)
    assert (record.what, record.amount) == ("y", pytest.approx(11_562_500))


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_bridge(dimension):
    """Over two blocks, its centre over neither, and something on the middle of it."""
    pillars = [(0, 0, 0, 2, 1, 5), (8, 0, 0, 2, 1, 5)]
    for stability in ("centre", "static"):
        boxes = (*pillars, (0, 0, 5, 10, 1, 1), (4, 0, 6, 2, 1, 3))
        assert not fallen(stability, *boxes, dimension=dimension)
        assert fallen(stability, pillars[0], (0, 0, 5, 10, 1, 1), dimension=dimension) == [1]
        out = pillars[0], (6, 0, 0, 2, 1, 5), (0, 0, 5, 12, 1, 1), (8, 0, 6, 4, 1, 90)
        assert bool(fallen(stability, *out, dimension=dimension))


def test_three_contacts_of_which_the_centre_is_not_between():
    """It is inside the rectangle around them."""
    corners = [(0, 0, 0, 1, 1, 3), (0, 9, 0, 1, 1, 3)]
    plate = (0, 0, 3, 10, 10, 1)
    for stability in ("centre", "static"):
        assert fallen(stability, *corners, (5, 0, 0, 1, 1, 3), plate) == [3]
        assert not fallen(stability, *corners, (9, 0, 0, 1, 1, 3), plate)


def test_a_load_on_the_free_end():
    """Over what hangs out an item does not stand whatever it weighs, but in fact if it is light."""
    boxes = *plank(60), (70, 0, 20, 30, 10, 10)
    assert fallen("centre", *boxes) == [2]
    assert fallen("static", *boxes, weights=[1, 10, 0.1]) == []
    assert fallen("static", *boxes, weights=[1, 10, 0]) == []
    assert len(fallen("static", *boxes, weights=[1, 10, 9])) == 1
    assert fallen("static", *boxes, weights=[1, 0, 0]) == []


def test_half_over_the_free_end():
    """What is over the firm part by more than half is firm there only."""
    boxes = *plank(60), (40, 0, 20, 30, 10, 10)
    assert fallen("centre", *boxes) == []
    assert fallen("centre", *boxes, (62, 0, 30, 8, 10, 10)) == [3]
    assert fallen("centre", *boxes, (40, 0, 30, 20, 10, 10)) == []


def test_a_counterweight():
    """It holds a plank; what lies on the plank is not named for it."""
    boxes = *plank(40), (0, 0, 20, 40, 10, 10)
    assert fallen("centre", *boxes) == [1]
    assert fallen("static", *boxes, weights=[1, 1, 1]) == []
    assert fallen("static", *boxes, weights=[1, 9, 1]) == [1]


def test_weights_that_nobody_gave_are_volumes():
    boxes = *plank(40), (0, 0, 20, 40, 10, 3)
    assert fallen("static", *boxes, weights=[0, 0, 0]) == fallen(
        "static", *boxes, weights=[1, 9, 1]
    )
    high = *plank(40), (0, 0, 20, 40, 10, 30)
    assert fallen("static", *high) == []


def test_a_tower_leans_as_far_as_it_may():
    """Each by 45 % over the one below: every one would stand alone, and the tower falls."""
    tower = [(450 * level, 0, 100 * level, 1000, 100, 100) for level in range(4)]
    assert fallen("centre", *tower[:2], room=[5000] * 3) == []
    assert fallen("static", *tower[:2], room=[5000] * 3) == []
    assert fallen("centre", *tower, room=[5000] * 3) == [2, 3]
    assert len(fallen("static", *tower, room=[5000] * 3)) == 1


def test_only_the_cause_is_named():
    """What lies on a plank that falls is judged by all that this one touches; so is what floats."""
    falls = (0, 0, 0, 40, 10, 10), (0, 0, 10, 100, 10, 10)
    assert fallen("centre", *falls, (0, 0, 20, 70, 10, 10), (0, 0, 30, 40, 10, 10)) == [1]
    assert fallen("centre", *falls, (0, 0, 20, 90, 10, 10), (0, 0, 30, 40, 10, 10)) == [1, 2]
    hung = (0, 0, 0, 60, 10, 10), (0, 0, 10, 100, 10, 10), (60, 0, 20, 40, 10, 10)
    assert fallen("centre", *hung, *((60, 0, z, 40, 10, 10) for z in (30, 40, 50))) == [2]
    tower = [(0, 0, 20 + 10 * level, 100, 10, 10) for level in range(5)]
    job, plan = packed((0, 0, 0, 100, 10, 5), (0, 0, 10, 100, 10, 10), *tower)
    for stability in ("centre", "static"):
        rules = [one.rule for one in plan_violations(job, plan, Rules(stability=stability))]
        assert rules == [Rule.FLOATING]
        over = packed((0, 0, 0, 10, 10, 10), (5, 0, 5, 10, 10, 10))
        rules = [one.rule for one in plan_violations(*over, Rules(stability=stability))]
        assert rules == [Rule.OVERLAP]


def test_bins_and_stacks_are_apart():
    boxes = plank(40)
    job, plan = packed(*boxes, *((x + 200, *rest) for x, *rest in boxes))
    both = PackedBin(0, plan.bins[0].placements[:2]), PackedBin(0, plan.bins[0].placements[2:])
    for stability in ("centre", "static"):
        for bins in (plan.bins, both):
            rules = Rules(0, stability=stability)
            assert len(list(plan_violations(job, Plan(bins), rules))) == 2
    assert fallen("static", *plank(40), (200, 0, 0, 10, 10, 10), weights=[1, 1, 1e9]) == [1]


def dropped(falls):
    """Boxes (x, y, side x, y, z), each let fall onto those before."""
    boxes = []
    for x, y, *side in falls:
        under = [box for box in boxes if shared((x, y, 0, *side), box) is not None]
        boxes.append((x, y, max((box[2] + box[5] for box in under), default=0), *side))
    return boxes


def shared(one, other):
    """The footprint (x, y, x, y) that two boxes have in common, or None."""
    low = [max(one[axis], other[axis]) for axis in (0, 1)]
    high = [min(one[axis] + one[axis + 3], other[axis] + other[axis + 3]) for axis in (0, 1)]
    return (*low, *high) if low[0] < high[0] and low[1] < high[1] else None


def contacts_of(boxes):
    """(upper, lower or None for the floor, rectangle)."""
    for row, box in enumerate(boxes):
        if box[2] == 0:
            yield row, None, shared(box, box)
        for other in range(row):
            under = boxes[other]
            if under[2] + under[5] == box[2] and (both := shared(box, under)):
                yield row, other, both


def turn(a, b, c):
    """Above 0 where c is left of the way from a to b."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def sides_of(points):
    """Pairs of points that all others are on one side of: as half planes (a, b)."""
    if len(points) == 1:
        return []
    return [
        (a, b)
        for a, b in itertools.permutations(points, 2)
        if all(turn(a, b, c) >= 0 for c in points)
    ]


def between(points, point):
    """Is a point in the convex hull? By the half planes, and the extent for what is flat."""
    return (
        bool(points)
        and all(min(p[i] for p in points) <= point[i] <= max(p[i] for p in points) for i in (0, 1))
        and all(turn(a, b, point) >= 0 for a, b in sides_of(points))
    )


def extremes(points):
    """Points with the same hull: those that are not in the middle of two others or inside."""
    points = list(dict.fromkeys(points))
    ends = {end for side in sides_of(points) for end in side}
    return [one for one in points if (one in ends or not ends) and not in_a_middle(one, points)]


def in_a_middle(one, points):
    for a, b in itertools.combinations([point for point in points if point != one], 2):
        away = (a[0] - one[0]) * (b[0] - one[0]) + (a[1] - one[1]) * (b[1] - one[1])
        if away < 0 and turn(a, b, one) == 0:
            return True
    return False


def corners(rectangle):
    return [(Fraction(x), Fraction(y)) for x in rectangle[::2] for y in rectangle[1::2]]


def common(points, rectangle):
    """Points whose hull is what the hull of these shares with a rectangle."""
    kept = [corner for corner in corners(rectangle) if between(points, corner)] + points
    for a, b in itertools.combinations(points, 2):
        for edge, at in enumerate(rectangle):
            axis = edge % 2
            if (a[axis] - at) * (b[axis] - at) < 0:
                t = (at - a[axis]) / (b[axis] - a[axis])
                kept.append(tuple(p + (q - p) * t for p, q in zip(a, b, strict=True)))
    x, y, far_x, far_y = rectangle
    return extremes([point for point in kept if x <= point[0] <= far_x and y <= point[1] <= far_y])


def plainly_off_centre(boxes):
    """Rows that are not over firm ground, in fractions."""
    lying, firm, off = list(contacts_of(boxes)), [], []
    for row, (x, y, _, along_x, along_y, _) in enumerate(boxes):
        mine = [(under, both) for upper, under, both in lying if upper == row]
        points = extremes(
            [
                point
                for under, both in mine
                for point in (corners(both) if under is None else common(firm[under], both))
            ]
        )
        middle = [
            (
                x + along_x * (Fraction(1, 2) + i * MARGIN),
                y + along_y * (Fraction(1, 2) + j * MARGIN),
            )
            for i in (-1, 1)
            for j in (-1, 1)
        ]
        if not all(between(points, point) for point in middle):
            off.append(row)
            points = extremes([point for _, both in mine for point in corners(both)])
        firm.append(points)
    return off


def plainly_static(boxes, weights):
    """Is there a solution of the equations of all boxes, floor and all?"""
    forces = [
        (upper, under, at) for upper, under, both in contacts_of(boxes) for at in corners(both)
    ]
    matrix = np.zeros((3 * len(boxes), len(forces)))
    for column, (upper, under, at) in enumerate(forces):
        for row, sign in ((upper, 1), (under, -1)):
            if row is not None:
                x, y, _, along_x, along_y, _ = boxes[row]
                arms = [at[0] - x - Fraction(along_x, 2), at[1] - y - Fraction(along_y, 2)]
                matrix[3 * row : 3 * row + 3, column] = [sign, *(sign * float(arm) for arm in arms)]
    load = np.zeros(3 * len(boxes))
    load[::3] = np.array(weights) / max(sum(weights), 1e-300)
    return nnls(matrix, load, maxiter=10_000)[1] < 1e-7


side = st.sampled_from([1, 2, 3, 4, 6, 8])
falls = st.lists(
    st.tuples(st.integers(0, 8), st.integers(0, 8), side, side, st.integers(1, 2)),
    min_size=2,
    max_size=9,
)
heavy = st.lists(st.sampled_from([0, 1, 2, 5, 30]), min_size=9, max_size=9)


@settings(max_examples=80, deadline=None)
@given(falls)
def test_centres_are_where_exact_geometry_has_them(falls):
    boxes = dropped(falls)
    assert fallen("centre", *boxes) == plainly_off_centre(boxes)


@settings(max_examples=80, deadline=None)
@given(falls, heavy)
def test_stacks_stand_where_the_equations_have_a_solution(falls, weights):
    boxes = dropped(falls)
    weights = [max(weights), *weights[1 : len(boxes)]]
    assume(any(weights))
    stands = plainly_static(boxes, weights)
    assert bool(fallen("static", *boxes, weights=weights)) != stands
    assert stands or fallen("centre", *boxes), "what is centred stands"


def packed_well(random, count):
    """Boxes of which each is let fall where most of its base is carried, of some tries."""
    falls = []
    for _ in range(count):
        tries = []
        sides = random.integers(2, 6, 3).tolist()
        for x, y in random.integers(0, 9, (8, 2)).tolist():
            boxes = dropped([*falls, (x, y, *sides)])
            under = [both for upper, _, both in contacts_of(boxes) if upper == len(falls)]
            carried = sum((c - a) * (d - b) for a, b, c, d in under)
            tries.append((-carried, x, y))
        falls.append((*min(tries)[1:], *sides))
    return dropped(falls)


def test_what_is_centred_is_static_with_any_weights():
    """Plans of which most stand, though few of their items lie on others with all corners."""
    random, standing = np.random.default_rng(3), 0
    for _ in range(40):
        boxes = packed_well(random, 8)
        standing += not (off := fallen("centre", *boxes))
        assert off == plainly_off_centre(boxes)
        for _ in range(3):
            weights = (10.0 ** random.integers(-1, 3, len(boxes))).tolist()
            stands = plainly_static(boxes, weights)
            assert stands or off
            assert bool(fallen("static", *boxes, weights=weights)) != stands
    assert standing > 10


@pytest.mark.parametrize("scale", [0.1, 123.457, 1e6])
def test_it_is_the_same_mirrored_turned_and_in_other_units(scale):
    random = np.random.default_rng(5)
    for _ in range(8):
        boxes = packed_well(random, 7)
        weights = random.integers(0, 9, len(boxes)).tolist()
        weights[0] = 1
        others = {
            "as it is": boxes,
            "mirrored": [(30 - x - a, y, z, a, b, c) for x, y, z, a, b, c in boxes],
            "turned": [(30 - y - b, x, z, b, a, c) for x, y, z, a, b, c in boxes],
        }
        for stability in ("centre", "static"):
            wanted = fallen(stability, *boxes, weights=weights)
            for name, other in others.items():
                for by in (1, scale):
                    for heavier in (1, 1000):
                        loads = [heavier * weight for weight in weights]
                        got = fallen(stability, *other, weights=loads, scale=by, room=(30, 30, 99))
                        if stability == "static":
                            assert len(got) == len(wanted), (name, boxes)
                        else:
                            assert got == wanted, (name, boxes)


def test_positions_between_the_units():
    """Thirds of a side: the plank is carried by so much of its length."""
    for end, off in ((100 * (1 / 2 + 1 / 64) - 1e-3, True), (100 * (1 / 2 + 1 / 64) + 1e-3, False)):
        boxes = (0, 0, 0, 90, 10, 10), (90 - end, 0, 10, 100, 10, 10)
        assert bool(fallen("centre", *boxes)) == off
        thirds = (
            (0, 0, 0, 100, 10, 10),
            (100 / 3, 0, 10, 100, 10, 10),
            (200 / 3, 0, 20, 100, 10, 10),
        )
        assert fallen("centre", *thirds[:2]) == []
        assert fallen("centre", *thirds) == [2]


def test_many_cubes():
    """20,000 on a pallet: in stacks, and with every second layer by half a cube aside."""
    job = Job((ItemType((10, 10, 10), 20_000),), (BinType((1000, 1000, 1000)),))
    grid = [(x, y, z) for z in range(20) for y in range(25) for x in range(40)]

    def check(shift, stability):
        corners = [(10.0 * x + shift * (z % 2), 10.0 * y, 10.0 * z) for x, y, z in grid]
        plan = Plan((PackedBin(0, tuple(Placement(0, "XYZ", at) for at in corners)),))
        return list(plan_violations(job, plan, Rules(0, stability=stability)))

    assert check(0, "centre") == check(0, "static") == []
    off = check(5, "centre")
    rows = [one.turn // 1000 % 2 * 39 == one.turn % 40 for one in off]
    assert all(rows), "at one end of a row those that hang over half"
    assert len({one.turn for one in off}) == len(off) == 25 * 19
    assert {one.what for one in off} == {"x"}
    assert math.isclose(max(one.amount for one in off), 10 / 64)


def test_no_items_nothing_to_say():
    job = replace(packed((0, 0, 0, 1, 1, 1))[0])
    assert not list(plan_violations(job, Plan((), left_out=(0,)), Rules(stability="static")))
    assert fallen("centre", (0, 0, 0, 1, 1, 1)) == fallen("static", (0, 0, 0, 1, 1, 1)) == []
