"""What people asked packers for, each as small as it can be told: it comes out as they wanted."""

from dataclasses import replace

import pytest
from ruled_oracle import broken

import jaxpack
from jaxpack.model.job import ORIENTATIONS, UPRIGHT, BinType, ItemType, Job
from jaxpack.model.limits import BinLimits, ItemLimits, Obstacle
from jaxpack.model.rules import Rules
from jaxpack.search.portfolio import SolveOptions, solve_job
from jaxpack.search.wave import pack_wave

ANYHOW = tuple(ORIENTATIONS)


def solved(job, rules=Rules(), packings=60):
    """The plan, which obeys the rules."""
    found = solve_job(job, SolveOptions(rules=rules, packings=packings))
    assert not broken(job, found.plan, rules)
    return found.plan


def boxes(job, packed):
    """(item, low, high) of what is in a bin."""
    for put in packed.placements:
        item = job.items[put.item]
        size = item.turned(put.orientation)
        yield item, put.corner, tuple(a + b for a, b in zip(put.corner, size, strict=True))


def loads(plan):
    return sorted(len(packed.placements) for packed in plan.bins)


@pytest.mark.parametrize("share", [0.1, 0.01, 1e-5])
@pytest.mark.parametrize("size", [(400.0, 300.0, 200.0), (300.0, 400.0, 200.0), (0.7, 0.1, 0.3)])
def test_one_carton_stands_in_the_middle(size, share):
    bin_type = BinType((1200.0, 800.0, 1600.0) if size[0] > 1 else (1.2, 0.8, 1.6))
    for copies in (1, 4):
        job = Job((ItemType(size, copies),), (bin_type,))
        assert loads(solved(job, Rules(balance=share), 20)) == [copies]
    flat = Job((ItemType((size[0], 1.0, size[2])),), (replace(bin_type, size=(5.3, 1.0, 9.9)),), 2)
    assert size[0] > 1 or loads(solved(flat, Rules(balance=share), 20)) == [1]


@pytest.mark.parametrize("fragile", [{"stackable": False}, {"weight_above": 0.0}])
def test_glass_lies_on_iron(fragile):
    glass = ItemType((400.0, 300.0, 300.0), 1, 2.0, limits=ItemLimits(**fragile))
    iron = ItemType((400.0, 300.0, 100.0), 1, 25.0)
    (packed,) = solved(Job((glass, iron), (BinType((400.0, 300.0, 400.0)),))).bins
    assert [(put.item, put.corner[2]) for put in packed.placements] == [(1, 0.0), (0, 100.0)]


def test_nothing_on_what_carries_less_than_its_like():
    box = ItemType((1.0, 1.0, 1.0), 5, 5.0, limits=ItemLimits(weight_above=1.0))
    plan = solved(Job((box,), (BinType((2.0, 2.0, 5.0)),)))
    assert loads(plan) == [1, 4]
    assert all(put.corner[2] == 0 for packed in plan.bins for put in packed.placements)


def test_articles_on_their_own_stacks():
    one, other = (
        ItemType((2.0, 2.0, 1.0), 6, limits=ItemLimits(stack_id=number)) for number in (1, 2)
    )
    job = Job((one, other), (BinType((4.0, 2.0, 6.0)),))
    (packed,) = solved(job).bins
    stacks = {}
    for put in packed.placements:
        stacks.setdefault(put.corner[0], set()).add(put.item)
    assert sorted(map(sorted, stacks.values())) == [[0], [1]]


def test_stacks_of_two_articles_share_a_pallet():
    """Eight stacks of five have room; spread on the floor first, one article takes all of it."""
    one = ItemType((400.0, 300.0, 300.0), 17, orientations=UPRIGHT, limits=ItemLimits(stack_id=1))
    other = replace(one, limits=ItemLimits(stack_id=2))
    job = Job((one, other), (BinType((1200.0, 800.0, 1500.0)),))
    assert loads(solved(job, packings=24)) == [34]


