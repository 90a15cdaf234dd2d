"""Jobs from files: what the formats say comes in, what is wrong is said in one line."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from job_files import (
    BINS_2D,
    BINS_3D,
    FLAT_JOB,
    INS2D,
    ITEMS_2D,
    ITEMS_3D,
    ORDERS,
    SOLID_JOB,
    assert_refused,
    file_with,
    read,
)

from jaxpack.io.jobs import job_from_columns, read_job
from jaxpack.model.job import BinType, ItemType


def test_csv_of_2d(tmp_path):
    assert read(tmp_path, ITEMS_2D, BINS_2D) == [FLAT_JOB]


def test_csv_of_3d(tmp_path):
    assert read(tmp_path, ITEMS_3D, BINS_3D) == [SOLID_JOB]


def test_columns_in_any_order_and_case_with_others_blank_rows_quotes_and_a_mark(tmp_path):
    rows = [
        "\ufeff note, height ,copies,Id,oriented,WEIGHT,width,note",
        "",
        '"5 ""x"", big",5,2,a,1,1.5,3,',
        ",,,,,,,",
        ' "two\nlines","2",1, b ,0, 0.0 , 4.25 ,x',
        "   ",
    ]
    assert read(tmp_path, "\r\n".join(rows), BINS_2D) == [FLAT_JOB]
    assert_refused(
        lambda: read(tmp_path, "\n".join([*rows, "x,0,1,c,0,1,1,"]), BINS_2D),
        "row 8, column HEIGHT",  # as in an editor: one row goes over two lines
    )


def test_what_is_not_said_has_its_default(tmp_path):
    (job,) = read(tmp_path, "WIDTH,HEIGHT\n3,5\n", "WIDTH,HEIGHT\n10,12\n")
    assert job.items == (ItemType((3.0, 1.0, 5.0), 1, 0.0, ("XYZ",), ""),)
    assert job.bins == (BinType((10.0, 1.0, 12.0), None, None, math.inf, ""),)
    (job,) = read(tmp_path, "X,Y,Z\n3,4,5\n", "X,Y,Z\n10,12,14\n")
    assert job.items == (ItemType((3.0, 4.0, 5.0), orientations=("XYZ",)),)
    assert job.dimension == 3


def test_rotations_are_those_whose_columns_say_1(tmp_path):
    (job,) = read(tmp_path, "ROTATION_ZXY,X,ROTATION_XZY,Y,Z\n0,3,1,4,5\n1,3,1,4,5\n", BINS_3D)
    assert [set(item.orientations) for item in job.items] == [{"XZY"}, {"XZY", "ZXY"}]


def test_ins2d(tmp_path):
    (job,) = read(tmp_path, INS2D, name="cl_01.ins2D")
    assert job.items == (
        ItemType((3.0, 1.0, 5.0), 1, name="1"),
        ItemType((4.0, 1.0, 2.0), 3, name="2"),
        ItemType((1.0, 1.0, 1.0), 1, name="3"),
    )
    assert (job.bins, job.dimension, job.name) == ((BinType((10.0, 1.0, 12.0)),), 2, "cl_01")
    assert read(tmp_path, INS2D, BINS_2D, "a.ins2D")[0].bins == FLAT_JOB.bins
    (short,) = read(tmp_path, "1\r\n9 -1\r\n1 3 5\r\n", BINS_2D, "strip.ins2d")
    assert short.items == (ItemType((3.0, 1.0, 5.0), 1, name="1"),)


class Frame:
    """As much of a data frame as is used."""

    def __init__(self, columns):
        self.columns = columns

    def to_dict(self, orient):
        assert orient == "list"
        return self.columns


def forms():
    columns = {
        "id": ["a", "b"],
        "Width": [3, 4.25],
        "HEIGHT": np.array([5, 2]),
        "COPIES": [2.0, 1.0],
        "WEIGHT": ["1.5", np.float32(0)],
        "oriented": [True, False],
        "colour": [None, object()],
    }
    rows = [dict(zip(columns, cells, strict=True)) for cells in zip(*columns.values(), strict=True)]
    kinds = [("ID", "U1"), ("WIDTH", float), ("HEIGHT", int), ("COPIES", int), ("WEIGHT", float)]
    structured = np.array(
        [("a", 3, 5, 2, 1.5, 1), ("b", 4.25, 2, 1, 0, 0)], dtype=[*kinds, ("ORIENTED", bool)]
    )
    return {"dict": columns, "rows": rows, "structured": structured, "frame": Frame(columns)}


@pytest.mark.parametrize("form", ["dict", "rows", "structured", "frame"])
def test_columns_are_read_as_a_file_is(form):
    bins = {"WIDTH": [10, 6], "HEIGHT": [12, 6], "COST": [-1, 7.5], "COPIES": [-1, 3]}
    bins["MAXIMUM_WEIGHT"] = [-1, 20]
    assert job_from_columns(forms()[form], bins, "items") == FLAT_JOB


def test_names_from_columns():
    items = {"X": [1] * 4, "Y": [1] * 4, "Z": [1] * 4, "NAME": [None, math.nan, 7.0, "n"]}
    job = job_from_columns({**items, "ID": [0, 1, 2, 3]}, {"X": [9], "Y": [9], "Z": [9]})
    assert [item.name for item in job.items] == ["0", "1", "7", "n"]


SIDES = "WIDTH,HEIGHT\n"
FINE = SIDES + "3,5\n"
BAD_ITEMS = [
    ("WIDTH,HIEGHT\n3,5\n", "row 1: column HEIGHT is missing: is 'HIEGHT' meant?"),
    ("WIDHT,HIEGHT\n3,5\n", "row 1: column WIDTH is missing: is 'WIDHT' meant?"),
    ("WIDTH\n3\n", "row 1: column HEIGHT is missing"),
    ("X,Y\n3,5\n", "row 1: column Z is missing: there are X, Y"),
    ("A,B\n3,5\n", "columns WIDTH, HEIGHT (2D) or X, Y, Z (3D) are missing: there are A, B"),
    ("WIDTH,HEIGHT,X,Y,Z\n1,1,1,1,1\n", "of 2D (WIDTH, HEIGHT) and of 3D (X, Y, Z): keep either"),
    ("LENGTH,DEPTH,WIDTH,HEIGHT\n1,1,1,1\n", "row 1: LENGTH, DEPTH, WIDTH, HEIGHT: which are"),
    ("WIDTH,HEIGHT,width\n1,1,1\n", "row 1: column WIDTH is there twice"),
    (SIDES + "3,five\n", "row 2, column HEIGHT: 'five' is not a number"),
    (SIDES + "3,nan\n", "row 2, column HEIGHT: 'nan' is not a number"),
    (SIDES + "3,inf\n", "row 2, column HEIGHT: 'inf' is not a number"),
    (SIDES + "3,1e999\n", "row 2, column HEIGHT: inf is not a finite number"),
    (SIDES + "3,1_0\n", "row 2, column HEIGHT: '1_0' is not a number"),
    (SIDES + '3,"5,5,5"\n', "row 2, column HEIGHT: '5,5,5' is not a number: give one such"),
    (SIDES + "3,\n", "row 2, column HEIGHT: empty"),
    (SIDES + "3,5\n\n3, \n", "row 4, column HEIGHT: empty"),
    (SIDES + "3,-5\n", "row 2, column HEIGHT: -5 is not a size: give more than 0"),
    (SIDES + "0,5\n", "row 2, column WIDTH: 0 is not a size: give more than 0"),
    (SIDES + "2e9,5\n", "row 2, column WIDTH: 2000000000 is out of range"),
    (SIDES + "1e-300,5\n", "row 2, column WIDTH: 1e-300 is out of range"),
    (SIDES + "3\n", "row 2, column HEIGHT: empty: give a number"),
    (SIDES + "3,5\n3,5,7\n", "row 3: 3 fields, the header has 2"),
    (SIDES + '3,5\n"3,5\n4,5\n', "row 3: not CSV"),
    ("", "the file is empty"),
    (" \n\n", "the file is empty"),
    (",\n,\n", "no header"),
    (SIDES, "row 1: no items below the header"),
    (FINE.encode() + b"3,\xff\n", "row 3, column HEIGHT: 'ÿ' is not"),
    (FINE.encode() + b"3,\x81\n", "row 3: not UTF-8 text"),
    (FINE.encode("utf-16-le"), "row 1: a NUL byte"),
    (FINE.encode("utf-16")[:-1], "not UTF-8 text"),
    (FINE.encode() + b"3,\x005\n", "row 3: a NUL byte"),
    ("WIDTH,HEIGHT,COPIES\n3,5,-2\n", "row 2, column COPIES: -2 is not possible: give a whole"),
    ("WIDTH,HEIGHT,COPIES\n3,5,0\n", "row 1: all COPIES are 0: give at least one item"),
    ("WIDTH,HEIGHT,COPIES\n3,5,1.5\n", "row 2, column COPIES: 1.5 is not possible"),
    (
        "WIDTH,HEIGHT,COPIES\n3,5,1\n3,5,1000000\n",
        "row 3, column COPIES: 1000000 copies: more than 100,000 items in all",
    ),
    ("WIDTH,HEIGHT,WEIGHT\n3,5,-1\n", "row 2, column WEIGHT: -1 is not a weight"),
    ("WIDTH,HEIGHT,ORIENTED\n3,5,2\n", "row 2, column ORIENTED: '2' says neither yes nor no"),
]


@pytest.mark.parametrize(("items", "message"), BAD_ITEMS, ids=[text for _, text in BAD_ITEMS])
def test_bad_items_are_one_line_with_file_row_and_column(tmp_path, items, message):
    assert_refused(lambda: read(tmp_path, items, BINS_2D), f"{tmp_path / 'items.csv'}: ", message)


BAD_SOLID_ITEMS = [
    ("X,Y,Z,ROTATION_XYZ,ROTATION_YXZ\n1,2,3,1,0\n1,2,3,0,0\n", "row 3: columns ROTATION_XYZ, "),
    (
        "X,Y,Z,ROTATION_XYZ\n1,2,3,yes\n",
        "row 2, column ROTATION_XYZ: 'yes' says neither yes nor no",
    ),
    ("X,Y,Z,ROTATIONS\n1,2,3,63\n", "row 1: column ROTATIONS is not known: use ROTATION_XYZ"),
]


@pytest.mark.parametrize(("items", "message"), BAD_SOLID_ITEMS)
def test_bad_rotations(tmp_path, items, message):
    assert_refused(lambda: read(tmp_path, items, BINS_3D), "items.csv: ", message)


BAD_BINS = [
    (BINS_3D, "row 1: bins of 3D for items of 2D: give bins with columns WIDTH, HEIGHT"),
    (SIDES, "row 1: no bins below the header"),
    ("WIDTH\n3\n", "row 1: column HEIGHT is missing"),
    (SIDES + "3,0\n", "row 2, column HEIGHT: 0 is not a size"),
    ("WIDTH,HEIGHT,COST\n3,5,-2\n", "row 2, column COST: -2 is negative"),
    ("WIDTH,HEIGHT,COST\n3,5,x\n", "row 2, column COST: 'x' is not a number"),
    ("WIDTH,HEIGHT,COPIES\n3,5,-2\n", "row 2, column COPIES: -2 is not possible"),
    ("WIDTH,HEIGHT,COPIES\n3,5,0.5\n", "row 2, column COPIES: 0.5 is not possible"),
    ("WIDTH,HEIGHT,MAXIMUM_WEIGHT\n3,5,-9\n", "row 2, column MAXIMUM_WEIGHT: -9 is not a weight"),
]


@pytest.mark.parametrize(("bins", "message"), BAD_BINS, ids=[text for _, text in BAD_BINS])
def test_bad_bins_are_one_line_with_file_row_and_column(tmp_path, bins, message):
    assert_refused(lambda: read(tmp_path, FINE, bins), f"{tmp_path / 'bins.csv'}: ", message)


def test_bad_files(tmp_path):
    items, bins = (file_with(tmp_path, f"{n}.csv", FINE) for n in ("items", "bins"))
    folder = tmp_path / "folder.csv"
    folder.mkdir()
    assert_refused(lambda: read_job(items), "items.csv: a CSV file of items needs one of bins too")
    assert_refused(lambda: read_job(tmp_path / "no.csv", bins), "no.csv: cannot be read (No such")
    assert_refused(lambda: read_job(items, tmp_path / "no.csv"), "no.csv: cannot be read (No such")
    assert_refused(lambda: read_job(folder, bins), "folder.csv: cannot be read (Is a directory)")
    assert_refused(lambda: read_job(Path("a\0b.csv"), bins), "cannot be read (embedded null")
    assert_refused(lambda: read_job(tmp_path / "a\nb.csv", bins), "a?b.csv: cannot be read")
    assert_refused(lambda: read_job(tmp_path / "a.ods"), "files '.ods' are not known")
    known = "are not known: give .csv, .xlsx, .parquet, .ins2D or .json"
    assert_refused(lambda: read_job(tmp_path), known)


def test_a_file_that_may_not_be_read(tmp_path, monkeypatch):
    def refuse(path, mode):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    assert_refused(lambda: read_job(tmp_path / "a.json"), "a.json: cannot be read (Permission den")


BAD_INS2D = [
    ("", "the file is empty"),
    ("3\n", "expected a line 'm' and a line 'W H'"),
    ("3 4\n10 12\n", "row 1: 2 fields, expected 'm'"),
    ("3\n10\n", "row 2: 1 fields, expected 'W H'"),
    ("x\n10 12\n1 1 1\n", "row 1, column m: 'x' is not a number"),
    ("2\n10 12\n1 1 1\n", "row 1: column m: 2 items announced, 1 are there"),
    ("0\n10 12\n", "row 1, column m: 0 is not possible"),
    ("1\n10 -1\n1 1 1\n", "row 2, column H: -1 is not a size"),
    ("1\n10 12\n\n1 1\n", "row 4: 2 fields, expected 'i w h dmin dmax profit'"),
    ("1\n10 12\n1 0 1\n", "row 3, column w: 0 is not a size"),
    ("1\n10 12\n1 1 x\n", "row 3, column h: 'x' is not a number"),
    ("1\n10 12\n1 1 1 0 3 5\n", "row 3, column dmin: 0 is not possible"),
    ("1\n10 12\n1 1 1 200000\n", "row 3, column dmin: 200000 copies: more than 100,000"),
    (b"1\n10 12\n1 1 \x9f\n", "row 3: not UTF-8"),
]


@pytest.mark.parametrize(("text", "message"), BAD_INS2D, ids=[text for _, text in BAD_INS2D])
def test_bad_ins2d(tmp_path, text, message):
    assert_refused(lambda: read(tmp_path, text, name="a.ins2D"), "a.ins2D: ", message)


def test_bins_of_another_dimension(tmp_path):
    text = json.dumps(ORDERS)
    assert_refused(lambda: read(tmp_path, text, BINS_2D, "a.json"), "bins.csv: ", "bins of 2D")
    assert_refused(lambda: read(tmp_path, INS2D, BINS_3D, "a.ins2D"), "bins.csv: ", "bins of 3D")


BOXES = {"X": [9, 9], "Y": [9, 9], "Z": [9, 9]}
BAD_COLUMNS = [
    (BOXES | {"X": [1, "x"]}, "items: row 1, column X: 'x' is not a number"),
    (BOXES | {"X": [math.nan, 1]}, "items: row 0, column X: empty: give a number"),
    (BOXES | {"X": [None, 1]}, "items: row 0, column X: empty"),
    (BOXES | {"X": [10**5000, 1]}, "items: row 0, column X: inf is not a finite number"),
    (BOXES | {"X": [True, 1]}, "items: row 0, column X: True is not a number"),
    (BOXES | {"X": np.ones((2, 2))}, "items: row 0, column X: array([1., 1.]) is not a number"),
    (BOXES | {"COPIES": [1, -1]}, "items: row 1, column COPIES: -1 is not possible"),
    (BOXES | {"ROTATION_XYZ": [False, True]}, "items: row 0: columns ROTATION_XYZ: all are 0"),
    (BOXES | {"X": [1]}, "items: columns of different lengths (X has 1, Y has 2"),
    (BOXES | {"X": 1}, "items: column X: 1 is not a list of values"),
    (BOXES | {"X": "12"}, "items: column X: '12' is not a list of values"),
    (BOXES | {"X": np.array(1)}, "items: column X: not a list of values"),
    (BOXES | {"x": [1, 2]}, "items: column X is there twice"),
    ({"X": [1], "Y": [1]}, "items: column Z is missing"),
    ({"X": [], "Y": [], "Z": []}, "items: no items"),
    ({}, "items: columns WIDTH, HEIGHT (2D) or X, Y, Z (3D) are missing: there are none"),
    ([], "items: columns WIDTH, HEIGHT (2D) or X, Y, Z (3D) are missing"),
    ([{"X": 1, "Y": 1, "Z": 1}, {"X": 1, "Y": 1}], "items: row 1, column Z: empty"),
    ([[1, 2, 3]], "items: [[1, 2, 3]] is not a table: give a data frame"),
    ("X,Y,Z", "items: 'X,Y,Z' is not a table"),
    (None, "items: None is not a table"),
    (np.ones((2, 3)), "is not a table"),
]


@pytest.mark.parametrize(("items", "message"), BAD_COLUMNS, ids=[text for _, text in BAD_COLUMNS])
def test_bad_columns_name_the_table_the_row_and_the_column(items, message):
    assert_refused(lambda: job_from_columns(items, BOXES), message)
