"""Benchmark instances and lower bounds, against published values and by hand."""

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from jaxpack.errors import UserError
from jaxpack.model.bounds import martello_bounds, volume_bound, weight_bound
from jaxpack.model.classes import Rand48, mpv
from jaxpack.model.job import ORIENTATIONS, BinType, ItemType, Job
from jaxpack.model.objectives import bounds

sys.path.insert(0, str(Path(__file__).parent.parent / "experiments"))
from public_instances import read_2bp, read_ivancic

UNIT = (BinType((10, 1, 10)),)


def flat(*sizes, bins=UNIT, **options):
    """A 2D job of items (width, height)."""
    return Job(tuple(ItemType((w, 1, h), **options) for w, h in sizes), bins, dimension=2)


def fewest(job):
    return bounds(job).bins


@pytest.mark.parametrize(
    ("seed", "first"),
    [(0, [366850414, 1610402240, 206956554]), (51, [1249289545, 1468912438, 1625849874])],
)
def test_random_numbers_are_those_of_the_c_library(seed, first):
    random = Rand48(seed)
    assert [random.next() for _ in first] == first


@pytest.mark.parametrize(
    ("kind", "side", "first"),
    [
        (1, 100, [(39, 85, 72), (11, 84, 96), (36, 10, 34)]),
        (2, 100, [(94, 25, 72), (11, 84, 96), (36, 10, 34)]),
        (3, 100, [(94, 85, 27), (11, 84, 96), (36, 10, 34)]),
        (4, 100, [(84, 65, 70), (11, 84, 96), (36, 10, 34)]),
        (5, 100, [(39, 25, 27), (11, 84, 96), (36, 10, 34)]),
        (6, 10, [(6, 9, 5), (7, 1, 1), (4, 1, 5)]),
        (7, 40, [(1, 29, 20), (7, 21, 31), (19, 31, 15)]),
        (8, 100, [(46, 39, 75), (27, 21, 61), (94, 81, 35)]),
    ],
)
def test_the_first_items_of_a_class(kind, side, first):
    """As a C program draws them with the library's own lrand48."""
    job = mpv(kind, 50, 1)
    assert [item.size for item in job.items[:3]] == first
    assert job.count == 50
    assert job.bins == (BinType((side, side, side)),)
    assert all(item.orientations == ("XYZ",) and max(item.size) <= side for item in job.items)


def test_a_class_that_does_not_exist():
    with pytest.raises(UserError, match="class 9"):
        mpv(9, 50, 1)


@pytest.mark.parametrize(
    ("kind", "published"),
    [
        (1, (96, 117, 125)),
        (2, (99, 120, 127)),
        (3, (96, 114, 123)),
        (4, (158, 287, 287)),
        (5, (61, 67, 73)),
        (6, (84, 76, 87)),
        (7, (55, 60, 63)),
        (8, (70, 75, 80)),
    ],
)
def test_the_published_bounds(kind, published):
    """L0, L1 and L2 of the ten instances with 50 items, added up."""
    jobs = [mpv(kind, 50, number) for number in range(1, 11)]
    assert np.sum(
        [(volume_bound(job), *martello_bounds(job)) for job in jobs], axis=0
    ).tolist() == list(published)
    assert sum(bounds(job).bins for job in jobs) > published[2]


@pytest.mark.parametrize(
    ("sizes", "volume", "one", "two"),
    [
        ([(6, 6)] * 3, 2, 3, 3),  # no two share a bin
        ([(5, 5)] * 4, 1, 0, 1),
        ([(10, 6)] * 2 + [(10, 4)] * 3, 3, 3, 3),  # a length each: 6 + 4, 6 + 4, 4
        ([(10, 6)] * 2 + [(10, 3)] * 6, 3, 4, 4),  # one 3 beside each 6, four left: three and one
        # Nothing else fits beside a width of 9: four of them fill two bins, and strips of width 2
        # add 102.
        ([(9, 5)] * 4 + [(2, 10)] * 5 + [(2, 1)], 3, 2, 4),
    ],
)
def test_bounds_by_hand(sizes, volume, one, two):
    job = flat(*sizes)
    assert (volume_bound(job), *martello_bounds(job)) == (volume, one, two)
    assert fewest(job) == two
    tenths = flat(*[(w / 10, h / 10) for w, h in sizes], bins=(BinType((1, 1, 1)),))
    assert fewest(tenths) == two


