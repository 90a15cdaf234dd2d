"""The rules of loads: what the check says of plans that keep them and of plans that just do not."""

import itertools
import json
import math
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from job_files import BINS_3D, assert_refused, file_with, notes_of, read
from matplotlib import image
from plain_rules import heap, plain_rules

from jaxpack.check import main as check_main
from jaxpack.errors import UserError
from jaxpack.io.jobs import job_from_columns, read_job
from jaxpack.io.order_files import read_orders
from jaxpack.io.pictures import write_png
from jaxpack.io.plans import read_plan_json, write_plan_json
from jaxpack.io.viewer import shown_plan
from jaxpack.model.box_check import Rule
from jaxpack.model.encoding import load_job
from jaxpack.model.job import BinType, ItemType, Job, PackedBin, Placement, Plan
from jaxpack.model.limits import BinLimits, ItemLimits, Obstacle
from jaxpack.model.objectives import bounds
from jaxpack.model.orders import OrderFiles
from jaxpack.model.plan_check import plan_violations
from jaxpack.model.rules import Rules
from jaxpack.model.shelves import fits_one_bin, shelved
from jaxpack.model.violations import sentence
from jaxpack.rule_flags import flag
from jaxpack.search.portfolio import SolveOptions
from jaxpack.service.limits import Limits
from jaxpack.service.orders import read_request
from jaxpack.service.problems import Problem
from jaxpack.solution import checked_options

BIN = BinType((10, 8, 6))


def job(*items, bins=(BIN,), dimension=3):
    """A job of items given as (size, limits, weight)."""
    types = [
        ItemType(size, limits=ItemLimits(**limits), weight=weight)
        for size, limits, weight in (
            (*item, {}, 0)[:3] if len(item) < 3 else item for item in items
        )
    ]
    return Job(tuple(types), tuple(bins), dimension)


def plan(*corners, bin=None):
    """Item after item where it lies; `bin` says in which bin each is."""
    bins = [0] * len(corners) if bin is None else bin
    loads = [
        PackedBin(0, tuple(Placement(i, "XYZ", c) for i, c in enumerate(corners) if bins[i] == n))
        for n in range(max(bins) + 1)
    ]
    return Plan(tuple(loads))


def broken(job, plan, **rules):
    """(rule, item, amount) of all that is found, each of which can be said."""
    found = list(plan_violations(job, plan, Rules(**{"stability": "share", **rules})))
    assert all(sentence(one, job).isprintable() for one in found)
    return [(one.rule, one.item, one.amount) for one in found]


def stack(*limits, weights=None):
    """Cubes for a column, from the lowest to the highest, and its plan."""
    weights = weights or [1] * len(limits)
    cubes = [((2, 2, 1), one, weight) for one, weight in zip(limits, weights, strict=True)]
    return job(*cubes), plan(*((0, 0, z) for z in range(len(limits))))


def test_weight_above():
    load, column = stack({"weight_above": 5}, {}, {}, weights=[9, 2, 3])
    assert broken(load, column) == []
    load, column = stack({"weight_above": 4.9}, {"weight_above": 2}, {}, weights=[9, 2, 3])
    assert broken(load, column) == [
        (Rule.WEIGHT_ABOVE, 0, pytest.approx(0.1)),
        (Rule.WEIGHT_ABOVE, 1, 1),
    ]


def test_weight_is_handed_down_by_area():
    # A plank of 10 kg, with 2 kg on it: three quarters lie on one block, a quarter on another.
    load = job(
        ((3, 2, 1), {"weight_above": 9}, 0),
        ((1, 2, 1), {"weight_above": 3}, 0),
        ((4, 2, 1), {}, 10),
        ((1, 1, 1), {}, 2),
    )
    where = plan((0, 0, 0), (3, 0, 0), (0, 0, 1), (0, 0, 2))
    assert broken(load, where) == []
    tighter = [replace(i, limits=replace(i.limits, weight_above=w)) for i, w in
               zip(load.items, (8.99, 2.99, math.inf, math.inf), strict=True)]  # fmt: skip
    found = broken(replace(load, items=tuple(tighter)), where)
    assert [one[:2] for one in found] == [(Rule.WEIGHT_ABOVE, 0), (Rule.WEIGHT_ABOVE, 1)]


def test_obstacles_carry_their_part():
    half = BinType((10, 8, 6), limits=BinLimits(obstacles=(Obstacle((0, 0, 0), (1, 2, 1)),)))
    load = job(((1, 2, 1), {"weight_above": 5}, 0), ((2, 2, 1), {}, 10), bins=(half,))
    assert broken(load, plan((1, 0, 0), (0, 0, 1))) == []


def test_stackable():
    load, column = stack({}, {"stackable": False}, {})
    assert broken(load, column) == [(Rule.STACKABLE, 2, None)]
    assert broken(load, plan((0, 0, 0), (0, 0, 1), (2, 0, 0))) == []


def test_stacks_of_few_items():
    load, column = stack({"most_in_stack": 3}, {}, {"most_in_stack": 3})
    assert broken(load, column) == []
    load, column = stack({}, {"most_in_stack": 2}, {})
    assert broken(load, column) == [(Rule.STACK, 1, 1)]
    load, column = stack({"most_in_stack": 1}, {}, {})
    assert broken(load, column) == [(Rule.STACK, 0, 2)]


