"""Hints say what would help, and nothing where there is nothing to say."""

import pytest

from jaxpack.model.hints import scale_hint, unfit_hint, unfit_message
from jaxpack.model.job import ORIENTATIONS, BinType, ItemType, Job


def job(size, *bins, weight=0.0, ways=("XYZ",), copies=1, dimension=3):
    items = (ItemType(size, copies, weight, ways),)
    return Job(items, tuple(BinType(*bin) for bin in bins), dimension)


@pytest.mark.parametrize(
    ("case", "hint"),
    [
        (job((800, 1200, 100), ((1200, 800, 1500),)), "would fit turned: allow ROTATION_YXZ"),
        (job((10, 10, 30), ((40, 10, 10),)), "would fit turned: allow ROTATION_ZYX"),
        (job((3, 1, 9), ((9, 1, 3),), dimension=2), "would fit turned: allow that with ORIENTED 0"),
        (job((9, 9, 9), ((8, 20, 20),), ways=tuple(ORIENTATIONS)), "give a larger bin"),
        (job((5, 5, 5), ((9, 9, 9), None, None, 2), weight=3.0), "higher MAXIMUM_WEIGHT"),
        (
            job(
                (5, 9, 5), ((5, 5, 5),), ((9, 5, 9), None, 0), ((9, 5, 9), None, None, 2), weight=3
            ),
            "give a larger bin",  # turned it would be too heavy
        ),
        (job((5, 5, 5), ((9, 9, 9), None, 0)), "the COPIES of all are 0"),
    ],
)
def test_what_would_make_an_item_fit(case, hint):
    assert hint in unfit_hint(case, 0)


@pytest.mark.parametrize(
    ("case", "hint"),
    [
        (
            job((400, 300, 200), ((120, 80, 160),)),
            "10 times smaller: are they in mm and the bins in cm",
        ),
        (
            job((2540, 254, 254), ((100, 10, 10),)),
            "25.4 times smaller: are they in mm and the bins in inc",
        ),
        (
            job((300, 250, 200), ((12, 2.4, 2.6),)),
            "100 times smaller: are they in cm and the bins in m?",
        ),
        (
            job((4000, 300, 200), ((12, 2.4, 2.6),)),
            "1000 times smaller: are they in mm and the bins in m",
        ),
        (
            job((40, 30, 20), ((1200, 800, 1600),), copies=100),
            "0.16 % of a bin: are they in cm and the bins in mm?",
        ),
        (
            job((0.6, 0.4, 0.3), ((1200, 800, 1600),), copies=100),
            "4.7e-07 % of a bin: are they in m and the bins in mm?",
        ),
    ],
)
def test_another_unit(case, hint):
    assert hint in scale_hint(case)


@pytest.mark.parametrize(
    "case",
    [
        job((40, 30, 20), ((120, 80, 160),)),
        job((9e8, 9e8, 9e8), ((1, 1, 1),)),
        job((40, 30, 20), ((1200, 800, 1600),), copies=1000),  # 1.6 % of it
        job((600, 1, 1), ((1200, 800, 1600),)),  # ten times as long it does not fit
        job((3, 1, 9), ((9, 1, 3),), dimension=2),
    ],
)
def test_no_hint_where_nothing_hints_at_it(case):
    assert scale_hint(case) is None


def test_no_hint_where_some_items_fit():
    items = (ItemType((40, 30, 20)), ItemType((400, 300, 200)))
    assert scale_hint(Job(items, (BinType((120, 80, 160)),))) is None


def test_the_line_about_an_item_that_fits_nowhere_is_a_sentence():
    scaled = job((400, 300, 200), ((120, 80, 160),))
    large = Job((ItemType((9, 9, 9)), ItemType((1, 1, 1))), (BinType((8, 20, 20)),))
    leave = "leave such items out with --skip-unfit"
    assert unfit_message(scaled, [0], False).endswith(f"in cm? Or {leave}")
    assert unfit_message(large, [0], False).endswith(f"give a larger bin; or {leave}")
    assert unfit_message(scaled, [0], True).endswith("in cm?")
    flat = job((800, 1, 1200), ((1200, 1, 800),), dimension=2)
    assert "no bin can hold 800 x 1200 in an" in unfit_message(flat, [0], True)
    fine = job((1234567.25, 57.45, 0.1 + 0.2), ((1234567, 100, 100),))
    assert "no bin can hold 1234567.25 x 57.45 x 0.3 in" in unfit_message(fine, [0], True)
