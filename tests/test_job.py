"""A job is checked and cleaned where it is made, whoever makes it: in one line, by one code."""

import math
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

import jaxpack
from jaxpack import BinType, ItemType, Job, UserError
from jaxpack.model.exact import exact
from jaxpack.model.job import FINEST

ROOM = BinType((10, 10, 10))
CUBE = ItemType((1, 1, 1))

BAD = {
    "NaN": (ItemType((1, math.nan, 1)), ROOM, "item 0, size: nan is not a finite number"),
    "infinite": (ItemType((1, 1, math.inf)), ROOM, "item 0, size: inf is not a finite number"),
    "negative": (ItemType((-1, 1, 1)), ROOM, "item 0, size: -1 is not a size"),
    "nothing": (ItemType((0, 1, 1)), ROOM, "item 0, size: 0 is not a size"),
    "huge": (ItemType((1, 1, 1e30)), ROOM, "item 0, size: 1e+30 is out of range"),
    "a text": (ItemType(("wide", 1, 1)), ROOM, "item 0, size: 'wide' is not a number"),
    "two sides": (ItemType((1, 1)), ROOM, "item 0: size (1, 1): give three sides"),
    "no sides": (ItemType(None), ROOM, "item 0: size None: give three sides"),
    "no bool": (ItemType((True, 1, 1)), ROOM, "item 0, size: True is not a number"),
    "half a copy": (ItemType((1, 1, 1), 1.5), ROOM, "item 0, copies: 1.5 is not possible"),
    "less than none": (ItemType((1, 1, 1), -2), ROOM, "item 0, copies: -2 is not possible"),
    "no copies": (ItemType((1, 1, 1), 0), ROOM, "the job has no items: give at least one"),
    "too many": (ItemType((1, 1, 1), 200_000), ROOM, "has 200,000 items, more than 100,000"),
    "NaN weight": (ItemType((1, 1, 1), weight=math.nan), ROOM, "item 0, weight: nan is not"),
    "lighter than air": (ItemType((1, 1, 1), weight=-1), ROOM, "weight: -1 is not a weight"),
    "an unknown turn": (ItemType((1, 1, 1), orientations=("XXX",)), ROOM, "orientation 'XXX' is"),
    "no turn": (ItemType((1, 1, 1), orientations=()), ROOM, "item 0: orientations (): give a"),
    "a turn of letters": (ItemType((1, 1, 1), orientations="XYZ"), ROOM, "'XYZ': give a tuple"),
    "a name": (ItemType((1, 1, math.nan), name="jar"), ROOM, "item 0 (jar), size: nan"),
    "a number as name": (ItemType((1, 1, 1), name=3), ROOM, "item 0: name 3 is no text"),
    "a long number as name": (CUBE, BinType((9, 9, 9), name=10**5000), "name int of many digits"),
    "a long number as turn": (ItemType((1, 1, 1), orientations=(10**5000,)), ROOM, "int of many"),
    "a name of bytes": (CUBE, BinType((9, 9, 9), name=b"x"), "bin 0: name b'x' is no text"),
    "a row": (ItemType((1, 1, -3), where="row 9"), ROOM, "row 9, size: -3 is not a size"),
    "a flat bin": (CUBE, BinType((10, 10, 0)), "bin 0, size: 0 is not a size"),
    "a bin of NaN": (CUBE, BinType((math.nan, 1, 1)), "bin 0, size: nan is not a finite number"),
    "half a bin": (CUBE, BinType((9, 9, 9), copies=0.5), "bin 0, copies: 0.5 is not possible"),
    "a NaN limit": (CUBE, BinType((9, 9, 9), max_weight=math.nan), "bin 0, max_weight: nan is not"),
    "no item": ({"X": 1}, ROOM, "item 0: {'X': 1} is no ItemType"),
    "no bin": (CUBE, (9, 9, 9), "bin 0: (9, 9, 9) is no BinType"),
    "a cost": (CUBE, BinType((9, 9, 9), cost=-4), "bin 0, cost: -4 is not a cost"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_job_is_one_line(name):
    item, room, message = BAD[name]
    with pytest.raises(UserError) as refused:
        jaxpack.solve(Job((item,), (room,)))
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_there_is_something_to_pack_and_something_to_pack_it_into():
    with pytest.raises(UserError, match="the job has no items"):
        Job((), (ROOM,))
    with pytest.raises(UserError, match=r"items: ItemType.*: give a tuple of ItemType"):
        Job(CUBE, (ROOM,))
    with pytest.raises(UserError, match="bins: None: give a tuple of BinType"):
        Job((CUBE,), None)
    with pytest.raises(UserError, match="the job: name 7 is no text"):
        Job((CUBE,), (ROOM,), name=7)
    with pytest.raises(UserError, match="the job has no bins"):
        Job((CUBE,), ())
    with pytest.raises(UserError, match="dimension: 4 is not known"):
        Job((CUBE,), (ROOM,), 4)
    with pytest.raises(UserError, match="orientation 'YXZ' is not known: use XYZ, ZYX"):
        Job((ItemType((1, 1, 1), orientations=("YXZ",)),), (BinType((9, 1, 9)),), 2)


def test_any_type_of_number_is_one():
    sizes = (np.int8(3), Decimal("2.5"), Fraction(1, 2)), np.array([3, 2.5, 0.5], np.float64)
    for size in (sizes[0], tuple(sizes[1])):
        job = Job((ItemType(size, np.int64(2), np.float32(0.5)),), (BinType((9, 9, 9)),))
        assert job.items[0].size == (3.0, 2.5, 0.5)
        assert (job.items[0].copies, job.items[0].weight) == (2, 0.5)
        assert all(type(side) is float for side in job.items[0].size)


def test_lengths_are_whole_numbers_of_one_unit():
    random = np.random.default_rng(0)
    for digits in (1, 3, 6, 9, 13, 17):
        for _ in range(20):
            scale = 10.0 ** random.integers(-5, 6)
            sides = [
                [float(f"{x * scale:.{digits}g}") for x in random.uniform(1, 9, 3)] for _ in "12345"
            ]
            items, room = [ItemType(tuple(row)) for row in sides[:4]], BinType(tuple(sides[4]))
            job = Job(tuple(items), (room,))
            whole = [exact(side) / job.unit for side in job.lengths()]
            assert all(number.denominator == 1 for number in whole)
            assert max(exact(side) for side in job.bins[0].size) / job.unit <= FINEST
            for before, after in zip(sides, [*job.items, *job.bins], strict=True):
                for old, new in zip(before, after.size, strict=True):
                    assert abs(new - old) <= (job.rounded or 1e-12 * old)
                    assert new <= old * (1 + 1e-12)
            # What fitted before fits now.
            for old, new in zip(items, job.items, strict=True):
                if all(a <= b for a, b in zip(old.size, room.size, strict=True)):
                    assert all(a <= b for a, b in zip(new.size, job.bins[0].size, strict=True))
            again = Job(job.items, job.bins)
            assert (again, again.rounded) == (job, None), "a clean job stays as it is"


def test_units_up_to_the_finest_are_exact_and_noise_is_no_length():
    side = FINEST / 1000
    job = Job((ItemType((0.001, 0.003, side)),), (BinType((side, side, side)),))
    assert job.rounded is None
    assert max(exact(side) for side in job.bins[0].size) / job.unit == FINEST
    noisy = Job((ItemType((0.1 + 0.2, 0.3, 3 * 1.1)),), (BinType((0.3, 0.3 * (1 + 1e-14), 3.3)),))
    assert noisy.items[0].size == noisy.bins[0].size == (0.3, 0.3, 3.3)
    fine = Job((ItemType((1 / 3, 1 / 7, 1 / 9)),), (BinType((1, 1, 1)),))
    assert fine.rounded == 1e-9
    assert fine.items[0].size == (0.333333333, 0.142857142, 0.111111111)


def test_weights_are_whole_billionths():
    items = tuple(ItemType((1, 1, 1), weight=w) for w in (1 / 3, 1e-12, 123456789.125, 0.1 + 0.2))
    job = Job(items, (BinType((9, 9, 9), max_weight=1 / 3),))
    assert [item.weight for item in job.items] == [0.333333333, 1e-9, 123456789.125, 0.3]
    assert job.bins[0].max_weight == 0.333333333