def test_stack_ids():
    load, column = stack({"stack_id": 3}, {"stack_id": 3}, {})
    assert broken(load, column) == [(Rule.STACK_ID, 2, None)]
    assert broken(*stack({"stack_id": 3}, {"stack_id": 3})) == []


def test_heavy_below():
    load, column = stack({}, {}, weights=[1, 1.001])
    assert broken(load, column) == []
    assert broken(load, column, heavy_below=True) == [(Rule.HEAVY_BELOW, 1, pytest.approx(0.001))]
    assert broken(*stack({}, {}, weights=[1, 1]), heavy_below=True) == []


def test_on_the_floor():
    assert broken(*stack({"floor": True}, {})) == []
    assert broken(*stack({}, {"floor": True})) == [(Rule.ON_FLOOR, 1, 1)]


def test_apart_and_groups():
    load = Job(
        (ItemType((2, 2, 2), 2, limits=ItemLimits(apart="acid")), ItemType((2, 2, 2))), (BIN,)
    )
    near = PackedBin(0, (Placement(0, "XYZ", (0, 0, 0)), Placement(0, "XYZ", (4, 0, 0))))
    more = PackedBin(0, (Placement(1, "XYZ", (0, 0, 0)),))
    assert broken(load, Plan((near, more))) == [(Rule.APART, 0, None)]
    one, other = (PackedBin(0, (put,)) for put in near.placements)
    assert broken(load, Plan((one, other, more))) == []
    together = [replace(item, limits=ItemLimits(group="g")) for item in load.items]
    load = replace(load, items=tuple(together))
    assert broken(load, Plan((near, more))) == [(Rule.GROUP, None, 1)]
    large = [replace(item, size=(9, 8, 6)) for item in load.items]  # these fit no bin together
    puts = [PackedBin(0, (Placement(n, "XYZ", (0, 0, 0)),)) for n in (0, 0, 1)]
    assert broken(replace(load, items=tuple(large)), Plan(tuple(puts))) == []


def test_stops_from_above():
    load = job(((2, 2, 2), {"stop": 1}, 0), ((2, 2, 2), {"stop": 2}, 0), ((3, 2, 1), {}, 0))
    assert broken(load, plan((0, 0, 0), (2, 0, 0), (4, 0, 0))) == []
    # Not on it, but over it.
    found = broken(load, plan((0, 0, 0), (0, 2, 0), (0, 1, 2)))
    assert found == [(Rule.STOP, 0, None), (Rule.STOP, 1, None)]
    swapped = Plan((PackedBin(0, (Placement(1, "XYZ", (0, 0, 0)), Placement(0, "XYZ", (0, 0, 2)),
                                  Placement(2, "XYZ", (4, 0, 0)))),))  # fmt: skip
    assert broken(load, swapped) == []


def test_through_a_door():
    load = job(((2, 2, 2), {"stop": 1}, 0), ((2, 2, 2), {"stop": 2}, 0))
    first_out_last_in = Plan(
        (PackedBin(0, (Placement(1, "XYZ", (0, 0, 0)), Placement(0, "XYZ", (2, 0, 0)))),)
    )
    assert broken(load, first_out_last_in, door="x") == []
    assert broken(load, plan((0, 0, 0), (2, 0, 0)), door="x") == [(Rule.STOP, 0, None)]
    assert broken(load, plan((0, 0, 0), (2, 2, 0)), door="x") == []
    # Loaded behind what stands in the door.
    load = job(((2, 2, 2),), ((2, 2, 2),))
    assert broken(load, plan((2, 0, 0), (0, 0, 0)), door="x") == [(Rule.BLOCKED, 1, 0)]
    assert broken(load, plan((2, 0, 0), (0, 0, 0))) == []
    # Under a plank that is there already, which has to come from the side.
    load = job(((4, 2, 1),), ((6, 2, 1),), ((2, 2, 1),))
    under = plan((0, 0, 0), (0, 0, 1), (4, 0, 0))
    assert broken(load, under, door="x") == []
    assert broken(load, under) == [(Rule.BLOCKED, 2, 2)]


def test_gap_in_3d():
    load = job(((2, 2, 2),), ((2, 2, 2),), ((2, 2, 2),))
    assert broken(load, plan((0, 0, 0), (2.5, 0, 0), (0, 0, 2)), gap=0.5) == []
    assert broken(load, plan((0, 0, 0), (2.4, 0, 0), (0, 0, 2)), gap=0.5) == [
        (Rule.GAP, 1, pytest.approx(0.1))
    ]
    assert broken(load, plan((0, 0, 0), (2.4, 2.5, 0), (6, 0, 0)), gap=0.5) == []
    found = broken(load, plan((0, 0, 0), (2.4, 2.4, 0), (6, 0, 0)), gap=0.5)
    assert found == [(Rule.GAP, 1, pytest.approx(0.1))]
    # One that overlaps is said to overlap.
    assert broken(load, plan((0, 0, 0), (1, 0, 0), (6, 0, 0)), gap=0.5) == [(Rule.OVERLAP, 1, 1)]


