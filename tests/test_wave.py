"""Many orders at once: each has the plan that it would have alone."""

import csv
import gc
import json
import math
import os
import signal
import subprocess
import sys
import time
import weakref
from dataclasses import replace

import numpy as np
import pytest
from test_bin_values import job_of

import jaxpack
from jaxpack.errors import UserError
from jaxpack.many import pack_orders
from jaxpack.model.encoding import load_job
from jaxpack.model.objectives import bounds
from jaxpack.model.plan_check import check_plan
from jaxpack.model.rules import Rules
from jaxpack.search.beam import fill
from jaxpack.search.bin_values import values_asked
from jaxpack.search.portfolio import SolveOptions
from jaxpack.search.record import End, Progress
from jaxpack.search.together import fill_together
from jaxpack.search.wave import pack_wave

KINDS = (
    {"copies": 9},
    {"types": 2, "copies": 3},
    {"weights": True},
    {"kinds": 9, "copies": 1},
    {"ways": ("XYZ",)},
    {"dimension": 2, "copies": 4},
)
PACKINGS = SolveOptions(packings=6)


def never():
    return False


def orders_of(number):
    """Orders of many kinds, with names."""
    jobs = [job_of(seed, **KINDS[seed % len(KINDS)]) for seed in range(number)]
    return [replace(job, name=f"order {n}") for n, job in enumerate(jobs)]


def plans(found):
    return [one.plan for one in found]


def test_bins_filled_together_are_filled_as_alone():
    asked = [next(values_asked(load_job(job), 0, never)) for job in orders_of(18)]
    for one, together in zip(asked, fill_together(asked, never), strict=True):
        alone = fill(*one, never)
        for name in alone._fields:
            if name in ("near", "far", "row", "grid", "firm"):  # as long as the longest of the bins
                M = getattr(alone, name).shape[-2]
                rest = getattr(together, name)[..., M:, :]
                assert not rest.any()
                together = together._replace(**{name: getattr(together, name)[..., :M, :]})
            np.testing.assert_array_equal(getattr(alone, name), getattr(together, name), name)


def test_a_plan_depends_on_no_other_order():
    jobs = orders_of(14)
    whole = plans(pack_wave(jobs, PACKINGS))
    for job, plan in zip(jobs, whole, strict=True):
        check_plan(job, plan)
    assert plans(pack_wave(jobs[::-1], PACKINGS)) == whole[::-1]
    assert [plans(pack_wave([job], PACKINGS))[0] for job in jobs] == whole
    on_two = pack_orders(jobs, PACKINGS, workers=2)
    assert plans(on_two) == whole


ON_DEVICES = """
import sys
sys.path.insert(0, "tests")
import jax
jax.config.update("jax_num_cpu_devices", 8)
from test_wave import PACKINGS, orders_of, plans
from jaxpack.many import pack_orders
jobs = orders_of(6)
first, *others = (plans(pack_orders(jobs, PACKINGS, 1, devices=n)) for n in (None, 1, 2, 8))
assert others == [first] * 3
"""


@pytest.mark.slow
def test_a_plan_does_not_depend_on_the_devices():
    subprocess.run([sys.executable, "-c", ON_DEVICES], check=True, timeout=900)


def test_a_plan_does_not_depend_on_the_order_of_rows():
    for job in orders_of(8):
        (one,) = plans(pack_wave([job], PACKINGS))
        turned = replace(job, items=job.items[::-1])
        (other,) = plans(pack_wave([turned], PACKINGS))
        check_plan(turned, other)
        last = len(job.items) - 1
        placed = [
            sorted(
                (put.corner, put.orientation, job.items[put.item].size) for put in packed.placements
            )
            for packed in one.bins
        ]
        assert placed == [
            sorted(
                (put.corner, put.orientation, job.items[last - put.item].size)
                for put in packed.placements
            )
            for packed in other.bins
        ]


def test_orders_that_cannot_be_packed_stop_no_other():
    jobs = orders_of(6)
    room = jobs[2].bins[0].size
    large = replace(jobs[2].items[0], size=tuple(9 * side for side in room))
    jobs[2] = replace(jobs[2], items=(large,))
    found = pack_wave(jobs, PACKINGS)
    assert isinstance(found[2], UserError)
    assert all(isinstance(one, Progress) for n, one in enumerate(found) if n != 2)


