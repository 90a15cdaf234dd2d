"""Columns mean what they say: a near miss is an error, what is not obeyed is never silent."""

import math

import numpy as np
import pytest
from job_files import BINS_2D, BINS_3D, assert_refused, notes_of, read

from jaxpack.io.jobs import job_from_columns, read_job
from jaxpack.model.job import FLAT_TURNED

ITEMS = "X,Y,Z\n3,4,5\n"

NEAR = [  # in the items, what is meant
    *((name, "COPIES") for name in ("QTY", "Quantity", "COUNT", "PCS", "COPPIES", "COPY")),
    *(
        (name, "COPIES")
        for name in ("Quanity", "QTYS", "COPYS", "Qty (pcs)", "NUM_COPIES", "PIECE")
    ),
    *((name, "COPIES") for name in ("ORDER QTY", "No. of pieces")),
    *((name, "WEIGHT") for name in ("WEIGHT_KG", "Weight (kg)", "WEIGTH", "MASS", "WIEGHT")),
    *((name, "WEIGHT") for name in ("GROSS_WEIGHT", "Item weight [lbs]")),
]
NEAR_BINS = [
    *((name, "MAXIMUM_WEIGHT") for name in ("MAX_WEIGHT", "Max weight", "MAX_WEIGHT_KG", "WEIGHT")),
    *((name, "MAXIMUM_WEIGHT") for name in ("MAXIMUM WEIGHT", "MAXIMUM_WEIGTH", "PAYLOAD")),
    *((name, "MAXIMUM_WEIGHT") for name in ("MAX_PAYLOAD", "LOAD", "Maximum load (t)", "CAPACTIY")),
    *((name, "COPIES") for name in ("STOCK", "QTY", "AVAILABLE")),
    *((name, "COST") for name in ("PRICE", "COSTS", "PRICES", "Cost (EUR)", "FREIGHT_COST")),
]


@pytest.mark.parametrize(("name", "meant"), NEAR)
def test_a_near_miss_of_a_column_of_items_names_the_right_one(tmp_path, name, meant):
    items = f"X,Y,Z,{name}\n3,4,5,6\n"
    what = f"row 1: column {name.upper()} is not known; is {meant} meant?"
    assert_refused(lambda: read(tmp_path, items, BINS_3D), "items.csv: ", what, "--ignore")
    (job,) = read(tmp_path, items, BINS_3D, ignore=[name.lower()])
    assert (job.items[0].copies, job.items[0].weight) == (1, 0)


@pytest.mark.parametrize(("name", "meant"), NEAR_BINS)
def test_a_near_miss_of_a_column_of_bins_names_the_right_one(tmp_path, name, meant):
    bins = f"X,Y,Z,{name}\n9,9,9,6\n"
    what = f"row 1: column {name.upper()} is not known; is {meant} meant?"
    assert_refused(lambda: read(tmp_path, ITEMS, bins), "bins.csv: ", what)
    (job,) = read(tmp_path, ITEMS, bins, ignore=[name])
    kind = job.bins[0]
    assert (kind.cost, kind.copies, kind.max_weight) == (None, None, math.inf)


def test_another_word_beside_the_right_column_is_a_column_of_its_own(tmp_path):
    items = "X,Y,Z,COPIES,QTY\n3,4,5,2,7\n"
    job, notes = notes_of(tmp_path, items, BINS_3D)
    assert job.items[0].copies == 2
    assert notes == [f"{tmp_path / 'items.csv'}: columns not used: QTY"]


@pytest.mark.parametrize("name", ["COUNTRY", "UNIT", "ORDER NUMBER", "COLOUR", "ARTICLE", "VALUE"])
def test_another_word_is_no_near_miss(tmp_path, name):
    _, notes = notes_of(tmp_path, f"X,Y,Z,{name}\n3,4,5,6\n", BINS_3D)
    assert notes == [f"{tmp_path / 'items.csv'}: columns not used: {name}"]