def test_gap_in_2d():
    load = job(((4, 1, 2),), ((4, 1, 2),), bins=(BinType((10, 1, 6)),), dimension=2)
    assert broken(load, plan((0, 0, 0), (0, 0, 2.1)), gap=0.1) == []
    assert broken(load, plan((0, 0, 0), (0, 0, 2)), gap=0.1) == [(Rule.GAP, 1, 0.1)]
    assert [r for r, *_ in broken(load, plan((0, 0, 0), (0, 0, 2.2)), gap=0.1)] == [Rule.FLOATING]
    assert broken(load, plan((0, 0, 0), (4.1, 0, 0)), gap=0.1) == []
    assert broken(load, plan((0, 0, 0), (4.05, 0, 0)), gap=0.1) == [
        (Rule.GAP, 1, pytest.approx(0.05))
    ]
    # What is over it within the gap is over it.
    lower = Plan(
        (PackedBin(0, (Placement(0, "XYZ", (0, 0, 2.05)), Placement(1, "XYZ", (0, 0, 0)))),)
    )
    assert (Rule.BLOCKED, 1, pytest.approx(4.15)) in broken(load, lower, gap=0.1)


def test_an_obstacle_is_firm_wherever_it_is():
    shelf, bracket = Obstacle((0, 0, 2), (6, 8, 1)), Obstacle((0, 0, 0), (1, 8, 2))
    load = job(((2, 2, 1),), bins=(replace(BIN, limits=BinLimits(obstacles=(bracket, shelf))),))
    for stability in ("centre", "static"):
        assert broken(load, plan((4, 0, 3)), stability=stability) == []


def test_overhang():
    load = job(((4, 4, 2),))
    for at in ((-1, -1, 0), (7, 5, 0)):
        assert broken(load, plan(at), overhang=1) == []
        assert [rule for rule, *_ in broken(load, plan(at))] == [Rule.OUTSIDE, Rule.OUTSIDE]
    assert broken(load, plan((-1.1, 0, 0)), overhang=1) == [(Rule.OUTSIDE, 0, pytest.approx(0.1))]
    # Half of the base is not over the floor.
    assert broken(load, plan((-2, 0, 0)), overhang=2) == [(Rule.SUPPORT, 0, 0)]
    assert broken(load, plan((-2, 0, 0)), overhang=2, inclusive=True) == []
    assert broken(load, plan((-4, 0, 0)), overhang=4, support=0) == [(Rule.FLOATING, 0, 0)]
    # By the middle, with a margin of a 64th: what lies on it, over the edge, is not on firm ground.
    for x, stands in ((-1.9, True), (-1.95, False)):
        for stability in ("centre", "static"):
            rules = {"overhang": 2, "support": 0.1, "stability": stability}
            found = [rule for rule, *_ in broken(load, plan((x, 0, 0)), **rules)]
            assert found == ([] if stands or stability == "static" else [Rule.CENTRE])
    two = job(((4, 4, 2),), ((1.5, 4, 2),))
    load_on_edge = plan((-1.5, 0, 0), (-1.5, 0, 2))
    rules = {"overhang": 2, "support": 0.1}
    assert [r for r, *_ in broken(two, load_on_edge, **rules, stability="centre")] == [Rule.CENTRE]
    assert broken(two, load_on_edge, **rules, stability="static") == []
    far_out = [rule for rule, *_ in broken(load, plan((-2.1, 0, 0)), overhang=3, support=0.1,
                                           stability="static")]  # fmt: skip
    assert far_out == [Rule.STATIC]
    flat = job(((4, 1, 2),), bins=(BinType((10, 1, 6)),), dimension=2)
    assert broken(flat, plan((-1, 0, 0)), overhang=1) == []
    assert broken(flat, plan((0, -1, 0)), overhang=1)[0] == (Rule.OUTSIDE, 0, 1)


def test_balance():
    load = job(((2, 2, 2), {}, 3), ((2, 2, 2), {}, 1))
    # The centre of mass is at 3 of 10 along x, and in the middle along y.
    where = plan((1, 3, 0), (5, 3, 0))
    assert broken(load, where, balance=0.4) == []
    assert broken(load, where, balance=0.39) == [(Rule.BALANCE, None, pytest.approx(0.05))]
    light = job(((2, 2, 2),), ((2, 2, 2),))  # nothing weighs anything: volumes count
    assert broken(light, plan((1, 3, 0), (7, 3, 0)), balance=0.01) == []


def test_bins_with_few_items():
    few = BinType((10, 8, 6), limits=BinLimits(most_items=1))
    load = job(((2, 2, 2),), ((2, 2, 2),), bins=(few,))
    assert broken(load, plan((0, 0, 0), (2, 0, 0))) == [(Rule.ITEMS, None, 1)]
    assert broken(load, plan((0, 0, 0), (0, 0, 0), bin=[0, 1])) == []


