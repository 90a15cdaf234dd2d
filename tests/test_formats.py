"""Jobs and plans in files: what the formats say comes in, what is wrong is said in one line."""

import json
import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxpack.errors import UserError
from jaxpack.files.jobs import job_from_columns, read_job
from jaxpack.files.plans import (
    read_certificate,
    read_plan_json,
    write_bed_bpp,
    write_certificate,
    write_plan_json,
    write_steps,
)
from jaxpack.loading.job import (
    FLAT_TURNED,
    ORIENTATIONS,
    UPRIGHT,
    BinType,
    ItemType,
    Job,
    PackedBin,
    Placement,
    Plan,
)

ITEMS_2D = "ID,WIDTH,HEIGHT,COPIES,WEIGHT,ORIENTED\na,3,5,2,1.5,1\nb,4.25,2,1,0,0\n"
BINS_2D = "WIDTH,HEIGHT,COST,COPIES,MAXIMUM_WEIGHT\n10,12,-1,-1,-1\n6,6,7.5,3,20\n"
ITEMS_3D = (
    "X,Y,Z,COPIES,ROTATION_XYZ,ROTATION_YXZ,ROTATION_ZYX,ROTATION_YZX,ROTATION_XZY,ROTATION_ZXY\n"
    "3,4,5,2,1,1,0,0,0,0\n1,2,3,1,0,0,0,1,0,1\n"
)
BINS_3D = "X,Y,Z\n10,10,10\n"
INS2D = "3\n10 12\n1 3 5 1 1 15\n2 4 2 3 3 8\n3 1 1 1 1 1\n"
FLAT_JOB = Job(
    items=(
        ItemType((3.0, 1.0, 5.0), 2, 1.5, ("XYZ",), "a"),
        ItemType((4.25, 1.0, 2.0), 1, 0.0, FLAT_TURNED, "b"),
    ),
    bins=(BinType((10.0, 1.0, 12.0)), BinType((6.0, 1.0, 6.0), 7.5, 3, 20.0)),
    dimension=2,
    name="items",
)
SOLID_JOB = Job(
    items=(
        ItemType((3.0, 4.0, 5.0), 2, orientations=UPRIGHT),
        ItemType((1.0, 2.0, 3.0), 1, orientations=("YZX", "ZXY")),
    ),
    bins=(BinType((10.0, 10.0, 10.0)),),
    name="items",
)


def ordered(number, article="jam-7", sides=(600, 400, 220), weight=6.5):
    length, width, height = sides
    return {
        "article": article,
        "id": article[-1],
        "product_group": "food",
        "length/mm": length,
        "width/mm": width,
        "height/mm": height,
        "weight/kg": weight,
        "sequence": number,
    }


ORDERS = {
    "0017": {
        "item_sequence": {
            "1": ordered(1),
            "2": ordered(2, "tea-8", (300, 200, 100), 2),
            "3": ordered(3),
            "4": ordered(4, sides=(600, 400, 221)),
        },
        "properties": {"id": "5", "target": "rollcontainer"},
    },
    "0018": {"item_sequence": {"1": ordered(1)}, "properties": {"target": "euro-pallet"}},
    "0019": {"item_sequence": {"1": ordered(1)}},
}


def file_with(folder, name, text):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def read(folder, items, bins=None, name="items.csv"):
    given_bins = None if bins is None else file_with(folder, "bins.csv", bins)
    return read_job(file_with(folder, name, items), given_bins)


def assert_one_line(error, *words):
    (line,) = str(error).splitlines()
    assert line.isprintable(), line
    for word in words:
        assert word in line, line


def assert_refused(call, *words):
    with pytest.raises(UserError) as stop:
        call()
    assert_one_line(stop.value, *words)


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