def formula_of_l2(size, room, axis, limits):
    """L1 and L2 of one axis as the papers write them, one p and q after the other."""
    first, second = (other for other in range(3) if other != axis)
    (w, h, d), (W, H, D) = (
        (v[..., first], v[..., second], v[..., axis]) for v in (size, np.array(room))
    )
    large, volume = (2 * w > W) & (2 * h > H), w * h * d
    deep = d[large]
    one = 0
    for p in range(1, D // 2 + 1):
        beside, small = deep[(deep <= D - p) & (2 * deep > D)], deep[(deep >= p) & (2 * deep <= D)]
        by_length = math.ceil((small.sum() - (len(beside) * D - beside.sum())) / D)
        by_number = math.ceil((len(small) - ((D - beside) // p).sum()) / (D // p))
        one = max(one, (2 * deep > D).sum() + max(by_length, by_number, 0))
    two = one
    for p in limits(w, W):
        for q in limits(h, H):
            whole = (w > W - p) & (h > H - q)
            counted = (large | ((w >= p) & (h >= q))) & ~whole
            rest = volume[counted].sum() - (D * one - d[whole].sum()) * W * H
            two = max(two, one + math.ceil(rest / (W * H * D)))
    return one, two


@pytest.mark.parametrize("halves", [False, True])
def test_the_bounds_are_the_formula(halves):
    random = np.random.default_rng(1)

    def limits(sides, full):
        return range(1, full // 2 + 1) if halves else sorted({*sides[2 * sides <= full].tolist()})

    room = (8, 12, 10)
    for _ in range(20):
        size = random.integers(1, np.array(room) + 1, (25, 3))
        job = Job(tuple(ItemType(tuple(row)) for row in size.tolist()), (BinType(room),))
        rows = [formula_of_l2(size, room, axis, limits) for axis in range(3)]
        assert martello_bounds(job, halves) == tuple(map(max, zip(*rows, strict=True)))


def test_items_that_may_be_turned():
    """Two of 6 x 2 can share a bin one way or the other; two of 6 x 6 cannot."""
    both = ("XYZ", "ZYX")
    assert fewest(flat(*[(6, 2)] * 4, orientations=both)) == 1
    assert fewest(flat(*[(6, 6)] * 4, orientations=both)) == 4
    # Of 12 x 6 only one way fits, which is above half both ways.
    high = (BinType((10, 1, 13)),)
    assert fewest(flat(*[(12, 6)] * 3, bins=high, orientations=both)) == 3


def test_weights():
    heavy = Job(
        tuple(ItemType((1, 1, 1), weight=weight) for weight in (0.6, 0.6, 0.4, 0.4, 0.4)),
        (BinType((10, 10, 10), max_weight=1.0),),
    )
    assert (volume_bound(heavy), weight_bound(heavy), fewest(heavy)) == (1, 3, 3)
    assert weight_bound(flat((1, 1), weight=5)) == 0  # no bin has a limit
    tenths = ItemType((1, 1, 1), copies=30, weight=0.1)
    assert weight_bound(Job((tenths,), (BinType((10, 10, 10), max_weight=3),))) == 1


def test_several_kinds_of_bins():
    """One bin of 100 and the rest of 25: 150 need three, and 90 of cost."""
    bins = (BinType((5, 1, 5), cost=20), BinType((10, 1, 10), cost=50, copies=1))
    job = flat(*[(5, 5)] * 6, bins=bins)
    assert fewest(job) == 3
    assert bounds(job).cost == 90
    assert bounds(flat(*[(6, 6)] * 3)).cost == 300  # three bins at their volume, though 108 to pack
    limited = (BinType((10, 1, 10), cost=1, copies=2), BinType((10, 1, 10), cost=4))
    assert bounds(flat(*[(6, 6)] * 3, bins=limited)).cost == 6


def test_an_item_that_fits_nowhere_is_not_counted():
    assert fewest(flat((11, 1), (5, 5))) == 1
    assert fewest(flat((11, 1))) == 0
    assert bounds(flat((11, 1))).cost == 0


def test_public_files_are_read(tmp_path):
    known = {"cls": 1, "n": 2, "id": 3, "bks": 1, "lb_area": 1, "lb_mv_l2": 1}
    (tmp_path / "2bp.json").write_text(
        json.dumps({"instances": [{**known, "W": 10, "H": 12, "items": [[5, 9], [4, 2]]}]})
    )
    [(job, values)] = read_2bp(tmp_path / "2bp.json")
    assert values == known
    assert [item.size for item in job.items] == [(5, 1, 9), (4, 1, 2)]
    assert (job.bins, job.dimension) == ((BinType((10, 1, 12)),), 2)

    columns = ["X", "Y", "Z", *(f"ROTATION_{name}" for name in ORIENTATIONS), "COPIES"]
    instance = {"name": "a", "bin": [9, 8, 7], "cols": columns}
    instance["items"] = [[3, 2, 1, 1, 1, 0, 0, 0, 0, 50], [4, 5, 6, 1, 1, 1, 1, 1, 1, 2]]
    (tmp_path / "3bp.json").write_text(json.dumps({"instances": [instance]}))
    [job] = read_ivancic(tmp_path / "3bp.json")
    assert job.items[0] == ItemType((3, 2, 1), copies=50, orientations=("XYZ", "YXZ"))
    assert job.items[1].orientations == tuple(ORIENTATIONS)
    assert (job.bins, job.name) == ((BinType((9, 8, 7)),), "a")