def test_obstacles():
    arch = Obstacle((0, 0, 0), (4, 2, 2))
    shelf = Obstacle((6, 0, 3), (2, 2, 1))
    load = job(((2, 2, 2),), bins=(BinType((10, 8, 6), limits=BinLimits(obstacles=(arch, shelf))),))
    for at in ((4, 0, 0), (0, 0, 2), (3, 0, 2), (0, 2, 0), (6, 0, 4)):
        assert broken(load, plan(at)) == ([(Rule.SUPPORT, 0, 0)] if at[0] == 3 else [])
    assert broken(load, plan((3, 0, 0))) == [(Rule.OVERLAP, 0, 1)]
    assert broken(load, plan((6, 0, 0))) == [(Rule.BLOCKED, 0, 4)]  # it is under the shelf
    assert broken(load, plan((6, 0, 0)), door="x") == []
    assert [r for r, *_ in broken(load, plan((4, 0, 2)))] == [Rule.FLOATING]
    (found,) = plan_violations(load, plan((3, 0, 0)))
    assert found.other == -1
    assert sentence(found).endswith("overlaps obstacle 0 by 1 along x")


def test_many_items_are_soon_checked():
    side = 28
    load = Job(
        (ItemType((1, 1, 1), side**3, 1.0, limits=ItemLimits(weight_above=side, stop=1)),),
        (BinType((side, side, side)),),
    )
    corners = itertools.product(range(side), range(side), range(side))
    puts = tuple(Placement(0, "XYZ", (x, y, z)) for z, y, x in corners)
    assert broken(load, Plan((PackedBin(0, puts),))) == []


@pytest.mark.parametrize("seed", range(20))
def test_shelved_items_keep_to_all_rules(seed):
    random = np.random.default_rng(seed)
    rules = {
        "gap": float(random.choice([0, 0.5])),
        "heavy_below": bool(random.integers(2)),
        "support": 1.0,
        "door": str(random.choice(["", "x"])),
    }
    items = tuple(
        ItemType(
            tuple(random.integers(1, 5, 3).tolist()),
            int(random.integers(1, 6)),
            float(random.integers(3)),
            ("XYZ", "YXZ", "ZYX"),
            limits=ItemLimits(
                group="g",
                stop=int(random.integers(1, 3)) if random.random() < 0.3 else None,
                weight_above=float(random.integers(3)) if random.random() < 0.3 else math.inf,
                stackable=bool(random.random() < 0.7),
            ),
        )
        for _ in range(3)
    )
    load = Job(items, (BinType((12, 12, 9)),))
    found = shelved(load, range(len(items)), load.bins[0], Rules(**rules))
    if found is not None:
        assert len(found) == load.count
        assert broken(load, Plan((PackedBin(0, found),)), **rules) == []


def test_what_shelves_say_no_to():
    group = ItemType((2, 2, 2), 4, 1.0)
    for kind, rules in (
        (BinType((4, 4, 2)), {}),
        (BinType((2, 2, 8)), {}),
        (BinType((8, 2, 2), max_weight=4), {}),
        (BinType((9.5, 2, 2)), {"gap": 0.5}),
    ):
        load = Job((group,), (kind,))
        assert fits_one_bin(load, [0], load.bins[0], Rules(**rules))
    for kind, rules in (
        (BinType((4, 4, 1.9)), {}),
        (BinType((8, 2, 2), max_weight=3.9), {}),
        (BinType((8, 2, 2), limits=BinLimits(most_items=3)), {}),
        (BinType((9.4, 2, 2)), {"gap": 0.5}),
    ):
        load = Job((group,), (kind,))
        assert not fits_one_bin(load, [0], load.bins[0], Rules(**rules))


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        ({"gap": -1}, "gap -1: give a length, 0 or more"),
        ({"overhang": math.inf}, "overhang: inf is not a finite number"),
        ({"door": "y"}, "door 'y' is not known: use x"),
        ({"balance": 0}, "balance 0: give a share of the floor, more than 0, up to 1"),
        ({"balance": 1.1}, "balance 1.1: give a share"),
        ({"heavy_below": 1}, "heavy_below 1: give True or False"),
    ],
)
def test_rules_that_are_none(rules, message):
    assert_refused(lambda: Rules(**rules).checked(), message)


def test_no_door_in_2d():
    assert_refused(lambda: Rules(door="x").checked(dimension=2), "door x: in 2D items come from")


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"weight_above": -1}, "item 0, weight_above: -1 is not a weight"),
        ({"stackable": "no"}, "item 0, stackable: 'no': give True or False"),
        ({"most_in_stack": 0}, "item 0, most_in_stack: 0 is not possible: give a whole number"),
        ({"stack_id": -1}, "item 0, stack_id: -1 is not possible"),
        ({"group": 3}, "item 0, group: 3 is no text"),
        ({"stop": 0.5}, "item 0, stop: 0.5 is not possible"),
    ],
)
def test_limits_of_items_that_are_none(limits, message):
    assert_refused(lambda: job(((1, 1, 1), limits, 0)), message)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (BinLimits(most_items=0), "bin 0, most_items: 0 is not possible"),
        (
            BinLimits(obstacles=(Obstacle((0, 0, 0), (11, 1, 1)),)),
            "obstacle 0: from 0 to 11 along x, and the bin is from 0 to 10",
        ),
        (BinLimits(obstacles=(Obstacle((0, 0, 0), (1, 1, 0)),)), "obstacle 0, size: 0 is not a si"),
        (
            BinLimits(obstacles=(Obstacle((0, 0, 0), (2, 2, 2)), Obstacle((1, 1, 1), (2, 2, 2)))),
            "bin 0: obstacles 0 and 1 overlap",
        ),
        (BinLimits(obstacles=(3,)), "obstacle 0: 3 is no Obstacle"),
        (3, "limits 3: give BinLimits"),
    ],
)
def test_limits_of_bins_that_are_none(limits, message):
    with pytest.raises(UserError, match="bin 0") as stop:
        job(((1, 1, 1),), bins=(BinType((10, 8, 6), limits=limits),))
    assert message in str(stop.value)