OF_ITEMS = {  # PackingSolver's columns: what asks for nothing, and what asks for something
    "NESTING_HEIGHT": ("0", "2"),
    "GROUP_ID": ("0", "1"),
    "PROFIT": ("60", "7"),
    "COPIES_MIN": ("1", "0"),
    "FRAGILE": ("0", "1"),
    "NO_STACK": ("FALSE", "TRUE"),
}
SAID_WITH = {"GROUP_ID": "STOP", "FRAGILE": "STACKABLE 0", "NO_STACK": "STACKABLE 0"}
OF_BINS = {
    "COPIES_MIN": ("0", "1"),
    "MAXIMUM_STACK_DENSITY": ("1.79769e+308", "10"),
    "TRACTOR_WEIGHT": ("0", "7000"),
    "REAR_AXLE_MAXIMUM_WEIGHT": ("inf", "9000"),
}


@pytest.mark.parametrize("name", OF_ITEMS)
def test_what_is_not_obeyed_of_items_is_refused(tmp_path, name):
    nothing, something = (f"X,Y,Z,{name}\n3,4,5,{value}\n" for value in OF_ITEMS[name])
    instead = f"say it with {SAID_WITH[name]}, or " if name in SAID_WITH else ""
    what = f"items.csv: row 2, column {name}: is not obeyed here: {instead}plan without it with"
    assert_refused(lambda: read(tmp_path, something, BINS_3D), what)
    assert read(tmp_path, something, BINS_3D, ignore=[name]) == read(tmp_path, ITEMS, BINS_3D)
    assert notes_of(tmp_path, nothing, BINS_3D)[1] == []


@pytest.mark.parametrize("name", OF_BINS)
def test_what_is_not_obeyed_of_bins_is_refused(tmp_path, name):
    nothing, something = (f"X,Y,Z,{name}\n9,9,9,{value}\n" for value in OF_BINS[name])
    what = f"bins.csv: row 2, column {name}: is not obeyed here"
    assert_refused(lambda: read(tmp_path, ITEMS, something), what)
    assert read(tmp_path, ITEMS, something, ignore=[name]) == read(tmp_path, ITEMS, nothing)


def test_unknown_columns_are_named_in_one_line(tmp_path):
    names = [f"NOTE {number}" for number in range(12)]
    items = f"X,Y,Z,{','.join(names)}\n3,4,5{',x' * 12}\n"
    _, notes = notes_of(tmp_path, items, BINS_3D)
    assert notes == [
        f"{tmp_path / 'items.csv'}: columns not used: {', '.join(names[:9])} and 3 more"
    ]
    assert notes_of(tmp_path, items, BINS_3D, ignore=names)[1] == []


def test_a_column_that_is_ignored_has_to_be_there(tmp_path):
    what = "--ignore 'COLOR': there is no such column: there are X, Y, Z"
    assert_refused(lambda: read(tmp_path, ITEMS, BINS_3D, ignore=["color"]), what)
    assert_refused(lambda: read(tmp_path, "1\n9 9\n1 1 1\n", name="a.ins2D", ignore=["X"]), "'X'")


def test_turning_is_said_as_the_dimension_has_it(tmp_path):
    for items, bins, what in (
        ("X,Y,Z,ORIENTED\n3,4,5,0\n", BINS_3D, "column ORIENTED is not known in 3D: use ROTATION_"),
        ("WIDTH,HEIGHT,ROTATION_YXZ\n3,4,1\n", BINS_2D, "ROTATION_YXZ is not known in 2D: use ORI"),
        (
            "X,Y,Z,ROTATION_XYY\n3,4,5,1\n",
            BINS_3D,
            "column ROTATION_XYY is not known: use ROTATION",
        ),
        ("X,Y,Z,Can rotate\n3,4,5,1\n", BINS_3D, "column CAN ROTATE is not known: use ROTATION"),
    ):
        assert_refused(lambda items=items, bins=bins: read(tmp_path, items, bins), what)