@pytest.mark.parametrize(("objective", "used"), [("price", [0, 0, 0]), ("bins", [1])])
def test_small_parcels_or_one_large_one(objective, used):
    bins = BinType((15.0, 15.0, 15.0), cost=5.0), BinType((60.0, 60.0, 60.0), cost=60.0)
    plan = solved(Job((ItemType((10.0, 10.0, 10.0), 3),), bins, objective=objective))
    assert [packed.bin for packed in plan.bins] == used


def test_the_most_that_one_bin_holds():
    sizes = (60.0, 60.0, 20.0), (60.0, 20.0, 60.0), (20.0, 60.0, 60.0), (20.0, 20.0, 20.0)
    for ways in (("XYZ",), ANYHOW):
        items = tuple(ItemType(size, orientations=ways) for size in sizes)
        job = Job(items, (BinType((60.0, 60.0, 60.0), copies=1),), objective="value")
        plan = solved(job)
        # Turned alike the large ones fill it; as given there is room for one and the small one.
        assert len(plan.bins) == 1
        assert len(plan.left_out) == (1 if ways == ANYHOW else 2)
        assert (3 in plan.left_out) == (ways == ANYHOW)


@pytest.mark.parametrize("packings", [1, 60])
def test_articles_in_few_bins(packings):
    items = tuple(
        ItemType((100.0, 100.0, 5.0), copies, limits=ItemLimits(group=name))
        for name, copies in (("A", 47), ("B", 43), ("C", 25))
    )
    plan = solved(Job(items, (BinType((100.0, 100.0, 100.0)),)), packings=packings)
    kinds = [len({put.item for put in packed.placements}) for packed in plan.bins]
    assert sorted(kinds) == [1, 1, 1, 1, 1, 3]


def test_articles_that_fit_a_bin_are_in_one():
    items = tuple(
        ItemType((5.0, 5.0, 5.0), 6, limits=ItemLimits(group=name)) for name in ("A", "B", "C")
    )
    plan = solved(Job(items, (BinType((10.0, 10.0, 10.0)),)))
    assert loads(plan) == [6, 6, 6]


def test_around_what_is_there_already():
    taken = Obstacle((0.0, 0.0, 0.0), (4.0, 1.2, 2.5))
    truck = BinType((13.6, 2.4, 2.5), copies=1, limits=BinLimits(obstacles=(taken,)))
    pallet = ItemType((0.8, 1.2, 2.5), 29, orientations=UPRIGHT)
    plan = solved(Job((pallet,), (truck,)))
    assert loads(plan) == [29]
    assert not plan.left_out


def test_heavy_below_and_in_the_middle():
    heavy, light = (ItemType((400.0, 300.0, 200.0), 4, weight) for weight in (25.0, 2.0))
    job = Job((light, heavy), (BinType((1200.0, 800.0, 1000.0)),))
    third = Rules(heavy_below=True, balance=0.333)
    for rules in (Rules(heavy_below=True), third):
        (packed,) = solved(job, rules).bins
        low = {item.weight: [] for item in job.items}
        for item, corner, _ in boxes(job, packed):
            low[item.weight].append(corner[2])
        assert max(low[25.0]) <= min(low[2.0])
    narrow = replace(job, bins=(BinType((400.0, 300.0, 1600.0)),))
    (packed,) = solved(narrow, third).bins
    assert [item.weight for item, *_ in boxes(narrow, packed)] == [25.0] * 4 + [2.0] * 4


def test_the_first_stop_is_at_the_door():
    first, second = (
        ItemType((600.0, 400.0, 400.0), 6, limits=ItemLimits(stop=stop)) for stop in (1, 2)
    )
    job = Job((first, second), (BinType((2400.0, 800.0, 800.0)),))
    for rules in (Rules(door="x"), Rules(door="x", stability="centre")):
        (packed,) = solved(job, rules).bins
        ends = {1: [], 2: []}
        for item, low, high in boxes(job, packed):
            ends[item.limits.stop].append((low[0], high[0]))
        assert max(end for _, end in ends[2]) == 1200 or len(packed.placements) == 12


def test_a_layer_is_as_low_as_it_can_be():
    carton = ItemType((400.0, 300.0, 200.0), 8, orientations=UPRIGHT)
    job = Job((carton,), (BinType((1200.0, 800.0, 2000.0), copies=1),), objective="height")
    for rules in (Rules(), Rules(stability="centre"), Rules(heavy_below=True)):
        (packed,) = solved(job, rules).bins
        assert packed.height == 200