@pytest.mark.parametrize("seconds", [1e-6, 0.02, 0.04, 0.08, 0.15, 0.3])
def test_every_order_has_a_plan_when_time_is_short(seconds):
    jobs = orders_of(18)
    for one, job in zip(pack_wave(jobs, SolveOptions(time_limit=seconds)), jobs, strict=True):
        check_plan(job, one.plan)
        assert not one.plan.left_out


def test_more_packings_are_never_worse():
    jobs = orders_of(12)
    few, more = (pack_wave(jobs, SolveOptions(packings=n)) for n in (1, 5))
    for one, other in zip(few, more, strict=True):
        assert (other.bins, other.cost) <= (one.bins, one.cost)
        assert other.packings <= 5 + 1


@pytest.mark.parametrize("limit", [None, 30.0])
def test_bounds_have_no_more_time_than_there_is(monkeypatch, limit):
    asked, now = [], 0.0

    def clock():
        nonlocal now
        now += 0.001  # whatever else runs on the machine
        return now

    def none(job, seconds, rules):  # so that all orders go on until bounds are looked for
        asked.append((seconds, now))
        found = bounds(job, 0.0, rules)
        return replace(found, worth=(0, 0, 0), best=0.0)

    monkeypatch.setattr("jaxpack.search.wave.perf_counter", clock)
    monkeypatch.setattr("jaxpack.search.wave.bounds", none)
    pack_wave(orders_of(3), SolveOptions(packings=12, time_limit=limit))
    later = [(seconds, at) for seconds, at in asked if seconds != 0.0]
    assert len(later) == 3
    for seconds, at in later:
        assert seconds == (math.inf if limit is None else pytest.approx(limit - at, abs=0.01))


def test_what_ended_an_order_is_said():
    jobs = orders_of(12)
    short = pack_wave(jobs, SolveOptions(time_limit=0.05, packings=10_000))
    assert {one.end for one in short} <= {End.TIME, End.BOUND}
    few = pack_wave(jobs, PACKINGS)
    assert {one.end for one in few} <= {End.BUDGET, End.BOUND}


def test_an_interrupt_keeps_what_there_is():
    jobs, told = orders_of(40), []
    found = pack_wave(
        jobs, SolveOptions(packings=40), lambda: len(told) > 3, lambda *one: told.append(one)
    )
    for one, job in zip(found, jobs, strict=True):
        if one is not None:
            check_plan(job, one.plan)
    assert any(one is not None for one in found)


COLUMNS = {
    "ORDER": ["b", "a", "b", "c", "d"],
    "X": [3, 4, 2, 3, 99],
    "Y": [3, 4, 2, "?", 1],
    "Z": [3, 4, 2, 3, 1],
    "COPIES": [2, 8, 1, 1, 1],
}
BINS = {"X": [8], "Y": [8], "Z": [8], "NAME": ["box"]}


def test_what_ended_holds_no_memory():
    jobs = orders_of(6)
    alive = [weakref.ref(job) for job in jobs]
    gc.disable()  # it frees what refers to itself, but seldom
    try:
        pack_wave(jobs, replace(PACKINGS, packings=1))
        del jobs
        assert not any(one() for one in alive)
    finally:
        gc.enable()


def test_tables_of_a_program():
    placements, figures = jaxpack.solve_many(COLUMNS, BINS, packings=2)
    assert [*zip(figures["ORDER"], figures["STATUS"], figures["BINS"], strict=True)] == [
        ("b", "OPTIMAL", 1),
        ("a", "OPTIMAL", 1),
        ("d", "ERROR", 0),
        ("c", "ERROR", 0),
    ]
    assert "orders: row 3, column Y: '?' is not a number" in figures["MESSAGE"][3]
    assert placements["ORDER"] == ["b"] * 3 + ["a"] * 8
    assert set(placements["BIN_TYPE"]) == {"box"}
    assert sorted(placements["ITEM"][:3]) == [0, 0, 1]


