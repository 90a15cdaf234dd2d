"""The independent check: it accepts what the rules allow and names what they do not."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
from cases import packer, random_cases
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxpack.model.packing_check import InvalidPackingError, check_packings, violations
from jaxpack.model.problem import Instance, Packing, Problem

# One packing by hand, bin 5 x 1 x 6, drawn with x to the right and z upwards:
#
#   bin 0   z=2  2 2 2 2 .    item 0: 2 x 2 at (0, 0)    item 2: 4 x 1 at (0, 2)
#           z=1  0 0 1 1 .    item 1: 2 x 2 at (2, 0)    item 3: 3 x 5 at (0, 0) of bin 1
#           z=0  0 0 1 1 .    item 4: padding            packed in the order 0 1 2 3
PROBLEM = Problem(bin=(5, 1, 6), support=0.5, inclusive=True)
INSTANCE = Instance(
    size=np.array([[2, 1, 2], [2, 1, 2], [4, 1, 1], [3, 1, 5], [1, 1, 1]]),
    mask=np.array([True, True, True, True, False]),
    bin=np.array(PROBLEM.bin),
)
ORDER = np.array([0, 1, 2, 3, 4])
PLACES = [(0, 0, 0, 0), (0, 2, 0, 0), (0, 0, 0, 2), (1, 0, 0, 0), (-1, 0, 0, 0)]


def packing_of(places):
    """A packing from (bin, x, y, z) of every item."""
    table = np.array(places)
    empty = np.zeros(len(table), int)
    return Packing(table[:, 0], table[:, 1:], volume=empty, top=empty, shadow=empty)


def found(places=PLACES, problem=PROBLEM, instance=INSTANCE, order=ORDER):
    return list(violations(problem, instance, np.array(order), packing_of(places)))


def moved(item, *place):
    return [place if index == item else old for index, old in enumerate(PLACES)]


def test_the_packing_by_hand_is_valid():
    assert found() == []
    check_packings(PROBLEM, INSTANCE, ORDER, packing_of(PLACES), "by hand")


@pytest.mark.parametrize(
    ("change", "places", "expected"),
    [
        (
            "item 0 one cell sideways, into item 1",
            moved(0, 0, 1, 0, 0),
            ["instance 0 item 0: overlaps", "instance 0 item 1: overlaps"],
        ),
        ("item 2 lifted one cell", moved(2, 0, 0, 0, 3), ["instance 0 item 2: not supported"]),
        (
            "item 2 sunk one cell",
            moved(2, 0, 0, 0, 1),
            ["instance 0 item 2: overlaps", "instance 0 item 2: not reachable"],
        ),
        ("item 0 sunk one cell", moved(0, 0, 0, 0, -1), ["instance 0 item 0: outside the bin"]),
        (
            "items 0 and 2 in each other's place",
            [PLACES[2], PLACES[1], PLACES[0], PLACES[3], PLACES[4]],
            ["instance 0 item 1: overlaps", "instance 0 item 2: overlaps"],
        ),
        ("item 1 left out", moved(1, -1, 0, 0, 0), ["instance 0 item 1: not packed"]),
        ("item 3 past the end", moved(3, 1, 3, 0, 0), ["instance 0 item 3: outside the bin"]),
        ("item 3 before the start", moved(3, 1, -1, 0, 0), ["instance 0 item 3: outside the bin"]),
        ("item 3 beside the bin", moved(3, 1, 0, 1, 0), ["instance 0 item 3: outside the bin"]),
        ("item 3 out at the top", moved(3, 0, 0, 0, 3), ["instance 0 item 3: outside the bin"]),
        ("padding packed", moved(4, 0, 4, 0, 0), ["instance 0 item 4: padding was packed"]),
        ("bin 1 skipped", moved(3, 2, 0, 0, 0), ["instance 0: bins are not numbered"]),
        ("bin 5 of 5 slots", moved(3, 5, 0, 0, 0), ["instance 0 item 3: bin number out of range"]),
    ],
)
def test_a_changed_place_is_reported(change, places, expected):
    reports = found(places)
    for beginning in expected:
        assert any(line.startswith(beginning) for line in reports), (change, reports)
    with pytest.raises(InvalidPackingError, match=r"a label packed against the rules: instance 0"):
        check_packings(PROBLEM, INSTANCE, ORDER, packing_of(places), "a label")


def test_items_that_nothing_was_done_to_are_not_blamed():
    assert found(moved(2, 0, 0, 0, 3)) == ["instance 0 item 2: not supported"]
    assert found(moved(1, -1, 0, 0, 0)) == ["instance 0 item 1: not packed"]  # half of 2 is enough


def test_an_item_has_to_be_reachable_from_above_at_its_turn():
    # Item 2 first: then item 0 and item 1 would have to be pushed in under it, and item 2 would
    # have floated over nothing.
    reports = found(order=[2, 0, 1, 3, 4])
    assert "instance 0 item 0: not reachable from above" in reports
    assert "instance 0 item 1: not reachable from above" in reports
    assert "instance 0 item 2: not supported" in reports
    # Item 1 only: item 2 has half of its base at its turn, which is enough here.
    assert found(order=[0, 2, 1, 3, 4]) == ["instance 0 item 1: not reachable from above"]
    # Bins do not stand in each other's way.
    assert found(order=[3, 1, 4, 0, 2]) == []


def test_the_order_is_a_permutation():
    assert "instance 0: the order is not a permutation of the items" in found(order=[0, 1, 2, 2, 4])
    assert "instance 0: the order is not a permutation of the items" in found(order=[1, 2, 3, 4, 5])


@pytest.mark.parametrize(
    ("support", "inclusive", "valid"),
    # 4 x 1 on top of 2 x 2 with nothing beside it: exactly half of the base is supported. The
    # floor supports the whole base of what stands on it.
    [
        (0.0, True, True),
        (0.4, True, True),
        (0.5, True, True),
        (0.5, False, False),
        (0.6, True, False),
        (1.0, True, False),
    ],
)
def test_exactly_half_supported(support, inclusive, valid):
    problem = replace(PROBLEM, support=support, inclusive=inclusive)
    instance = Instance(np.array([[2, 1, 2], [4, 1, 1]]), np.array([True, True]), INSTANCE.bin)
    reports = found([(0, 0, 0, 0), (0, 0, 0, 2)], problem, instance, [0, 1])
    assert reports == ([] if valid else ["instance 0 item 1: not supported"])


def test_the_floor_counts_only_at_height_zero_and_tops_only_at_the_items_own():
    # 3 x 1 over towers of 2 and 1: it rests on the tower of 2, one cell of three.
    instance = Instance(
        np.array([[1, 1, 2], [1, 1, 1], [3, 1, 1]]), np.array([True] * 3), INSTANCE.bin
    )
    places = [(0, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0, 2)]
    assert found(places, PROBLEM, instance, [0, 1, 2]) == ["instance 0 item 2: not supported"]
    third = replace(PROBLEM, support=1 / 3)
    assert found(places, third, instance, [0, 1, 2]) == []
    # With no support asked for at all it still has to touch something.
    none = replace(PROBLEM, support=0.0)
    assert found([*places[:2], (0, 0, 0, 3)], none, instance, [0, 1, 2]) == [
        "instance 0 item 2: not supported"
    ]


def test_the_instances_bin_counts_and_not_the_problems():
    assert found(instance=INSTANCE._replace(bin=np.array([3, 1, 6]))) == [
        "instance 0 item 1: outside the bin",
        "instance 0 item 2: outside the bin",
    ]


def test_a_batch_names_the_instance():
    # 300 copies, more than are compared at a time, with one broken near the end.
    size, mask, room = (np.stack([leaf] * 300) for leaf in INSTANCE[:3])
    orders = np.stack([ORDER] * 300)
    packings = Packing(*(np.stack([leaf] * 300) for leaf in packing_of(PLACES)))
    instances = Instance(size, mask, room)
    assert list(violations(PROBLEM, instances, orders, packings)) == []
    packings.position[270, 2, 2] += 1
    assert list(violations(PROBLEM, instances, orders, packings)) == [
        "instance 270 item 2: not supported"
    ]
    with pytest.raises(InvalidPackingError, match=r"random packed .* instance 270 item 2: not sup"):
        check_packings(PROBLEM, instances, orders, packings, "random")


@pytest.mark.parametrize(("support", "inclusive"), [((1, 2), True), ((1, 2), False)])
def test_packings_of_random_instances_are_valid_until_an_item_moves_up_or_down(support, inclusive):
    problem = Problem((6, 4, 7), None, support[0] / support[1], inclusive)
    instances, orders = random_cases(problem, seed=21, count=200, items=10, oversize=0)
    packings = packer(problem)(instances, orders)
    check_packings(problem, instances, orders, packings)
    bins, corners = np.asarray(packings.bin), np.asarray(packings.position)
    for item in range(10):
        for step in (-1, 1):
            # One cell up an item floats, or leaves the bin; one down it is inside another or
            # under the floor. Nothing else can be true of it.
            shifted = corners.copy()
            shifted[:, item, 2] += step
            lines = list(
                violations(problem, instances, orders, packings._replace(position=shifted))
            )
            for case in np.argwhere(bins[:, item] >= 0)[:, 0]:
                place = f"instance {case} item {item}: "
                assert any(line.startswith(place) for line in lines), (place, step)


@st.composite
def instances_2d_and_3d(draw):
    """(bin, sizes, order): up to seven items that fit the bin."""
    bin = draw(st.tuples(st.integers(1, 5), st.integers(1, 3), st.integers(1, 5)))
    sides = st.tuples(*(st.integers(1, side) for side in bin))
    sizes = draw(st.lists(sides, min_size=1, max_size=7))
    return bin, sizes, draw(st.permutations(range(len(sizes))))


@settings(max_examples=200, deadline=None)
@given(
    instances_2d_and_3d(),
    st.sampled_from([(0, 1), (3, 10), (1, 2), (3, 4), (1, 1)]),
    st.booleans(),
)
def test_the_oracles_packings_are_valid(case, support, inclusive):
    bin, sizes, order = case
    inclusive = inclusive or support == (1, 1)  # more than all of the base: nothing would fit
    bins, positions = oracle.pack(bin, sizes, order, support, inclusive)
    problem = Problem(bin, support=support[0] / support[1], inclusive=inclusive)
    instance = Instance(np.array(sizes), np.ones(len(sizes), bool), np.array(bin))
    places = [(number, *corner) for number, corner in zip(bins, positions, strict=True)]
    assert found(places, problem, instance, order) == []
