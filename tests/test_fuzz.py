"""Whatever a file or a table holds, nothing but a UserError of one line comes out.

It ends, and takes little memory: a mutation that breaks this is named by its number, which is the
seed that makes it again.
"""

import io
import json
import random
import resource
import tempfile
import zipfile
from pathlib import Path

import openpyxl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from job_files import (
    BINS_2D,
    BINS_3D,
    FLAT_CERTIFICATE,
    FLAT_JOB,
    FLAT_PLAN,
    INS2D,
    ITEMS_2D,
    ITEMS_3D,
    ORDERS,
    SOLID_CERTIFICATE,
    SOLID_JOB,
    SOLID_PLAN,
    assert_one_line,
    file_with,
    stopped_after,
)

from jaxpack.errors import UserError
from jaxpack.io.certificates import read_certificate
from jaxpack.io.jobs import job_from_columns, read_job
from jaxpack.io.plans import read_plan_json, write_plan_json

SECONDS = 60  # of computing for a file: what ends takes one at most, what is quadratic hours
MEMORY = 500 * 2**20  # bytes

LOCAL = ITEMS_3D.replace("3,4,5,2", '"3,5",1.200,"1.234,5",2').replace(",", ";").replace('"', "")
CALLED = "Length (mm),Width (mm),Height (mm),COPIES,WEIGHT,NAME\n300,200,100,2,1.5,a\n30,20,10,,,\n"
FOREIGN = "ID,X,Y,Z,COPIES,COPIES_MIN,PROFIT,GROUP_ID,WEIGHT\n0,3,4,5,2,2,60,0,1.5\n"


def workbook(text):
    """A CSV text as a workbook."""
    book = openpyxl.Workbook()
    for line in text.splitlines():
        book.active.append(
            [float(c) if c.replace(".", "").isdigit() else c for c in line.split(",")]
        )
    data = io.BytesIO()
    book.save(data)
    return data.getvalue()


def plan_text(job, plan):
    with tempfile.TemporaryDirectory() as folder:
        write_plan_json(Path(folder) / "plan.json", job, plan)
        return (Path(folder) / "plan.json").read_bytes()


LIMITED = (
    "X,Y,Z,MAXIMUM_WEIGHT_ABOVE,STACKABLE,MAXIMUM_STACKABILITY,STACKABILITY_ID,GROUP,APART,STOP,FLOOR"
    "\n3,4,5,1.5,0,2,1,a,b,1,1\n3,4,5,inf,,,,,,,\n"
)
TABLES = [
    text.encode()
    for text in (ITEMS_2D, ITEMS_3D, BINS_2D, BINS_3D, LOCAL, CALLED, FOREIGN, LIMITED)
]
TABLES += [ITEMS_3D.encode("utf-16"), "X;Y;Z;NAME\n3;4;5;Größe\n".encode("cp1252")]
SOURCES = {  # name of the file -> what is in it before it is changed
    "a.csv": TABLES,
    "a.xlsx": [workbook(text) for text in (ITEMS_2D, ITEMS_3D, CALLED)],
    "a.ins2D": [INS2D.encode()],
    "a.json": [json.dumps(ORDERS).encode(), json.dumps(ORDERS, indent=1).encode()],
    "certificate": [FLAT_CERTIFICATE.encode(), SOLID_CERTIFICATE.encode()],
    "plan": [plan_text(FLAT_JOB, FLAT_PLAN), plan_text(SOLID_JOB, SOLID_PLAN)],
}
TOKENS = [
    *(
        b",",
        b"\n",
        b"\r",
        b'"',
        b";",
        b"\t",
        b"\0",
        b"-",
        b"-1",
        b"0",
        b"1e999",
        b"nan",
        b" ",
        b".",
    ),
    *(b"{", b"}", b"[", b"]", b":", b"null", b"true", b"TRUE", b"\\ud800", b"\xef\xbb\xbf", b"x"),
    *(b"\xff\xfe", b"\xff", b"\xc3", b"inf", b"Infinity", b"1e7", b"1.200", b"1,200", b"1e999999"),
    *(
        b"sep=;\n",
        b"X",
        b"QTY",
        b"LENGTH (CM)",
        b"MAXIMUM_WEIGHT",
        b"COPIES_MIN",
        b"ORIENTED",
        b"=1",
    ),
    *(b"9" * 5000, b"[" * 3000, b"a" * 140_000, b",0" * 2000, b"<", b">", b"&lol;", b"</c>"),
]


def mutated(data, random):
    """The bytes with up to four pieces of them changed."""
    for _ in range(random.randint(1, 4)):
        start = random.randint(0, len(data))
        end = min(len(data), start + random.choice((0, 1, 1, 2, 5, 40)))
        piece = data[start:end]
        kind = random.randint(0, 4)
        if kind == 0 and piece:
            place = random.randrange(len(piece))
            flipped = bytes([piece[place] ^ 1 << random.randint(0, 7)])
            piece = piece[:place] + flipped + piece[place + 1 :]
        elif kind == 1:
            piece *= random.choice((0, 2, 3, 300))
        elif kind == 2 and random.random() < 0.1:
            return data[:start]
        else:
            piece = random.choice(TOKENS)
        data = data[:start] + piece + data[end:]
    return data