CALLED = [  # how the sides are called -> where the sides 3, 4, 5 are
    ("Length (mm),Width (mm),Height (mm)", (3, 4, 5)),
    ("HEIGHT[mm],LENGTH[mm],WIDTH[mm]", (4, 5, 3)),
    ("length_mm,width_mm,height_mm", (3, 4, 5)),
    ("Length mm,Width mm,Height mm", (3, 4, 5)),
    ("length/mm,width/mm,height/mm", (3, 4, 5)),
    ("LENGTH,WIDTH,HEIGHT", (3, 4, 5)),
    ("Width,Depth,Height", (3, 4, 5)),
    ("Depth,Length,Height", (4, 3, 5)),
    ("X (mm),Y (mm),Z (mm)", (3, 4, 5)),
]


@pytest.mark.parametrize(("header", "size"), CALLED)
def test_lengths_widths_and_heights_are_understood(tmp_path, header, size):
    job, notes = notes_of(tmp_path, f"{header}\n3,4,5\n", BINS_3D)
    assert (job.dimension, job.items[0].size) == (3, size)
    told = ", ".join(
        f"{header.split(',')[value - 3].upper()} as {side}"
        for side, value in zip("XYZ", size, strict=True)
    )
    assert notes[0] == f"{tmp_path / 'items.csv'}: read {told}"


def test_width_and_height_alone_are_2d_with_a_unit_too(tmp_path):
    job, notes = notes_of(
        tmp_path, "Width (cm),Height (cm)\n3,4\n", "Width (cm),Height (cm)\n9,9\n"
    )
    assert (job.dimension, job.items[0].size) == (2, (3, 1, 4))
    assert "read WIDTH (CM) as WIDTH, HEIGHT (CM) as HEIGHT" in notes[0]


@pytest.mark.parametrize(
    ("items", "bins", "size", "factor"),
    [
        ("mm", "cm", 1000, "10"),
        ("cm", "mm", 10, "0.1"),
        ("mm", "m", 100_000, "1000"),
        ("mm", "in", 2540, "25.4"),
        ("inches", "IN", 100, None),
    ],
)
def test_bins_are_converted_to_the_unit_of_the_items(tmp_path, items, bins, size, factor):
    header = "LENGTH (u),WIDTH (u),HEIGHT (u)"
    job, notes = notes_of(
        tmp_path,
        f"{header.replace('u', items)}\n3,4,5\n",
        f"{header.replace('u', bins)}\n100,100,100\n",
    )
    assert job.bins[0].size == (size, size, size)
    converted = [line for line in notes if "lengths in" in line]
    assert [line.rpartition("times ")[2] for line in converted] == ([factor] if factor else [])


def test_units_that_do_not_agree(tmp_path):
    solid = "LENGTH (mm),WIDTH (mm),HEIGHT (mm)\n3,4,5\n"
    _, notes = notes_of(tmp_path, solid, BINS_3D)
    assert "bins.csv: lengths are taken to be in MM too" in notes[1]
    _, notes = notes_of(tmp_path, ITEMS, solid.replace("3,4,5", "9,9,9"))
    assert "items.csv: lengths are taken to be in MM too" in notes[1]
    mixed = "LENGTH (mm),WIDTH (cm),HEIGHT (mm)\n3,4,5\n"
    assert_refused(lambda: read(tmp_path, mixed, BINS_3D), "items.csv: row 1", "sides in one unit")
    twice = "LENGTH,LENGTH (mm),WIDTH,HEIGHT\n3,3,4,5\n"
    assert_refused(lambda: read(tmp_path, twice, BINS_3D), "LENGTH and LENGTH (MM): keep one")
    other = "WIDTH,DEPTH,HEIGHT\n9,9,9\n"
    assert_refused(lambda: read(tmp_path, solid, other), "bins.csv: row 1: sides WIDTH, DEPTH, HEI")


def test_the_bins_are_where_they_are_in_their_file(tmp_path):
    (job,) = read(tmp_path, ITEMS, "X,Y,Z\n9,9,9\n\n8,8,8\n")
    assert [kind.where for kind in job.bins] == ["row 2 of bins.csv", "row 4 of bins.csv"]
    assert job.items[0].where == "row 2"