def test_bed_bpp_has_a_job_per_order(tmp_path):
    jobs = read(tmp_path, json.dumps(ORDERS), name="orders.json")
    jam = ItemType((600.0, 400.0, 220.0), 2, 6.5, UPRIGHT, "jam-7")
    tea = ItemType((300.0, 200.0, 100.0), 1, 2.0, UPRIGHT, "tea-8")
    assert jobs[0].items == (jam, tea, replace(jam, size=(600.0, 400.0, 221.0), copies=1))
    assert [job.name for job in jobs] == ["0017", "0018", "0019"]
    roll, euro = (BinType((800.0, 700.0, 1600.0)), BinType((1200.0, 800.0, 1600.0)))
    targets = replace(roll, name="rollcontainer"), replace(euro, name="euro-pallet")
    assert [job.bins[0] for job in jobs] == [targets[0], targets[1], targets[1]]
    jobs = read(tmp_path, json.dumps(ORDERS), BINS_3D, "orders.json")
    assert all(job.bins == SOLID_JOB.bins for job in jobs)


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
    ("LENGTH,WIDTH,HEIGHT\n1,1,1\n", "row 1: column LENGTH beside WIDTH and HEIGHT: 3D sides are"),
    ("WIDTH,HEIGHT,width\n1,1,1\n", "row 1: column WIDTH is there twice"),
    (SIDES + "3,five\n", "row 2, column HEIGHT: 'five' is not a number"),
    (SIDES + "3,nan\n", "row 2, column HEIGHT: 'nan' is not a number"),
    (SIDES + "3,inf\n", "row 2, column HEIGHT: 'inf' is not a number"),
    (SIDES + "3,1e999\n", "row 2, column HEIGHT: inf is not a finite number"),
    (SIDES + "3,1_0\n", "row 2, column HEIGHT: '1_0' is not a number"),
    (SIDES + '3,"5,5"\n', "row 2, column HEIGHT: '5,5' is not a number: give one such as 12.5"),
    (SIDES + "3,\n", "row 2, column HEIGHT: empty"),
    (SIDES + "3,5\n\n3, \n", "row 4, column HEIGHT: empty"),
    (SIDES + "3,-5\n", "row 2, column HEIGHT: -5 is not a size: give more than 0"),
    (SIDES + "0,5\n", "row 2, column WIDTH: 0 is not a size: give more than 0"),
    (SIDES + "2e9,5\n", "row 2, column WIDTH: 2e+09 is out of range"),
    (SIDES + "1e-300,5\n", "row 2, column WIDTH: 1e-300 is out of range"),
    (SIDES + "3\n", "row 2: 1 fields, the header has 2"),
    (SIDES + "3,5\n3,5,7\n", "row 3: 3 fields, the header has 2"),
    (SIDES + '3,5\n"3,5\n4,5\n', "row 3: not CSV"),
    ("", "the file is empty"),
    (" \n\n", "the file is empty"),
    (",\n,\n", "no header"),
    (SIDES, "row 1: no items below the header"),
    ("WIDTH;HEIGHT\n3;5\n", "row 1: wrong delimiter: use commas, not ';'"),
    ("WIDTH\tHEIGHT\n3\t5\n", "row 1: wrong delimiter: use commas"),
    (FINE.encode() + b"3,\xff\n", "row 3: not UTF-8 text"),
    (FINE.encode("utf-16"), "row 1: not UTF-8 text"),
    (FINE.encode() + b"3,\x005\n", "row 3: a NUL byte"),
    ("WIDTH,HEIGHT,COPIES\n3,5,-2\n", "row 2, column COPIES: -2 is not possible: give a whole"),
    ("WIDTH,HEIGHT,COPIES\n3,5,0\n", "row 2, column COPIES: 0 is not possible"),
    ("WIDTH,HEIGHT,COPIES\n3,5,1.5\n", "row 2, column COPIES: 1.5 is not possible"),
    (
        "WIDTH,HEIGHT,COPIES\n3,5,1\n3,5,1000000\n",
        "row 3, column COPIES: 1000000 copies: more than 100,000 items in all",
    ),
    ("WIDTH,HEIGHT,WEIGHT\n3,5,-1\n", "row 2, column WEIGHT: -1 is not a weight"),
    ("WIDTH,HEIGHT,ORIENTED\n3,5,2\n", "row 2, column ORIENTED: 2 is not possible"),
]


@pytest.mark.parametrize(("items", "message"), BAD_ITEMS, ids=[text for _, text in BAD_ITEMS])
def test_bad_items_are_one_line_with_file_row_and_column(tmp_path, items, message):
    assert_refused(lambda: read(tmp_path, items, BINS_2D), f"{tmp_path / 'items.csv'}: ", message)