def mutated_workbook(data, random):
    """A workbook of which the file, or one of the parts in it, is changed."""
    if random.random() < 0.3:
        return mutated(data, random)
    with zipfile.ZipFile(io.BytesIO(data)) as parts:
        contents = {name: parts.read(name) for name in parts.namelist()}
    name = random.choice([name for name in contents if "sheet" in name or "Strings" in name])
    contents[name] = mutated(contents[name], random)
    again = io.BytesIO()
    with zipfile.ZipFile(again, "w") as parts:
        for part, text in contents.items():
            parts.writestr(part, text)
    return again.getvalue()


def assert_read_or_refused(call):
    try:
        return call()
    except UserError as error:
        assert_one_line(error)
        return None


def read_mutation(folder, number):
    """Reads the mutation of that number, as items or bins or a plan."""
    choice = random.Random(number)
    name = choice.choice(sorted(SOURCES))
    change = mutated_workbook if name == "a.xlsx" else mutated
    path = file_with(folder, name, change(choice.choice(SOURCES[name]), choice))
    how = {"packingsolver": choice.random() < 0.3, "say": assert_one_line}
    if name in ("certificate", "plan"):
        job = choice.choice((FLAT_JOB, SOLID_JOB))
        again = read_certificate if name == "certificate" else read_plan_json
        return assert_read_or_refused(lambda: again(path, job))
    other = file_with(folder, "bins.csv", choice.choice((BINS_2D, BINS_3D)))
    pair = (other, path) if name in ("a.csv", "a.xlsx") and choice.random() < 0.4 else (path, other)
    bins = None if name in ("a.ins2D", "a.json") and choice.random() < 0.5 else pair[1]
    return assert_read_or_refused(lambda: read_job(pair[0], bins, **how))


def most_memory():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def read_mutations(folder, numbers):
    before = most_memory()
    for number in numbers:
        with stopped_after(SECONDS):
            jobs = read_mutation(folder, number)
        for job in jobs if isinstance(jobs, list) else ():
            assert 1 <= job.count <= 100_000, number
            sides = [side for kind in (*job.items, *job.bins) for side in kind.size]
            assert all(0 < side <= 1e13 for side in sides), number
    assert most_memory() - before < MEMORY


def test_mutations_are_read_or_refused(tmp_path):
    read_mutations(tmp_path, range(2000))


@pytest.mark.slow
def test_many_mutations_are_read_or_refused(tmp_path):
    read_mutations(tmp_path, range(2000, 102_000))


HUGE = {
    "a million columns": ("a.csv", ",".join(["X"] * 1_000_000)),
    "a million cells": ("a.csv", "X,Y,Z\n" + "1," * 1_000_000),
    "a million quotes": ("a.csv", "X,Y,Z\n" + '"' * 1_000_001),
    "a million rows": ("a.csv", "X,Y,Z\n" + "1,1,1\n" * 1_000_000),
    "long cells": ("a.csv", "X,Y,Z\n" + f"{'9' * 100_000},1,1\n" * 20),
    "long names": ("a.csv", f"X,Y,Z,{','.join(f'{n}' * 9000 for n in range(300))}\n1,1,1\n"),
    "long cells of commas": ("a.csv", 'X;Y;Z\n"' + "1." * 60_000 + '";1;1\n'),
    "a huge exponent": ("a.csv", "X,Y,Z\n1e999999999,1,1\n"),
    "a tiny exponent": ("a.csv", "X,Y,Z,WEIGHT\n1,1,1,1e-999999999\n"),
    "digits": ("a.csv", "X,Y,Z,NAME\n1,1,1," + "9" * 100_000),
    "no number": ("a.ins2D", f"1\n9 9\n1 {'9' * 1_000_000} 1\n"),
    "fields": ("a.ins2D", f"1\n9 9\n1 1{' 1' * 1_000_000}\n"),
    "nested lists": ("a.json", "[" * 100_000),
    "nested objects": ("a.json", '{"a":' * 100_000),
    "digits in JSON": ("a.json", '{"o": {"item_sequence": {"1": {"length/mm": ' + "9" * 10**6),
    "twice": ("a.json", "{" + ", ".join(f'"{n % 199_999}": 1' for n in range(200_000)) + "}"),
    "items": (
        "a.json",
        '{"o": {"item_sequence": {' + ",".join(f'"{n}": 1' for n in range(200_000)),
    ),
}


@pytest.mark.parametrize("kind", HUGE)
def test_huge_files_are_read_or_refused(tmp_path, kind):
    name, text = HUGE[kind]
    path, bins = file_with(tmp_path, name, text), file_with(tmp_path, "bins.csv", BINS_3D)
    before, notes = most_memory(), []
    with stopped_after(SECONDS):
        assert_read_or_refused(lambda: read_job(path, bins, say=notes.append))
    assert most_memory() - before < MEMORY
    assert all(len(line) < 1000 for line in notes)


@pytest.mark.parametrize("column", ["X", "COPIES", "WEIGHT", "ROTATION_XYZ", "NAME", "COPIES_MIN"])
def test_numbers_of_thousands_of_digits_in_columns(column):
    table = {"X": [1], "Y": [1], "Z": [1], column: [10**5000]}
    assert_read_or_refused(lambda: job_from_columns(table, {"X": [9], "Y": [9], "Z": [9]}))


BOXES = {"X": [9, 9], "Y": [9, 9], "Z": [9, 9]}
CELLS = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=3), st.binary(max_size=2)
)
COLUMNS = st.sampled_from(
    ["X", "Y", "Z", "WIDTH", "HEIGHT", "COPIES", "WEIGHT", "ROTATION_XYZ", "COST"]
)


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