def test_obstacles_are_whole_multiples_of_the_unit():
    fine = BinType((10, 8, 6), limits=BinLimits(obstacles=(Obstacle((0.25, 0, 0), (1, 1, 1)),)))
    assert job(((2, 2, 2),), bins=(fine,)).unit == 1 / 4


ITEMS = "X,Y,Z,{}\n3,4,5,{}\n3,4,5,\n"
COLUMNS = [
    ("MAXIMUM_WEIGHT_ABOVE", "30,5", ItemLimits(weight_above=30.5)),
    ("MAXIMUM_WEIGHT_ABOVE", "0", ItemLimits(weight_above=0)),
    ("MAXIMUM_WEIGHT_ABOVE", "inf", ItemLimits()),
    ("MAXIMUM_WEIGHT_ABOVE", "-1", ItemLimits()),
    ("STACKABLE", "0", ItemLimits(stackable=False)),
    ("STACKABLE", "TRUE", ItemLimits()),
    ("MAXIMUM_STACKABILITY", "3", ItemLimits(most_in_stack=3)),
    ("MAXIMUM_STACKABILITY", "2147483647", ItemLimits()),
    ("STACKABILITY_ID", "7", ItemLimits(stack_id=7)),
    ("GROUP", "Müller", ItemLimits(group="Müller")),
    ("GROUP", "12", ItemLimits(group="12")),
    ("APART", "acid", ItemLimits(apart="acid")),
    ("STOP", "2", ItemLimits(stop=2)),
    ("FLOOR", "1", ItemLimits(floor=True)),
]


@pytest.mark.parametrize(("name", "cell", "limits"), COLUMNS)
def test_columns_of_items(tmp_path, name, cell, limits):
    text = ITEMS.format(name.lower(), cell).replace(",", ";").replace("30;5", "30,5")
    found, notes = notes_of(tmp_path, text, BINS_3D)
    assert [item.limits for item in found.items] == [limits, ItemLimits()]
    assert not any("not used" in note for note in notes)
    flat = f"WIDTH,HEIGHT,{name}\n3,4,{cell.replace(',', '.')}\n"
    (found,) = read(tmp_path, flat, "WIDTH,HEIGHT\n9,9\n")
    assert found.items[0].limits == limits
    assert found.limited == (limits != ItemLimits())


def test_columns_from_a_program():
    items = {
        "X": [3, 3],
        "Y": [4, 4],
        "Z": [5, 5],
        "STOP": [1, math.nan],
        "STACKABLE": [False, None],
    }
    bins = [{"X": 9, "Y": 9, "Z": 9, "MAXIMUM_ITEMS": 4}]
    found = job_from_columns(items, bins, obstacles=[
        {"X": 0, "Y": 0, "Z": 0, "LX": 1, "LY": 2, "LZ": 3}
    ])  # fmt: skip
    assert [item.limits for item in found.items] == [
        ItemLimits(stop=1, stackable=False),
        ItemLimits(),
    ]
    assert found.bins[0].limits == BinLimits(4, (Obstacle((0, 0, 0), (1, 2, 3)),))


def test_columns_of_orders(tmp_path):
    text = "ORDER,X,Y,Z,STOP\na,3,4,5,1\nb,3,4,5,2\nb,3,4,5,0.5\n"
    wrong = {}
    jobs = read(tmp_path, text, BINS_3D, by_order=True, bad=wrong.__setitem__)
    assert [(one.name, one.items[0].limits.stop) for one in jobs] == [("a", 1)]
    assert "items.csv: row 4, column STOP: 0.5 is not possible" in str(wrong["b"])


@pytest.mark.parametrize(
    ("name", "cell", "message"),
    [
        ("MAXIMUM_WEIGHT_ABOVE", "-2", "-2 is not a weight: give 0 to 1e9"),
        ("MAXIMUM_WEIGHT_ABOVE", "much", "'much' is not a number"),
        ("STACKABLE", "2", "says neither yes nor no: give 1 or 0"),
        ("MAXIMUM_STACKABILITY", "0", "0 is not possible: give a whole number, at least 1"),
        ("STACKABILITY_ID", "-1", "-1 is not possible"),
        ("STOP", "0", "0 is not possible: give a whole number, at least 1"),
        ("FLOOR", "no", "'no' says neither yes nor no"),
    ],
)
def test_bad_cells_of_items(tmp_path, name, cell, message):
    text = ITEMS.format(name, cell)
    where = f"items.csv: row 2, column {name}: "
    assert_refused(lambda: read(tmp_path, text, BINS_3D), where, message)
    (found,) = read(tmp_path, text, BINS_3D, ignore=[name])
    assert not found.limited


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("MAX_WEIGHT_ABOVE", "MAXIMUM_WEIGHT_ABOVE"),
        ("UNSTACKABLE", "STACKABLE"),
        ("MAX_STACKABILITY", "MAXIMUM_STACKABILITY"),
        ("STOPS", "STOP"),
        ("STOP NUMBER", "STOP"),
        ("UNLOADING_ORDER", "STOP"),
        ("FLOOR_ONLY", "FLOOR"),
        ("GROUPS", "GROUP"),
        ("KEEP APART", "APART"),
    ],
)
def test_other_words_for_columns(tmp_path, name, meant):
    text = ITEMS.format(name, "1")
    assert_refused(lambda: read(tmp_path, text, BINS_3D), f"{name} is not known; is {meant} meant?")