BAD_SOLID_ITEMS = [
    ("X,Y,Z,ROTATION_XYZ,ROTATION_YXZ\n1,2,3,1,0\n1,2,3,0,0\n", "row 3: columns ROTATION_XYZ, "),
    ("X,Y,Z,ROTATION_XYZ\n1,2,3,yes\n", "row 2, column ROTATION_XYZ: 'yes' is not a number"),
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
    assert_refused(lambda: read_job(tmp_path / "a.xlsx"), "files '.xlsx' are not known")
    assert_refused(lambda: read_job(tmp_path), "are not known: give .csv, .ins2D or .json")


def test_a_file_that_may_not_be_read(tmp_path, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refuse)
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


def orders_with(**changes):
    item = {key: value for key, value in (ordered(1) | changes).items() if value is not ...}
    return json.dumps({"o": {"item_sequence": {"1": item}}})


BAD_ORDERS = [
    ('{"o": \n [}', "row 2, column 3: not JSON"),
    ("[" * 100_000, "cannot be read as JSON"),
    ('{"o": {"item_sequence": {"1": {"length/mm": ' + "9" * 5000 + "}}}}", "cannot be read as"),
    ('{"o": {}, "o": {}}', "key 'o' is there twice"),
    ("[1]", "expected an object of orders by name"),
    ("{}", "expected an object of orders by name"),
    ('{"o": 5}', "order 'o': expected an object with key 'item_sequence', found 5"),
    ('{"o": {"items": 5}}', "order 'o': key 'item_sequence' is missing"),
    ('{"o\\n\\ud800": 5}', "order 'o??': expected an object"),
    ('{"o": {"item_sequence": [1]}}', "order 'o': key 'item_sequence': expected an object, found"),
    ('{"o": {"item_sequence": {}}}', "order 'o': key 'item_sequence' has no items"),
    ('{"o": {"item_sequence": {"1": 2}}}', "order 'o', item '1': expected an object with key"),
    (orders_with(**{"width/mm": ...}), "order 'o', item '1': key 'width/mm' is missing"),
    (orders_with(**{"width/mm": "x"}), "order 'o', item '1', key 'width/mm': 'x' is not a num"),
    (orders_with(**{"width/mm": True}), "item '1', key 'width/mm': True is not a number"),
    (orders_with(**{"width/mm": math.nan}), "item '1', key 'width/mm': nan is not a finite"),
    (orders_with(**{"width/mm": -4}), "item '1', key 'width/mm': -4 is not a size"),
    (orders_with(**{"weight/kg": -4}), "item '1', key 'weight/kg': -4 is not a weight"),
    (orders_with(**{"weight/kg": None}), "item '1', key 'weight/kg': empty"),
    (orders_with(article=[1]), "item '1': article or id [1]: expected a text"),
    (
        json.dumps({"o": ORDERS["0019"] | {"properties": {"target": "ship"}}}),
        "order 'o': key 'target': 'ship' is not known: use euro-pallet or rollcontainer",
    ),
    (json.dumps({"o": ORDERS["0019"] | {"properties": 3}}), "key 'properties': expected an obj"),
]


@pytest.mark.parametrize(("text", "message"), BAD_ORDERS, ids=[text for _, text in BAD_ORDERS])
def test_bad_orders(tmp_path, text, message):
    assert_refused(lambda: read(tmp_path, text, name="a.json"), "a.json: ", message)


def test_bins_of_another_dimension(tmp_path):
    text = json.dumps(ORDERS)
    assert_refused(lambda: read(tmp_path, text, BINS_2D, "a.json"), "bins.csv: ", "bins of 2D")
    assert_refused(lambda: read(tmp_path, INS2D, BINS_3D, "a.ins2D"), "bins.csv: ", "bins of 3D")


BOXES = {"X": [9, 9], "Y": [9, 9], "Z": [9, 9]}
BAD_COLUMNS = [
    (BOXES | {"X": [1, "x"]}, "items: row 1, column X: 'x' is not a number"),
    (BOXES | {"X": [math.nan, 1]}, "items: row 0, column X: nan is not a finite number"),
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


FLAT_PLAN = Plan(
    bins=(
        PackedBin(1, (Placement(0, "XYZ", (0.0, 0.0, 0.0)),)),
        PackedBin(0, (Placement(1, "ZYX", (0.5, 0.0, 0.0)), Placement(0, "XYZ", (2.5, 0.0, 4.25)))),
    )
)
FLAT_CERTIFICATE = """\
TYPE,ID,COPIES,BIN,X,Y,LX,LY,GROUP_ID
BIN,1,1,0,0,0,6,6,
ITEM,0,1,0,0,0,3,5,0
BIN,0,1,1,0,0,10,12,
ITEM,1,1,1,0.5,0,2,4.25,0
ITEM,0,1,1,2.5,4.25,3,5,0
"""
SOLID_PLAN = Plan(
    bins=(
        PackedBin(0, (Placement(0, "YXZ", (0.0, 0.0, 0.0)), Placement(1, "ZXY", (0.1, 0.0, 5.0)))),
    ),
    left_out=(0,),
)
SOLID_CERTIFICATE = """\
TYPE,ID,COPIES,BIN,X,Y,Z,LX,LY,LZ,ROTATION
BIN,0,1,0,0,0,0,10,10,10,
ITEM,0,1,0,0,0,0,4,3,5,YXZ
ITEM,1,1,0,0.1,0,5,3,1,2,ZXY
"""


@pytest.mark.parametrize(
    ("job", "plan", "text"),
    [(FLAT_JOB, FLAT_PLAN, FLAT_CERTIFICATE), (SOLID_JOB, SOLID_PLAN, SOLID_CERTIFICATE)],
    ids=["2D", "3D"],
)
def test_a_certificate_is_written_and_read(tmp_path, job, plan, text):
    path = tmp_path / "certificate.csv"
    write_certificate(path, job, plan)
    assert path.read_text() == text
    assert read_certificate(path, job) == plan


def test_a_certificate_of_older_or_other_making(tmp_path):
    text = "TYPE,ID,COPIES,BIN,X,Y,LX,LY\nBIN,0,2,7,0,0,10,12\nITEM,0,2,7,1,2,3,5.0000001\n"
    plan = read_certificate(file_with(tmp_path, "c.csv", text), FLAT_JOB)
    packed = PackedBin(0, (Placement(0, "XYZ", (1.0, 0.0, 2.0)),))
    assert plan == Plan((packed, packed), left_out=(1,))


BAD_CERTIFICATES = [
    ("", "", "the file is empty"),
    ("ROTATION", "ROTATE", "row 1: column ROTATION is missing: is 'ROTATE' meant?"),
    ("BIN,0", "TRUCK,0", "row 2, column TYPE: 'TRUCK' is not known: use BIN or ITEM"),
    ("BIN,0", "BIN,1", "row 2, column ID: 1 is not possible: give a whole number, 0 to 0"),
    ("BIN,0,1", "BIN,0,0", "row 2, column COPIES: 0 is not possible"),
    ("BIN,0,1", "BIN,0,999999", "row 2, column COPIES: more than 100,000 bins"),
    ("BIN,0,1", "BIN,0,2", "row 3, column COPIES: 1, but its bin has 2"),
    ("10,10,10", "10,10,9", "row 2, column LZ: 9, but bins of type 0, of this job has 10"),
    ("ITEM,0,1,0", "BIN,0,1,0", "row 3, column BIN: bin 0 has a BIN row already"),
    ("ITEM,0,1,0", "ITEM,0,1,3", "row 3, column BIN: bin 3 has no BIN row before this one"),
    ("ITEM,1", "ITEM,2", "row 4, column ID: 2 is not possible: give a whole number, 0 to 1"),
    ("ITEM,1", "ITEM,-1", "row 4, column ID: -1 is not possible"),
    ("ZXY", "ZZZ", "row 4, column ROTATION: 'ZZZ' is not known: use XYZ"),
    ("ZXY", "XYZ", "row 4, column LX: 3, but item 1, XYZ, of this job has 1"),
    ("0.1", "nan", "row 4, column X: 'nan' is not a number"),
    (",ZXY", "", "row 4: 10 fields, the header has 11"),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD_CERTIFICATES)
def test_bad_certificates(tmp_path, old, new, message):
    text = SOLID_CERTIFICATE.replace(old, new) if old else ""
    path = file_with(tmp_path, "c.csv", text)
    assert_refused(lambda: read_certificate(path, SOLID_JOB), f"{path}: ", message)


def test_a_plan_as_json(tmp_path):
    path = tmp_path / "plan.json"
    write_plan_json(path, FLAT_JOB, FLAT_PLAN)
    data = json.loads(path.read_text())
    assert data["dimension"] == 2
    assert data["job"] == "items"
    first, second = data["bins"]
    fill = (4.25 * 2 + 15) / 120
    kind = {"type": 0, "name": "", "size": [10, 1, 12], "cost": 120, "weight": 1.5}
    items = second.pop("items")
    assert second == {"bin": 1, **kind, "fill": pytest.approx(fill, abs=1e-6)}
    assert first["cost"] == 7.5
    box = {"position": [0.5, 0, 0], "extent": [2, 1, 4.25]}
    assert items[0] == {"step": 2, "item": 1, "name": "b", **box} | {
        "orientation": "ZYX",
        "weight": 0,
    }
    assert read_plan_json(path, FLAT_JOB) == FLAT_PLAN
    write_plan_json(path, SOLID_JOB, SOLID_PLAN)
    assert json.loads(path.read_text())["left_out"] == [{"item": 0, "name": ""}]
    assert read_plan_json(path, SOLID_JOB) == SOLID_PLAN


BAD_PLANS = [
    ('"bins"', '"bin"', "key 'bins' is missing"),
    ('"left_out"', '"out"', "key 'left_out' is missing"),
    ('"type": 0', '"type": 1', "bin 0, key 'type': 1 is not possible: give a whole number, 0 to 0"),
    ("[10, 10, 10]", "[10, 10]", "bin 0: key 'size': 2 numbers"),
    ("[10, 10, 10]", "[10, 10, 9]", "bin 0: key 'size': [10, 10, 9], but this job has [10, 10, 10"),
    ('"items": [', '"items": 3, "x": [', "bin 0: key 'items': expected a list, found 3"),
    ('"item": 1', '"item": 2', "bin 0, item 1, key 'item': 2 is not possible"),
    ('"YXZ"', "3", "bin 0, item 0: key 'orientation': expected a text, found 3"),
    ('"YXZ"', '"YYY"', "bin 0, item 0: key 'orientation': 'YYY' is not known: use XYZ"),
    ('"YXZ"', '"XYZ"', "bin 0, item 0: key 'extent': [4, 3, 5], but this job has [3, 4, 5]"),
    ("[0.1, 0, 5]", '[0.1, 0, "up"]', "bin 0, item 1, key 'position': 'up' is not a number"),
    ('{"item": 0, "name": ""}', '{"item": 5}', "left_out 0, key 'item': 5 is not possible"),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD_PLANS)
def test_bad_plans(tmp_path, old, new, message):
    path = tmp_path / "plan.json"
    write_plan_json(path, SOLID_JOB, SOLID_PLAN)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    assert_refused(lambda: read_plan_json(path, SOLID_JOB), f"{path}: ", message)


def test_steps_are_in_loading_order(tmp_path):
    path = tmp_path / "steps.csv"
    job = replace(
        FLAT_JOB, items=(replace(FLAT_JOB.items[0], name='a "5", new'), FLAT_JOB.items[1])
    )
    write_steps(path, job, FLAT_PLAN)
    assert path.read_text() == (
        "STEP,BIN,ITEM,NAME,X,Y,Z,LX,LY,LZ,ROTATION,WEIGHT\n"
        '1,0,0,"a ""5"", new",0,0,0,3,1,5,XYZ,1.5\n'
        "2,1,1,b,0.5,0,0,2,1,4.25,ZYX,0\n"
        '3,1,0,"a ""5"", new",2.5,0,4.25,3,1,5,XYZ,1.5\n'
    )


def test_bed_bpp_plans(tmp_path):
    jobs = read(tmp_path, json.dumps(ORDERS), name="orders.json")
    stack = (Placement(0, "YXZ", (0.0, 0.0, 0.0)), Placement(1, "XYZ", (0.0, 10.5, 220.0)))
    plans = [Plan((PackedBin(0, stack),)), Plan(()), Plan((PackedBin(0, stack[:1]),))]
    path = tmp_path / "plans.json"
    write_bed_bpp(path, jobs, plans)
    data = json.loads(path.read_text())
    assert list(data) == ["0017", "0018", "0019"]
    first, second = data["0017"]
    assert first == {
        "item": ordered(1) | {"product_group": ""},
        "flb_coordinates": [0, 0, 0],
        "orientation": 1,
    }
    assert (second["flb_coordinates"], second["orientation"]) == ([0, 10.5, 220], 0)
    assert second["item"]["sequence"] == 2
    assert data["0018"] == []

    def write(jobs, plans):
        write_bed_bpp(path, jobs, plans)

    lying = Plan((PackedBin(0, (Placement(1, "ZYX", (0.0, 0.0, 0.0)),)),))
    before = path.read_text()
    assert_refused(lambda: write(jobs[:1], [lying]), "order '0017': item 1 lies ZYX")
    assert_refused(lambda: write(jobs[:1], [Plan(plans[0].bins * 2)]), "order '0017': 2 bins")
    assert_refused(lambda: write(jobs[:1] * 2, plans[:2]), "order '0017': is there twice")
    assert path.read_text() == before


@pytest.mark.parametrize("write", [write_certificate, write_plan_json, write_steps])
def test_a_place_that_cannot_be_written(tmp_path, write):
    for path, message in (
        (tmp_path / "no" / "plan", "cannot be written (No such file or directory)"),
        (tmp_path, "cannot be written (Is a directory)"),
        (Path(), "names no file"),
    ):
        assert_refused(lambda path=path: write(path, FLAT_JOB, FLAT_PLAN), message)


# Any job and plan, possible or not, comes back as it was.

SIZES = st.floats(1e-3, 1e6)
NAMES = st.text(max_size=4)


@st.composite
def jobs_with_plans(draw):
    flat = draw(st.booleans())
    allowed = FLAT_TURNED if flat else tuple(ORIENTATIONS)
    sides = st.tuples(SIZES, st.just(1.0) if flat else SIZES, SIZES)
    items = draw(
        st.lists(st.builds(ItemType, sides, weight=st.floats(0, 1e6), name=NAMES), min_size=1)
    )
    bins = draw(st.lists(st.builds(BinType, sides, name=NAMES), min_size=1, max_size=3))
    place = st.floats(-1e6, 1e6)
    placement = st.builds(
        Placement,
        st.integers(0, len(items) - 1),
        st.sampled_from(allowed),
        st.tuples(place, st.just(0.0) if flat else place, place),
    )
    packed = st.builds(
        PackedBin, st.integers(0, len(bins) - 1), st.lists(placement, max_size=5).map(tuple)
    )
    used = draw(st.lists(packed, max_size=4))
    placed = [placement.item for one in used for placement in one.placements]
    copies = [max(1, placed.count(index)) for index in range(len(items))]
    items = [replace(item, copies=n) for item, n in zip(items, copies, strict=True)]
    left_out = tuple(index for index in range(len(items)) if index not in placed)
    job = Job(tuple(items), tuple(bins), 2 if flat else 3, draw(NAMES))
    return job, Plan(tuple(used), left_out)


def geometry(job, plan):
    return [
        (one.bin, [(p.item, p.corner, job.items[p.item].turned(p.orientation)) for p in placements])
        for one in plan.bins
        for placements in [one.placements]
    ]


@settings(deadline=None, max_examples=60)
@given(jobs_with_plans())
def test_plans_come_back(job_and_plan):
    job, plan = job_and_plan
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan"
        write_plan_json(path, job, plan)
        assert read_plan_json(path, job) == plan
        write_certificate(path, job, plan)
        again = read_certificate(path, job)
        write_steps(path, job, plan)
    assert again.left_out == plan.left_out
    assert geometry(job, again) == geometry(job, plan)  # 2D: a square has no orientation there
    assert job.dimension == 2 or again == plan


# Whatever a file holds, nothing but a UserError of one line comes out.

VALID = {
    "a.csv": (ITEMS_2D, ITEMS_3D, BINS_2D, BINS_3D, SOLID_CERTIFICATE),
    "a.ins2D": (INS2D,),
    "a.json": (json.dumps(ORDERS), json.dumps(ORDERS, indent=1)),
}
TOKENS = (
    *(",", "\n", "\r", '"', ";", "\t", "\0", "-", "-1", "0", "1e999", "nan", "Infinity", " "),
    *("{", "}", "[", "]", ":", "null", "true", "\\ud800", "\ufeff", "9" * 5000, "x", "é", "1e7"),
)
EDITS = st.lists(
    st.tuples(st.floats(0, 1), st.integers(0, 6), st.sampled_from(TOKENS)), min_size=1, max_size=3
)


def edited(text, edits):
    """The text with pieces of it replaced by tokens."""
    for where, length, token in edits:
        start = int(where * len(text))
        text = text[:start] + token + text[start + length :]
    return text.encode()


CONTENTS = {
    name: st.one_of(
        st.binary(max_size=60),
        st.text(alphabet=st.sampled_from("XYZWIDTHEGHT,;\n\"' 0123.-+e[]{}:"), max_size=60).map(
            str.encode
        ),
        *(EDITS.map(lambda edits, text=text: edited(text, edits)) for text in texts),
    )
    for name, texts in VALID.items()
}


def assert_read_or_refused(call):
    try:
        return call()
    except UserError as error:
        assert_one_line(error)
        return None


@settings(deadline=None, max_examples=300)
@given(data=st.data(), name=st.sampled_from(sorted(CONTENTS)))
def test_any_file_is_read_or_refused_in_one_line(data, name):
    text = data.draw(CONTENTS[name])
    bins = data.draw(st.one_of(st.none(), st.just(BINS_2D), st.just(BINS_3D), CONTENTS["a.csv"]))
    with tempfile.TemporaryDirectory() as folder:
        jobs = assert_read_or_refused(lambda: read(Path(folder), text, bins, name))
        for job in jobs or ():
            assert 1 <= job.count <= 100_000
            sides = [side for kind in (*job.items, *job.bins) for side in kind.size]
            assert all(0 < side <= 1e9 for side in sides)


@pytest.fixture(scope="module")
def plan_files(tmp_path_factory):
    """What is written of the plans, with what reads it."""
    folder = tmp_path_factory.mktemp("plans")
    written = []
    for number, (job, plan) in enumerate(((FLAT_JOB, FLAT_PLAN), (SOLID_JOB, SOLID_PLAN))):
        for write, again in (
            (write_certificate, read_certificate),
            (write_plan_json, read_plan_json),
        ):
            path = folder / f"{number}-{write.__name__}"
            write(path, job, plan)
            written.append((path.read_text(), job, again))
    return written


@settings(deadline=None, max_examples=200)
@given(edits=EDITS, data=st.data())
def test_any_plan_is_read_or_refused_in_one_line(plan_files, edits, data):
    text, job, again = data.draw(st.sampled_from(plan_files))
    with tempfile.TemporaryDirectory() as folder:
        path = file_with(Path(folder), "plan", edited(text, edits))
        assert_read_or_refused(lambda: again(path, job))


CELLS = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=3), st.binary(max_size=2)
)
COLUMNS = st.sampled_from(["X", "Y", "Z", "WIDTH", "HEIGHT", "COPIES", "WEIGHT", "ROTATION_XYZ"])


@settings(deadline=None, max_examples=200)
@given(
    st.one_of(
        CELLS,
        st.dictionaries(COLUMNS, st.one_of(CELLS, st.lists(CELLS, min_size=1, max_size=2))),
        st.lists(st.dictionaries(COLUMNS, CELLS), max_size=3),
    )
)
def test_any_columns_are_read_or_refused_in_one_line(table):
    assert_read_or_refused(lambda: job_from_columns(table, BOXES))
    assert_read_or_refused(lambda: job_from_columns(BOXES, table))