def test_tables_are_of_the_kind_that_came():
    pyarrow = pytest.importorskip("pyarrow")
    orders = pyarrow.table({name: list(map(str, COLUMNS[name])) for name in COLUMNS})
    placements, figures = jaxpack.solve_many(orders, BINS, packings=2)
    assert isinstance(placements, pyarrow.Table)
    assert figures.column("STATUS").to_pylist().count("OPTIMAL") == 2


def test_what_is_wrong_with_all_orders_is_an_error():
    with pytest.raises(UserError, match="orders: column ORDER is missing"):
        jaxpack.solve_many({"X": [1], "Y": [1], "Z": [1]}, BINS)
    with pytest.raises(UserError, match="workers: 0 is not possible"):
        jaxpack.solve_many(COLUMNS, BINS, workers=0)
    with pytest.raises(UserError, match="support 2"):
        jaxpack.solve_many(COLUMNS, BINS, support=2)


def rows_of(path):
    return [*csv.DictReader(path.read_text().splitlines())]


def write_orders(folder, number):
    """orders.csv and bins.csv of so many orders."""
    random = np.random.default_rng(0)
    with open(folder / "orders.csv", "w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["ORDER", "X", "Y", "Z", "COPIES"])
        for order in range(number):
            for _ in range(random.integers(1, 6)):
                rows.writerow([f"o{order}", *random.integers(1, 8, 3), random.integers(1, 6)])
    (folder / "bins.csv").write_text("X,Y,Z\n10,9,8\n7,7,7\n")


def command(folder, *options):
    return subprocess.Popen(
        [sys.executable, "-m", "jaxpack.solve", "orders.csv", "bins.csv", *options],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.getcwd()},
    )  # fmt: skip


def test_the_command_packs_all_orders_of_a_file(tmp_path):
    write_orders(tmp_path, 30)
    with open(tmp_path / "orders.csv", "a") as file:
        file.write("wrong,1,x,1,1\n,1,1,1,1\n")
    process = command(
        tmp_path, "--packings", "3", "--placements", "p.csv", "--figures", "f.csv",
        "--workers", "2",
    )  # fmt: skip
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 2, errors
    assert "column Y: 'x' is not a number" in errors
    assert "column ORDER: empty: say which order the item belongs to" in errors
    figures = rows_of(tmp_path / "f.csv")
    assert len(figures) == 32
    assert [row["STATUS"] for row in figures].count("ERROR") == 2
    placed = rows_of(tmp_path / "p.csv")
    assert len(placed) == sum(int(row["ITEMS"]) for row in figures)
    assert "30 orders" in output


def test_ctrl_c_keeps_what_is_done(tmp_path):
    write_orders(tmp_path, 60)
    process = command(tmp_path, "--time-limit", "60", "--figures", "f.csv", "--workers", "2")
    time.sleep(4)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 130, errors
    assert "interrupted: " in errors
    assert (tmp_path / "f.csv").exists()


def test_bed_bpp_orders_are_packed_together(tmp_path):
    item = {"article": "a", "id": "1", "product_group": "g", "weight/kg": 1.0, "sequence": 1}
    item |= {"length/mm": 400, "width/mm": 300, "height/mm": 200}
    orders = {name: {"item_sequence": {"1": item, "2": item}} for name in "xyz"}
    orders["broken"] = {"item_sequence": {"1": {}}}
    (tmp_path / "orders.json").write_text(json.dumps(orders))
    process = subprocess.run(
        [sys.executable, "-m", "jaxpack.solve", "orders.json", "--figures", "f.csv"],
        cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False,
        env=os.environ | {"PYTHONPATH": os.getcwd()},
    )  # fmt: skip
    assert process.returncode == 2
    assert "order 'broken'" in process.stderr
    figures = rows_of(tmp_path / "f.csv")
    assert [row["BINS"] for row in figures] == ["1", "1", "1", "0"]


def test_rules_hold_in_a_wave():
    jobs = orders_of(8)
    for support in (0.0, 1.0):
        how = replace(PACKINGS, rules=Rules(support))
        for one, job in zip(pack_wave(jobs, how), jobs, strict=True):
            check_plan(job, one.plan, Rules(support))
