"""Files as spreadsheets write them: read where they have one meaning."""

import builtins
import itertools
import zipfile

import openpyxl
import pytest
from job_files import BINS_3D, FLAT_JOB, assert_refused, file_with, notes_of, read

from jaxpack.io.jobs import read_job

SOLID = "X,Y,Z,COPIES,WEIGHT,NAME\n3.5,4,5,2,0.125,a\n1,2,3,1,10.5,b\n"
LOCAL = SOLID.replace(",", ";").replace(".", ",")


def of(folder, text, bins=BINS_3D, **how):
    return notes_of(folder, text, bins, **how)


@pytest.mark.parametrize(("separator", "called"), [(";", "semicolons"), ("\t", "tabs")])
def test_other_separators_and_decimal_commas(tmp_path, separator, called):
    expected, notes = of(tmp_path, SOLID)
    assert notes == []
    job, notes = of(tmp_path, LOCAL.replace(";", separator))
    assert job == expected
    path = tmp_path / "items.csv"
    assert notes == [
        f"{path}: read with {called} between the fields",
        f"{path}: read with decimal commas",
    ]
    job, notes = of(tmp_path, SOLID.replace(",", separator))
    assert job == expected
    assert len(notes) == 1


def test_a_first_line_that_names_the_separator(tmp_path):
    assert of(tmp_path, "sep=;\r\n" + LOCAL)[0] == of(tmp_path, SOLID)[0]
    what = "row 4, column X: 'x' is not a number"
    assert_refused(lambda: of(tmp_path, "sep=;\n" + LOCAL.replace("1;2;3", "x;2;3")), what)


NUMBERS = [  # the cells of one column, between semicolons, and what they are
    (["12,5", "1.200"], [12.5, 1200]),
    (["12.5", "1.200"], [12.5, 1.2]),
    (["12.5", "1,200"], [12.5, 1200]),
    (["12,5", "1,200"], [12.5, 1.2]),
    (["1.234,5"], [1234.5]),
    (["1,234.5"], [1234.5]),
    (["1.234.567"], [1234567]),
    (["0,125"], [0.125]),
    (["0.125"], [0.125]),
    ([",5"], [0.5]),
    (["1200"], [1200]),
    (["1234,567"], [1234.567]),
    (["1.20", "1.200"], [1.2, 1.2]),
]


@pytest.mark.parametrize(("cells", "numbers"), NUMBERS, ids=[" ".join(c) for c, _ in NUMBERS])
def test_numbers_of_one_meaning(tmp_path, cells, numbers):
    items = "X;Y;Z\n" + "".join(f"{cell};1;1\n" for cell in cells)
    (job,) = read(tmp_path, items, f"X,Y,Z\n{max(numbers)},9,9\n")
    assert [item.size[0] for item in job.items] == numbers


@pytest.mark.parametrize(
    ("cell", "first", "second"), [("1.200", "1.200", "1200"), ("1,200", "1200", "1.200")]
)
def test_numbers_of_two_meanings_are_refused_with_both(tmp_path, cell, first, second):
    for items in (f"X;Y;Z\n{cell};1;1\n", f"X\tY\tZ\n{cell}\t1\t1\n"):
        what = f"row 2, column X: '{cell}' may be "
        assert_refused(lambda items=items: read(tmp_path, items, BINS_3D), what, first, second)
    both = 'X;Y;Z\n"12,5";12.5;1\n1.200;1;1\n'  # nothing to go by
    assert_refused(lambda: read(tmp_path, both, BINS_3D), "row 3, column X: '1.200' may be")


def test_between_commas_a_point_is_a_point(tmp_path):
    (job,) = read(tmp_path, "X,Y,Z\n1.200,1,1\n", BINS_3D)
    assert job.items[0].size == (1.2, 1, 1)
    (job,) = read(tmp_path, 'X,Y,Z\n"1,5",1,1\n', BINS_3D)
    assert job.items[0].size == (1.5, 1, 1)
    assert_refused(lambda: read(tmp_path, 'X,Y,Z\n"1,200",1,1\n', BINS_3D), "'1,200' may be ")


def test_names_are_no_numbers(tmp_path):
    (job,) = read(tmp_path, "X;Y;Z;NAME\n1,5;1;1;1.200\n", BINS_3D)
    assert job.items[0].name == "1.200"


def test_rows_that_end_early_or_late(tmp_path):
    short = "X,Y,Z,COPIES,WEIGHT,NAME\n3,4,5\n3,4,5,,,,,\n3,4,5,1,0,\n3,4,5,\n"
    (job,) = read(tmp_path, short, "X,Y,Z,COPIES\n9,9,9\n9,9,9,,\n")
    assert {(*item.size, item.copies, item.weight, item.name) for item in job.items} == {
        (3, 4, 5, 1, 0, "")
    }
    assert [kind.copies for kind in job.bins] == [None, None]
    assert_refused(lambda: read(tmp_path, short + "3,4\n", BINS_3D), "row 6, column Z: empty")
    late = short + "3,4,5,1,0,a,b\n"
    assert_refused(lambda: read(tmp_path, late, BINS_3D), "row 6: 7 fields, the header has 6")


ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "cp1252", "latin-1"]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_names_in_the_encodings_of_spreadsheets(tmp_path, encoding):
    text = "X,Y,Z,NAME\n3,4,5,Größe\n".encode(encoding)
    job, notes = notes_of(tmp_path, text, BINS_3D)
    assert job.items[0].name == "Größe"
    said = [f"{tmp_path / 'items.csv'}: not UTF-8, read as Windows-1252: row 2 is '3,4,5,Größe'"]
    assert notes == (said if encoding in ("cp1252", "latin-1") else [])