@pytest.mark.parametrize("name", ["PART", "PRODUCT GROUP", "COLOUR"])
def test_words_that_mean_something_else(tmp_path, name):
    (found,) = read(tmp_path, ITEMS.format(name, "1"), BINS_3D)
    assert not found.limited


def test_maximum_items(tmp_path):
    bins = "X,Y,Z,MAXIMUM_ITEMS\n9,9,9,4\n9,9,9,-1\n9,9,9,\n"
    (found,) = read(tmp_path, ITEMS.format("NOTE", ""), bins)
    assert [kind.limits.most_items for kind in found.bins] == [4, None, None]
    bad = bins.replace("9,4", "9,0")
    assert_refused(
        lambda: read(tmp_path, ITEMS.format("NOTE", ""), bad), "row 2, column MAXIMUM_IT"
    )


def test_files_of_obstacles(tmp_path):
    items = file_with(tmp_path, "items.csv", "X (mm),Y (mm),Z (mm)\n30,40,50\n")
    bins = file_with(tmp_path, "bins.csv", "X (cm),Y (cm),Z (cm),NAME\n9,9,9,van\n8,8,8,1\n")
    taken = "bin,x,y,z,lx,ly,lz\n{},0,0,0,1,2.5,3\n"

    def obstacles(name):
        path = file_with(tmp_path, "taken.csv", taken.format(name))
        (found,) = read_job(items, bins, obstacles=path)
        return [kind.limits.obstacles for kind in found.bins]

    one = Obstacle((0, 0, 0), (10, 25, 30))  # in the items' unit, as the bins
    assert obstacles("van") == [(one,), ()]
    assert obstacles("1") == [(), (one,)]
    assert obstacles("0") == [(one,), ()]
    assert obstacles("") == [(one,), (one,)]
    assert_refused(lambda: obstacles("bus"), "taken.csv: row 2, column BIN: 'bus' is no bin: there")
    taken = "X,Y,Z,LX,LY,LZ\n{}0,0,0,1,2.5,10\n"
    what = "taken.csv: row 2: from 0 to 100 along z, and the bin is from 0 to 90"
    assert_refused(lambda: obstacles(""), what)
    taken = "X,Y,Z,LX,LY\n{}0,0,0,1,2.5\n"
    assert_refused(lambda: obstacles(""), "column LZ is missing")
    taken = "BIN,X,Y,Z,LX,LY,LZ\nvan,0,0,0,1,2,3\n{},0,0,2,3,1,4\n"
    assert obstacles("1") == [
        (Obstacle((0, 0, 0), (10, 20, 30)),),
        (Obstacle((0, 0, 20), (30, 10, 40)),),
    ]
    assert_refused(lambda: obstacles(""), "taken.csv: row 3: overlaps the obstacle of", "row 2")
    taken = "BINS,X,Y,Z,LX,LY,LZ\n{},0,0,0,1,2,3\n"
    what = "taken.csv: row 1: column BINS is not known; is BIN meant? Rename it"
    assert_refused(lambda: obstacles("van"), what)


def test_obstacles_of_files_with_bins_of_their_own(tmp_path):
    flat = file_with(tmp_path, "a.ins2D", "1\n9 9\n1 2 3\n")
    path = file_with(tmp_path, "taken.csv", "X,Z,LX,LZ\n1,2,3,4\n")
    (found,) = read_job(flat, obstacles=path)
    assert found.bins[0].limits.obstacles == (Obstacle((1, 0, 2), (3, 1, 4)),)


def unfit(load, **rules):
    """What is said of items for which there is no place."""
    with pytest.raises(UserError) as stop:
        load_job(load, Rules(**rules))
    return str(stop.value)