@pytest.mark.parametrize(("width", "sheets"), [(1630.0, [6]), (1629.0, [3, 3])])
def test_the_saw_takes_its_part(width, sheets):
    part = ItemType((814.0, 1.0, 465.0), 6)
    job = Job((part,), (BinType((width, 1.0, 1399.0)),), 2)
    assert loads(solved(job, Rules(gap=2.0))) == sheets


@pytest.mark.parametrize(("overhang", "most"), [(20.0, 8), (0.0, 7)])
def test_cartons_reach_over_the_edge(overhang, most):
    carton = ItemType((410.0, 310.0, 200.0), 8, orientations=UPRIGHT)
    job = Job((carton,), (BinType((1200.0, 800.0, 200.0)),))
    plan = solved(job, Rules(overhang=overhang))
    assert (loads(plan)[-1] == 8) == (most == 8)


def test_no_more_items_than_a_bin_takes():
    kind = BinType((10.0, 10.0, 10.0), limits=BinLimits(most_items=3))
    assert loads(solved(Job((ItemType((1.0, 1.0, 1.0), 10),), (kind,)))) == [1, 3, 3, 3]


def test_dangerous_goods_apart():
    acid = ItemType((1.0, 1.0, 1.0), 2, limits=ItemLimits(apart="acid"))
    plan = solved(Job((acid, ItemType((1.0, 1.0, 1.0), 6)), (BinType((2.0, 2.0, 2.0)),)))
    assert len(plan.bins) == 2
    assert all(sum(put.item == 0 for put in packed.placements) == 1 for packed in plan.bins)


def test_at_most_two_on_top_of_each_other():
    keg = ItemType((1.0, 1.0, 1.0), 8, limits=ItemLimits(most_in_stack=2))
    plan = solved(Job((keg,), (BinType((2.0, 2.0, 9.0)),)))
    assert loads(plan) == [8]
    assert max(put.corner[2] for put in plan.bins[0].placements) == 1


def test_motors_stand_on_the_floor():
    motor = ItemType((1.0, 1.0, 2.0), 3, limits=ItemLimits(floor=True))
    plan = solved(Job((ItemType((1.0, 1.0, 1.0), 8), motor), (BinType((2.0, 2.0, 4.0)),)))
    for packed in plan.bins:
        assert all(put.corner[2] == 0 for put in packed.placements if put.item == 1)
    assert len(plan.bins) == 1


@pytest.mark.long
def test_many_orders_that_ask():
    def order(n):
        box = ItemType((1.0, 1.0, 1.0), 4 + n % 7, 5.0, limits=ItemLimits(weight_above=5.0))
        glass = ItemType((2.0, 1.0, 1.0), n % 4, limits=ItemLimits(stackable=False))
        return Job((box, glass), (BinType((2.0, 2.0, 3.0)),), name=f"order {n}")

    jobs = [order(n) for n in range(60)]
    how = SolveOptions(packings=8)
    for job, one in zip(jobs, pack_wave(jobs, how), strict=True):
        assert not broken(job, one.plan, Rules())
        assert not one.plan.left_out
        assert one.bins == solve_job(job, how).bins


def test_a_table_of_orders_that_ask():
    items = {
        "ORDER": ["a", "a", "b"], "X": [4, 4, 4], "Y": [3, 3, 3], "Z": [3, 1, 1],
        "COPIES": [1, 1, 2], "WEIGHT": [2, 25, 25], "STACKABLE": [0, 1, 1],
    }  # fmt: skip
    bins = {"X": [4], "Y": [3], "Z": [4]}
    found, _ = jaxpack.solve_many(items, bins, packings=8, workers=1, heavy_below=False)
    assert len(set(zip(found["ORDER"], found["BIN"], strict=True))) == 2
    where = sorted(zip(found["ORDER"], found["Z"], found["ITEM"], strict=True))
    assert where == [("a", 0, 1), ("a", 1, 0), ("b", 0, 0), ("b", 1, 0)]
