"""PackingSolver's files, against what its version 0.1.1233 wrote.

Each record of packingsolver.json has tables of our own and what its `InstanceBuilder` read from
them, as its `Instance.write` wrote it down, and the certificate of its plan (`Solution.write`).
"""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from job_files import BINS_2D, BINS_3D, assert_refused, file_with, notes_of, read

from jaxpack.io.certificates import read_certificate, write_certificate
from jaxpack.model.job import FLAT_TURNED

RECORDS = json.loads((Path(__file__).parent / "packingsolver.json").read_text())
IDS = [f"{record['problem']}: {record['what']}" for record in RECORDS]


def said(job):
    """What a job says, of which some may be said in two ways."""
    items = tuple(replace(item, name="") for item in job.items)
    bins = tuple(
        replace(
            kind,
            name="",
            cost=float(kind.price_of()),
            copies=job.count if kind.copies is None else min(kind.copies, job.count),
        )
        for kind in job.bins
    )
    return items, bins, job.dimension


@pytest.mark.parametrize("record", RECORDS, ids=IDS)
def test_its_files_are_read_as_it_reads_them(tmp_path, record):
    (job,) = read(tmp_path, record["items"], record["bins"], packingsolver=True)
    (same,) = read(tmp_path, record["written items"], record["written bins"], packingsolver=True)
    assert said(job) == said(same)
    (here,) = read(tmp_path, record["written items"], record["written bins"])
    assert here == same  # what it writes says all, so that both read it alike


@pytest.mark.parametrize(
    "record", [r for r in RECORDS if r["problem"] != "boxstacks"], ids=lambda r: r["what"]
)
def test_its_certificates_come_back_to_the_letter(tmp_path, record):
    (job,) = read(tmp_path, record["items"], record["bins"], packingsolver=True)
    path = file_with(tmp_path, "c.csv", record["certificate"])
    plan = read_certificate(path, job)
    assert plan.left_out == ()
    write_certificate(tmp_path / "again.csv", job, plan)
    assert (tmp_path / "again.csv").read_text() == record["certificate"]


def test_its_stacks_are_read(tmp_path):
    (record,) = (record for record in RECORDS if record["problem"] == "boxstacks")
    (job,) = read(tmp_path, record["items"], record["bins"], packingsolver=True)
    plan = read_certificate(file_with(tmp_path, "c.csv", record["certificate"]), job)
    assert (plan.left_out, len(plan.bins)) == ((), 1)


def test_what_is_read_otherwise_without_being_asked(tmp_path):
    flat, solid = "WIDTH,HEIGHT\n3,4\n", "X,Y,Z,ROTATION_XYZ\n3.5,4,5,0\n"
    (job,) = read(tmp_path, flat, "WIDTH,HEIGHT\n9,9\n")
    assert (job.items[0].orientations, job.bins[0].copies) == (("XYZ",), None)
    (job,) = read(tmp_path, flat, "WIDTH,HEIGHT\n9,9\n", packingsolver=True)
    assert (job.items[0].orientations, job.bins[0].copies) == (FLAT_TURNED, 1)
    assert_refused(lambda: read(tmp_path, solid, BINS_3D), "row 2: columns ROTATION_XYZ: all are 0")
    job, notes = notes_of(tmp_path, solid, BINS_3D, packingsolver=True)
    assert (job.items[0].orientations, job.items[0].size) == (("XYZ",), (3, 4, 5))
    (note,) = notes
    assert "items.csv: row 2, column X: 3.5 is read without its decimals" in note


def test_a_limit_of_minus_one(tmp_path):
    bins = "WIDTH,HEIGHT,COPIES,MAXIMUM_WEIGHT\n9,9,-1,-1\n9,9,2,inf\n"
    (job,) = read(tmp_path, "WIDTH,HEIGHT\n3,4\n", bins)
    assert [(kind.copies, kind.max_weight) for kind in job.bins] == [
        (None, math.inf),
        (2, math.inf),
    ]
    job, notes = notes_of(tmp_path, "WIDTH,HEIGHT\n3,4\n", bins, packingsolver=True)
    assert [kind.copies for kind in job.bins] == [0, 2]
    assert "bins.csv: row 2, column MAXIMUM_WEIGHT: -1 is a limit that nothing keeps to" in notes[0]


@pytest.mark.parametrize("side", ["0.5", "1e3"])
def test_what_it_would_misread_is_refused(tmp_path, side):
    items = f"WIDTH,HEIGHT\n3,{side}\n"
    assert_refused(lambda: read(tmp_path, items, BINS_2D, packingsolver=True), "row 2, column HEIG")