def test_items_that_no_rule_lets_in():
    load = Job(
        (ItemType((2, 2, 2), 3, limits=ItemLimits(apart="acid")),), (replace(BIN, copies=2),)
    )
    assert unfit(load).startswith("item 0: 3 items that are to be apart 'acid', and 2 bins: give")
    load = job(*[((5, 5, 5), {"apart": "acid"}, 0)] * 2, bins=(BinType((9, 9, 9), copies=1),))
    assert "and 1 bin: give" in unfit(load)
    assert load_job(replace(load, bins=(BIN,)))
    pillar = Obstacle((4, 3, 0), (2, 2, 5))
    held = replace(BIN, limits=BinLimits(obstacles=(pillar,)))
    for size, floor, fits in (
        ((4, 8, 6), True, True),
        ((4.1, 8, 1), False, True),  # it can stand on the pillar
        ((4.1, 8, 1), True, False),
        ((4.1, 8, 1.1), False, False),
        ((10, 3, 6), True, True),
        ((10, 3.1, 6), False, False),
    ):
        load = job((size, {"floor": floor}, 0), bins=(held,))
        assert fits or "beside its obstacles; give a bin with fewer of them" in unfit(load)
        assert not fits or load_job(load)
    # Under a beam there is room through the door only, and nothing comes through a wall.
    for low, rules, fits in (
        ((0, 0, 5), {}, False),
        ((0, 0, 5), {"door": "x"}, True),
        ((9, 0, 0), {"door": "x"}, False),
        ((9, 0, 0), {}, True),
        ((9, 0, 0), {"door": "x", "overhang": 5}, True),  # beyond it
    ):
        size = (10, 8, 1) if low[2] else (1, 8, 6)
        wall = replace(BIN, limits=BinLimits(obstacles=(Obstacle(low, size),)))
        load = job(((5, 8, 5), {"floor": True}, 0), bins=(wall,))
        assert fits or "on the floor beside" in unfit(load, **rules)
        assert not fits or load_job(load, Rules(**rules))


def test_overhang_makes_room():
    load = job(((12, 8, 6),))
    assert "no bin can hold 12 x 8 x 6" in unfit(load)
    assert load_job(load, Rules(overhang=1))
    assert "no bin can hold" in unfit(load, overhang=0.9)


def test_units_hold_gap_and_overhang():
    load = job(((2, 2, 2),), ((4, 4, 4),))
    assert load_job(load, Rules(gap=0.25)).units.length == 1 / 4
    assert load_job(load, Rules(gap=3, overhang=0.5)).units.length == 1 / 2
    with pytest.raises(UserError, match="--gap 1e-09: too many digits"):
        checked_options(SolveOptions(rules=Rules(gap=1e-9)), load, flag)


def test_bounds_hold_by_the_rules():
    load = Job((ItemType((5, 4, 3), 32),), (BIN,))
    assert bounds(load).bins == 4
    wider = bounds(load, rules=Rules(overhang=2.5))  # volumes of bins are what they were
    assert wider.bins < 4
    assert wider.worth == (0, wider.bins, 480 * wider.bins)
    few = replace(BIN, limits=BinLimits(most_items=3))
    assert bounds(replace(load, bins=(few,))).bins == 11
    apart = tuple(replace(item, limits=ItemLimits(apart="a")) for item in load.items)
    assert bounds(replace(load, items=apart)).bins == 32


def test_a_plan_says_what_was_asked(tmp_path, capsys):
    items = file_with(tmp_path, "items.csv", "X,Y,Z,STOP,NAME\n4,4,2,1,a\n4,4,2,,b\n")
    bins = file_with(tmp_path, "bins.csv", "X,Y,Z,MAXIMUM_ITEMS\n10,8,6,2\n")
    taken = file_with(tmp_path, "taken.csv", "X,Y,Z,LX,LY,LZ\n8,6,0,2,2,6\n")
    (load,) = read_job(items, bins, obstacles=taken)
    path, rules = tmp_path / "plan.json", Rules(0.25, rule="nearest-corner", gap=0.5, overhang=2)
    write_plan_json(path, load, plan((-1.5, 0, 0), (3, 0, 0)), rules)
    said = json.loads(path.read_text())
    assert said["rules"] == {"support": 0.25, "gap": 0.5, "overhang": 2}
    assert said["bins"][0]["limits"] == {
        "most_items": 2,
        "obstacles": [{"corner": [8, 6, 0], "size": [2, 2, 6]}],
    }
    assert [one.get("limits") for one in said["bins"][0]["items"]] == [{"stop": 1}, None]
    assert read_plan_json(path, load) == plan((-1.5, 0, 0), (3, 0, 0))

    def check(*options):
        files = path, items, bins, *options
        with suppress(SystemExit):
            check_main([*map(str, files)])
        return capsys.readouterr()

    done = check()
    assert done.out.startswith("valid: 1 bin, 2 items")
    assert "made by: support 0.25, gap 0.5, overhang 2" in " ".join(done.err.split())
    assert "its bins have the obstacles that it says" in " ".join(done.err.split())
    assert check("--obstacles", taken).out == done.out
    other = file_with(tmp_path, "other.csv", "X,Y,Z,LX,LY,LZ\n0,0,0,2,2,6\n")
    assert "overlaps" in check("--obstacles", other).out
    assert "0.5 from the item loaded as number 0 along x, not 0.6" in check("--gap", "0.6").out
    said["bins"][0]["limits"]["obstacles"][0]["corner"] = [0, 0, 0]
    path.write_text(json.dumps(said))
    assert "overlaps" in check().out
    for obstacles, fault in (
        (3, "bin 0: key 'obstacles'"),
        ([{"corner": [0, 0, 0]}], "bin 0, obstacle 0: key 'size' is missing"),
        ([{"corner": [9, 0, 0], "size": [2, 2, 2]}], "bin 0, obstacle 0: from 9 to 11 along x"),
    ):
        said["bins"][0]["limits"]["obstacles"] = obstacles
        path.write_text(json.dumps(said))
        with pytest.raises(UserError, match=fault):
            check()
    said["rules"]["gab"] = 1
    path.write_text(json.dumps(said))
    with pytest.raises(UserError, match="key 'rules': 'gab' is not known: there are balance, "):
        check()