class NAType:
    """As a data frame's NA: neither equal nor unequal to anything."""

    def __ne__(self, other):
        return self

    def __bool__(self):
        raise TypeError("boolean value of NA is ambiguous")


EMPTY = [None, math.nan, "", " ", np.float32("nan"), NAType(), np.datetime64("NaT", "D")]


@pytest.mark.parametrize("empty", EMPTY)
def test_empty_cells_mean_the_default(empty):
    solid = {"X": [3], "Y": [4], "Z": [5]}
    items = solid | {"COPIES": [empty], "WEIGHT": [empty], "ROTATION_YXZ": [empty], "ID": [empty]}
    bins = {"X": [9], "Y": [9], "Z": [9], "COST": [empty], "COPIES": [empty]}
    job = job_from_columns(items, bins | {"MAXIMUM_WEIGHT": [empty]})
    assert job == job_from_columns(solid, {name: bins[name] for name in "XYZ"})
    flat = {"WIDTH": [3], "HEIGHT": [4], "ORIENTED": [empty]}
    assert job_from_columns(flat, {"WIDTH": [9], "HEIGHT": [9]}).items[0].orientations == ("XYZ",)


@pytest.mark.parametrize("dtype", [np.int8, np.uint16, np.int64, np.float32, np.float64, object])
def test_columns_of_any_type_are_the_same_numbers(dtype):
    items = {name: np.array([3, 4], dtype) for name in "XYZ"} | {"COPIES": np.array([2, 0], dtype)}
    bins = {name: np.array([9], dtype) for name in ("X", "Y", "Z", "MAXIMUM_WEIGHT")}
    job = job_from_columns(items, bins)
    assert [item.size for item in job.items] == [(3, 3, 3), (4, 4, 4)]
    assert [item.copies for item in job.items] == [2, 0]
    assert job.bins[0].max_weight == 9


def test_a_short_float_is_its_own_decimals():
    items = {name: np.array([0.1], np.float32) for name in "XYZ"}
    assert job_from_columns(items, {"X": [1], "Y": [1], "Z": [1]}).items[0].size == (0.1, 0.1, 0.1)


@pytest.mark.parametrize(
    "no_limit", [math.inf, np.float32("inf"), "inf", "Infinity", "∞", -1, "-1"]
)
def test_bins_without_a_limit(no_limit):
    bins = {"X": [9], "Y": [9], "Z": [9], "COPIES": [no_limit], "MAXIMUM_WEIGHT": [no_limit]}
    (kind,) = job_from_columns({"X": [1], "Y": [1], "Z": [1]}, bins).bins
    assert (kind.copies, kind.max_weight) == (None, math.inf)


def test_no_copies_of_a_bin_are_none_of_it(tmp_path):
    (job,) = read(tmp_path, ITEMS, "X,Y,Z,COPIES\n9,9,9,0\n8,8,8,\n")
    assert [kind.copies for kind in job.bins] == [0, None]


def test_truth_as_spreadsheets_write_it(tmp_path):
    items = "WIDTH,HEIGHT,ORIENTED\n3,4,TRUE\n3,4,false\n3,4,\n3,4,0.0\n"
    (job,) = read(tmp_path, items, BINS_2D)
    ways = [("XYZ",), FLAT_TURNED, ("XYZ",), FLAT_TURNED]
    assert [item.orientations for item in job.items] == ways


def test_what_says_neither_is_refused_with_what_does(tmp_path):
    items = "WIDTH,HEIGHT,ORIENTED\n3,4,{}\n"
    for value in ("WAHR", "2", "0.5"):
        what = f"row 2, column ORIENTED: '{value}' says neither yes nor no: give 1 or 0"
        assert_refused(lambda cell=value: read(tmp_path, items.format(cell), BINS_2D), what)


def test_a_path_given_as_columns_is_no_table():
    assert_refused(lambda: job_from_columns([1], {"X": [1]}), "items: [1] is not a table")
    assert read_job.__doc__
