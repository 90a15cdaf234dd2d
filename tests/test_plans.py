"""Plans in files: written, read again, and refused in one line."""

import csv
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from job_files import (
    FLAT_CERTIFICATE,
    FLAT_JOB,
    FLAT_PLAN,
    SOLID_CERTIFICATE,
    SOLID_JOB,
    SOLID_PLAN,
    assert_refused,
    file_with,
)

from jaxpack.errors import UserError
from jaxpack.io.certificates import read_certificate, write_certificate
from jaxpack.io.plans import read_plan_json, write_plan_json
from jaxpack.io.steps import write_steps
from jaxpack.model.job import (
    FLAT_TURNED,
    ORIENTATIONS,
    BinType,
    ItemType,
    Job,
    PackedBin,
    Placement,
    Plan,
)


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
    ("ITEM,1,1,0,4", "ITEM,1,1,0,nan", "row 4, column X: 'nan' is not a number"),
    (",ZXY", "", "row 4, column ROTATION: '' is not known"),
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
    ("[4, 0, 5]", '[4, 0, "up"]', "bin 0, item 1, key 'position': 'up' is not a number"),
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


@pytest.mark.parametrize("write", [write_certificate, write_plan_json, write_steps])
def test_a_place_that_cannot_be_written(tmp_path, write):
    for path, message in (
        (tmp_path / "no" / "plan", "cannot be written (No such file or directory)"),
        (tmp_path, "cannot be written (Is a directory)"),
        (Path(), "names no file"),
    ):
        assert_refused(lambda path=path: write(path, FLAT_JOB, FLAT_PLAN), message)


# Any job and plan, possible or not, comes back as it was.

DECIMALS = st.integers(1, 10**8).map(lambda hundredths: hundredths / 100)
WHOLE = st.integers(1, 10**6).map(float)
FLOATS = st.floats(1e-3, 1e6)
NAMES = st.text(max_size=4)


@st.composite
def jobs_with_plans(draw):
    flat = draw(st.booleans())
    lengths = draw(st.sampled_from([FLOATS, DECIMALS, WHOLE]))
    allowed = FLAT_TURNED if flat else tuple(ORIENTATIONS)
    sides = st.tuples(lengths, st.just(1.0) if flat else lengths, lengths)
    items = draw(
        st.lists(st.builds(ItemType, sides, weight=st.floats(0, 1e6), name=NAMES), min_size=1)
    )
    bins = draw(st.lists(st.builds(BinType, sides, name=NAMES), min_size=1, max_size=3))
    place = st.one_of(st.just(0.0), lengths)
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


def lengths_of(job, plan):
    axes = (0, 2) if job.dimension == 2 else (0, 1, 2)
    for one in plan.bins:
        yield from (job.bins[one.bin].size[axis] for axis in axes)
        for placed in one.placements:
            sides = (*zip(placed.corner, job.items[placed.item].size, strict=True),)
            yield from (side for axis in axes for side in sides[axis])


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
        write_steps(path, job, plan)
        notes = []
        try:
            write_certificate(path, job, plan, notes.append)
        except UserError:
            assert any(side != round(side, 2) for side in lengths_of(job, plan))
            return
        again = read_certificate(path, job)
        cells = [cell for line in path.read_text().splitlines()[1:] for cell in line.split(",")]
    assert not any("." in cell for cell in cells)
    whole = all(side.is_integer() for side in lengths_of(job, plan))
    assert whole == (notes == [])
    assert again.left_out == plan.left_out
    assert geometry(job, again) == geometry(job, plan)  # 2D: a square has no orientation there
    assert job.dimension == 2 or again == plan


def test_a_certificate_of_decimals_is_written_in_whole_numbers(tmp_path):
    path, notes = tmp_path / "c.csv", []
    write_certificate(path, FLAT_JOB, FLAT_PLAN, notes.append)
    assert notes == [
        f"{path}: all lengths are written times 4: PackingSolver's files have whole numbers only"
    ]
    fine = replace(FLAT_JOB, bins=(BinType((10.0, 1.0, 12.0001234)), FLAT_JOB.bins[1]))
    what = "round the sizes, or write the plan as .json"
    assert_refused(lambda: write_certificate(path, fine, FLAT_PLAN), f"{path}: ", what)
    large = replace(FLAT_JOB, bins=(BinType((10.0, 1.0, 999_999_999.0)), FLAT_JOB.bins[1]))
    assert_refused(lambda: write_certificate(path, large, FLAT_PLAN), f"{path}: ", what)
    assert path.read_text() == FLAT_CERTIFICATE


def test_stacks_in_a_certificate_are_passed_over(tmp_path):
    lines = SOLID_CERTIFICATE.splitlines(keepends=True)
    text = "".join([*lines[:2], "STACK,0,1,0,0,0,0,4,3,5,\n", *lines[2:]])
    assert read_certificate(file_with(tmp_path, "c.csv", text), SOLID_JOB) == SOLID_PLAN


FORMULAS = ['=HYPERLINK("http://x")', "+1", "-1", "@SUM(1)", "\t=1", "\r=1", " =1", "＝1"]


@pytest.mark.parametrize("name", FORMULAS)
def test_names_that_a_spreadsheet_would_run_are_written_as_text(tmp_path, name):
    path = tmp_path / "steps.csv"
    job = replace(FLAT_JOB, items=tuple(replace(item, name=name) for item in FLAT_JOB.items))
    write_steps(path, job, FLAT_PLAN)
    with path.open(newline="") as file:
        names = [row["NAME"] for row in csv.DictReader(file)]
    assert names == ["'" + name.replace("\r", " ")] * 3