def test_a_job_with_limits_is_no_instance(tmp_path):
    text = "ORDER,X,Y,Z,STACKABLE\na,3,4,5,0\n"
    paths = [file_with(tmp_path, n, t) for n, t in (("o.csv", text), ("b.csv", BINS_3D))]
    what = "columns of rules that instances do not have, such as STACKABLE"
    assert_refused(lambda: read_orders(OrderFiles(*map(str, paths))), what)
    assert read_orders(OrderFiles(*map(str, paths), ignore=("STACKABLE",)))


def test_pictures_show_what_is_asked(tmp_path):
    pillar = Obstacle((4, 3, 0), (2, 2, 5))
    held = replace(BIN, limits=BinLimits(obstacles=(pillar,)))
    limits = {"stop": 2, "group": "<b>", "stackable": False, "weight_above": 3.0}
    load = job(((3, 3, 2), limits, 0), bins=(held,))
    shown = json.loads(shown_plan(load, plan((-1, 0, 0))))
    assert shown["types"][0]["limits"] == ["stop 2", "group <b>", "nothing on it", "carries 3"]
    assert shown["bins"][0]["obstacles"] == [{"corner": [4, 3, 0], "size": [2, 2, 5]}]
    write_png(tmp_path / "plan.png", load, plan((-1, 0, 0)))
    red, grey = (
        (np.abs(image.imread(tmp_path / "plan.png")[..., :3] - colour).max(-1) < 0.15).sum()
        for colour in ((0.8, 0, 0), (0.47, 0.47, 0.47))
    )
    assert red > 20
    assert grey > 100


@pytest.mark.parametrize("seed", range(25))
def test_random_heaps_are_as_a_plain_check_finds_them(seed):
    random = np.random.default_rng(seed)
    side = 8

    def maybe(value, otherwise):
        return value if random.random() < 0.3 else otherwise

    arch = Obstacle((0, 0, 0), (3, 3, 1)) if seed % 2 else None
    limits = BinLimits(maybe(9, None), (arch,) if arch else ())
    kind = BinType((side, side, 99), limits=limits)
    items, loads = [], []
    for _ in range(2):
        placed = []
        for corner, size in heap(random, 12, side, 4):
            if arch and all(c < 3 for c in corner[:2]):
                corner = (*corner[:2], corner[2] + 1)
            own = ItemLimits(
                weight_above=float(maybe(random.integers(5), math.inf)),
                stackable=bool(maybe(False, True)),
                most_in_stack=maybe(int(random.integers(1, 4)), None),
                stack_id=int(maybe(1, 0)),
                apart=maybe("a", ""),
                stop=maybe(int(random.integers(1, 4)), None),
                floor=bool(maybe(True, False)),
            )
            placed.append(Placement(len(items), "XYZ", corner))
            items.append(ItemType(size, weight=float(random.integers(4) * (seed % 3)), limits=own))
        loads.append(PackedBin(0, tuple(placed)))
    load, heaps = Job(tuple(items), (kind,)), Plan(tuple(loads))
    rules = {
        "gap": float(random.integers(2)),
        "door": str(random.choice(["", "x"])),
        "balance": maybe(0.1, None),
        "heavy_below": bool(random.integers(2)),
    }
    geometry = {Rule.OVERLAP, Rule.BLOCKED, Rule.FLOATING, Rule.SUPPORT, Rule.OUTSIDE}
    found = {
        (one.rule, one.bin) if one.turn is None else (one.rule, one.bin, one.turn)
        for one in plan_violations(load, heaps, Rules(0, True, stability="share", **rules))
        if one.rule not in geometry
    }
    assert found == plain_rules(load, heaps, **rules)
    assert found


def test_a_service_is_asked_for_rules():
    cube = {"X": 2, "Y": 2, "Z": 2, "STOP": 1}
    taken = {"X": 0, "Y": 0, "Z": 0, "LX": 1, "LY": 1, "LZ": 1}
    order = {
        "items": [cube],
        "bins": [{"X": 9, "Y": 9, "Z": 9, "MAXIMUM_ITEMS": 3}],
        "obstacles": [taken],
        "options": {"gap": 0.5, "overhang": 1, "door": "x", "balance": 0.5, "heavy_below": True},
    }
    (asked,) = read_request(False, json.dumps(order).encode(), Limits())
    assert asked.how.rules == Rules(gap=0.5, overhang=1, door="x", balance=0.5, heavy_below=True)
    assert asked.job.items[0].limits == ItemLimits(stop=1)
    assert asked.job.bins[0].limits == BinLimits(3, (Obstacle((0, 0, 0), (1, 1, 1)),))
    shared = {**order, "orders": [{"items": [cube]}, {"items": [cube], "obstacles": []}]}
    del shared["items"]
    one, other = read_request(True, json.dumps(shared).encode(), Limits())
    assert one.job == asked.job
    assert "obstacles" in json.loads(other.body)["detail"]
    order["options"] = {"gap": -1}
    with pytest.raises(Problem) as problem:
        read_request(False, json.dumps(order).encode(), Limits())
    assert json.loads(problem.value.body)["detail"] == "gap -1: give a length, 0 or more"