def test_utf16_of_the_other_order(tmp_path):
    text = b"\xfe\xff" + "X,Y,Z,NAME\n3,4,5,a\n".encode("utf-16-be")
    assert read(tmp_path, text, BINS_3D)[0].items[0].name == "a"


def workbook(folder, *sheets, name="items.xlsx"):
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in sheets:
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    book.save(folder / name)
    return folder / name


FLAT = [
    ["id", "Width", "HEIGHT", "COPIES", "WEIGHT", "ORIENTED", "note"],
    ["a", 3, 5, 2, 1.5, True, "x"],
    [],
    ["b", 4.25, "2", None, None, False],
]
FLAT_BINS = [
    ["WIDTH", "HEIGHT", "COST", "COPIES", "MAXIMUM_WEIGHT"],
    [10, 12, None, None, None],
    [6, 6, 7.5, 3, 20],
]


def test_workbooks(tmp_path):
    items = workbook(tmp_path, ("Empty", []), ("Items", FLAT), ("Other", [["x"]]))
    bins = workbook(tmp_path, ("Bins", FLAT_BINS), name="bins.xlsx")
    notes = []
    assert read_job(items, bins, say=notes.append) == [FLAT_JOB]
    assert notes == [
        f"{items}: read from sheet 'Items'",
        f"{items}: columns not used: NOTE",
    ]


def test_texts_in_workbooks_may_be_of_any_country(tmp_path):
    bins = workbook(tmp_path, ("Bins", FLAT_BINS), name="bins.xlsx")
    items = workbook(tmp_path, ("a", [["WIDTH", "HEIGHT"], ["1,5", "1.200"]]))
    assert read_job(items, bins)[0].items[0].size == (1.5, 1, 1200)
    items = workbook(tmp_path, ("a", [["WIDTH", "HEIGHT"], [2, "1.200"]]))
    assert_refused(lambda: read_job(items, bins), "row 2, column HEIGHT: '1.200' may be ")
    items = workbook(tmp_path, ("a", [["WIDTH", "HEIGHT"], [2, True]]))
    assert_refused(lambda: read_job(items, bins), "row 2, column HEIGHT: True is not a number")


def test_bad_workbooks(tmp_path):
    bins = file_with(tmp_path, "bins.csv", BINS_3D)
    broken = {
        "text": b"X,Y,Z\n1,2,3\n",
        "cut": workbook(tmp_path, ("a", FLAT)).read_bytes()[:-200],
        "nothing": b"",
    }
    for text in broken.values():
        path = file_with(tmp_path, "a.xlsx", text)
        assert_refused(lambda path=path: read_job(path, bins), "a.xlsx: not a workbook (")
    with zipfile.ZipFile(path, "w") as parts:
        parts.writestr("x.txt", "x")
    assert_refused(lambda: read_job(path, bins), "a.xlsx: not a workbook (")
    assert_refused(lambda: read_job(workbook(tmp_path, ("a", [])), bins), "the file is empty")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as parts:
        parts.writestr("x.txt", bytes(300 * 2**20))
    assert_refused(lambda: read_job(path, bins), "a.xlsx: too large when it is unpacked")


def test_a_workbook_of_billions_of_rows(tmp_path):
    path = workbook(tmp_path, ("a", FLAT))
    with zipfile.ZipFile(path) as parts:
        contents = {name: parts.read(name) for name in parts.namelist()}
    sheet = "xl/worksheets/sheet1.xml"
    contents[sheet] = contents[sheet].replace(b'<row r="4"', b'<row r="4000000000"')
    with zipfile.ZipFile(path, "w") as parts:
        for name, data in contents.items():
            parts.writestr(name, data)
    assert_refused(lambda: read_job(path, path), "items.xlsx: more than 250,000 rows: split it")


def test_a_workbook_without_what_reads_it(tmp_path, monkeypatch):
    original = builtins.__import__

    def without(name, *arguments, **named):
        if name == "openpyxl":
            raise ImportError(name)
        return original(name, *arguments, **named)

    path = workbook(tmp_path, ("a", FLAT))
    monkeypatch.setattr(builtins, "__import__", without)
    what = "reading it takes openpyxl: install it with pip install 'jaxpack[xlsx]'"
    assert_refused(lambda: read_job(path, path), what)


def test_what_is_too_large(tmp_path, monkeypatch):
    wide = ",".join(f"C{number}" for number in range(100_000)) + ",X,Y,Z\n"
    assert_refused(lambda: read(tmp_path, wide, BINS_3D), "100,003 columns, more than 1,000")
    monkeypatch.setattr("jaxpack.io.spreadsheets.MOST_ROWS", 10)
    rows = itertools.repeat("1,1,1\n", 11)
    assert_refused(lambda: read(tmp_path, "X,Y,Z\n" + "".join(rows), BINS_3D), "more than 10 rows")
    monkeypatch.setattr("jaxpack.io.texts.MOST_BYTES", 2**20)
    assert_refused(lambda: read(tmp_path, "X,Y,Z\n" + " " * 2**20, BINS_3D), "more than 1 MiB")
