"""Streams of orders: parts that are the same whatever happens, and orders as rows."""

import json
import random
import resource
import signal
import subprocess
import sys
import time
from os import environ, pathsep
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import jaxpack
from jaxpack.errors import UserError

ROOM = {"X": [10], "Y": [10], "Z": [10], "NAME": ["box"]}


def made_orders(count, seed=0):
    """A table of orders of one to four rows."""
    draw = random.Random(seed)
    rows = [
        {
            "ORDER": f"order {number}",
            **{side: draw.randint(2, 7) for side in "XYZ"},
            "COPIES": draw.randint(1, 4),
            "ROTATION_XYZ": 1,
            "ROTATION_YXZ": draw.randint(0, 1),
        }
        for number in range(count)
        for _ in range(draw.randint(1, 4))
    ]
    return pa.Table.from_pylist(rows)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "bins.csv").write_text("X,Y,Z,NAME\n10,10,10,box\n")
    return tmp_path


def start(folder, *options, orders="orders.parquet", out="out"):
    command = [sys.executable, "-m", "jaxpack", "stream", orders, "bins.csv", out, *options]
    paths = environ | {"PYTHONPATH": pathsep.join(sys.path)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, cwd=folder, env=paths, **pipes)


def run(folder, *options, **files):
    """(exit code, output, errors) of a command."""
    process = start(folder, "--workers", "1", *options, **files)
    output, errors = process.communicate(timeout=300)
    return process.returncode, output, errors


def read(out, name):
    return pa.concat_tables(map(pq.read_table, sorted(Path(out).glob(f"{name}-*.parquet"))))


def contents(out):
    return {path.name: path.read_bytes() for path in Path(out).iterdir()}


def same_after_kills(folder, options, kills):
    """Whether a run that is killed now and then ends with the bytes of one that is not."""
    begun = time.perf_counter()
    code, _, errors = run(folder, *options, out="whole")
    assert code == 0, errors
    draw, seconds, killed = random.Random(1), time.perf_counter() - begun, 0
    while killed < kills:
        process = start(folder, "--workers", "1", *options)
        try:
            process.communicate(timeout=draw.uniform(0.3, 0.7) * seconds)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
        killed += process.returncode == -signal.SIGKILL
        if process.returncode == 0:  # done: begin anew
            for path in (folder / "out").iterdir():
                path.unlink()
    assert run(folder, *options)[0] == 0
    return contents(folder / "out") == contents(folder / "whole")


def test_the_parts_are_what_solve_many_gives(folder):
    table = made_orders(50)
    pq.write_table(table, folder / "orders.parquet", row_group_size=7)  # orders go across them
    code, output, errors = run(folder, "--chunk", "20", "--packings", "4")
    assert code == 0, errors
    placements, figures = jaxpack.solve_many(table, ROOM, packings=4, workers=1)
    assert read(folder / "out", "placements").to_pydict() == placements.to_pydict()
    assert read(folder / "out", "figures").to_pydict() == figures.to_pydict()
    manifest = json.loads((folder / "out" / "manifest.json").read_text())
    assert manifest["complete"]
    assert [part["orders"] for part in manifest["parts"]] == [20, 20, 10]
    assert manifest["totals"]["bins"] == sum(figures["BINS"].to_pylist())
    assert "50 orders in 3 parts" in output


@pytest.mark.long
def test_five_kills_change_no_byte(folder):
    pq.write_table(made_orders(200), folder / "orders.parquet")
    assert same_after_kills(folder, ("--chunk", "20", "--packings", "2"), 5)


@pytest.mark.slow
def test_kills_change_no_byte_of_many_orders(folder):
    pq.write_table(made_orders(2_000), folder / "orders.parquet")
    assert same_after_kills(folder, ("--chunk", "100", "--packings", "2"), 10)


def test_a_part_that_is_damaged_is_made_again(folder):
    pq.write_table(made_orders(30), folder / "orders.parquet")
    assert run(folder, "--chunk", "10")[0] == 0
    before = contents(folder / "out")
    (folder / "out" / "figures-00001.parquet").write_bytes(b"half of it")
    (folder / "out" / "placements-00002.parquet").unlink()
    assert run(folder, "--chunk", "10")[0] == 0
    assert contents(folder / "out") == before


def test_a_bad_order_stops_no_other(folder):
    rows = [
        {"ORDER": name, "X": x, "Y": 1, "Z": 1}
        for name, x in [("a", 1), ("b", 99), ("c", None), ("a", 2), (None, 1), ("d", 3), ("d", 4)]
    ]
    pq.write_table(pa.Table.from_pylist(rows), folder / "orders.parquet", row_group_size=2)
    code, _, errors = run(folder, "--chunk", "2")
    assert code == 2
    figures = read(folder / "out", "figures").to_pylist()
    assert [row["ORDER"] for row in figures] == ["a", "b", "c", "a", "", "d"]
    status = [row["STATUS"] == "ERROR" for row in figures]
    assert status == [False, True, True, True, True, False]
    assert "row 2, column X" in figures[2]["MESSAGE"]
    assert "row 3, column ORDER: order 'a' has come before" in figures[3]["MESSAGE"]
    assert "row 4, column ORDER: empty" in figures[4]["MESSAGE"]
    assert figures[5]["ITEMS"] == 2
    assert "error: 4 orders cannot be packed" in errors
    assert run(folder, "--chunk", "2")[0] == 2  # as it is, the second time


def test_numbers_of_all_kinds_are_read(folder):
    table = made_orders(20)
    plain = jaxpack.solve_many(table, ROOM, packings=2, workers=1)
    order = table.column_names.index("ORDER")
    other = table.set_column(order, "order", table["ORDER"].dictionary_encode())
    for name, kind in {"X": pa.float32(), "Y": pa.decimal128(24, 2), "Z": pa.float64()}.items():
        other = other.set_column(other.column_names.index(name), name, other[name].cast(kind))
    copies = [None if one == 1 else one for one in other["COPIES"].to_pylist()]
    other = other.set_column(other.column_names.index("COPIES"), "COPIES", [copies])
    pq.write_table(other, folder / "orders.parquet")
    code, _, errors = run(folder, "--packings", "2")
    assert code == 0, errors
    assert read(folder / "out", "figures").to_pydict() == plain[1].to_pydict()


def test_short_floats_are_the_numbers_that_they_show():
    items = pa.table({"ORDER": ["a"], "X": pa.array([0.1], pa.float32()), "Y": [0.1], "Z": [0.1]})
    placements, _ = jaxpack.solve_many(items, ROOM, packings=1, workers=1)
    assert placements["LX"].to_pylist() == [0.1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("--packings", "3"), "manifest.json: is of another options: packings, 8 instead of 3"),
        pytest.param(
            ("--seed", "1"), "another options: seed, 0 instead of 1", marks=pytest.mark.long
        ),
        ((), "manifest.json: is of another input: bytes"),
        pytest.param(("--support", "2"), "--support 2: give a share", marks=pytest.mark.long),
        pytest.param(("--chunk", "0"), "--chunk: 0 is not possible", marks=pytest.mark.long),
        pytest.param(
            ("--ignore", "NOWHERE"),
            "--ignore 'NOWHERE': there is no such column",
            marks=pytest.mark.long,
        ),
    ],
)
def test_what_is_not_the_same_command_is_one_line(folder, change, message):
    pq.write_table(made_orders(10), folder / "orders.parquet")
    assert run(folder)[0] == 0
    before = contents(folder / "out")
    if not change:
        pq.write_table(made_orders(11), folder / "orders.parquet")
    code, _, errors = run(folder, *change)
    assert code == 2
    assert len(errors.splitlines()) == 1
    assert message in errors
    assert contents(folder / "out") == before


@pytest.mark.parametrize("kind", ["no Parquet", "no order", "files"])
def test_what_cannot_be_begun_is_one_line(folder, kind):
    table = made_orders(3)
    pq.write_table(table, folder / "orders.parquet")
    (folder / "out").mkdir()
    if kind == "no Parquet":
        (folder / "orders.parquet").write_text("X,Y,Z")
    elif kind == "no order":
        pq.write_table(table.drop_columns("ORDER"), folder / "orders.parquet")
    else:
        (folder / "out" / "precious.txt").touch()
    code, _, errors = run(folder)
    assert code == 2
    assert len(errors.splitlines()) == 1
    words = {"no Parquet": "no Parquet file", "no order": "column ORDER is missing"}
    assert words.get(kind, "precious.txt") in errors


def test_an_interrupt_keeps_what_is_done(folder):
    pq.write_table(made_orders(3_000), folder / "orders.parquet")
    process = start(folder, "--chunk", "20", "--workers", "1")
    end = time.monotonic() + 60
    while not [*folder.glob("out/figures-*.parquet")] and time.monotonic() < end:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "goes on from here" in errors
    manifest = json.loads((folder / "out" / "manifest.json").read_text())
    assert manifest["parts"]
    assert not manifest["complete"]
    assert "INTERRUPTED" not in read(folder / "out", "figures")["STATUS"].to_pylist()


def test_a_time_limit_is_that_of_all(folder):
    pq.write_table(made_orders(60), folder / "orders.parquet")
    begun = time.perf_counter()
    code, _, errors = run(folder, "--chunk", "20", "--time-limit", "3")
    assert code == 0, errors
    assert time.perf_counter() - begun < 120, "3 s for each would be 180"
    assert read(folder / "out", "figures").num_rows == 60


def as_dict(table):
    return {name: table[name].to_pandas().to_numpy() for name in table.column_names}


@pytest.mark.parametrize("kind", [lambda t: t, pa.Table.to_pandas, as_dict])
def test_a_batch_has_a_row_for_each_order(kind):
    flat = made_orders(12)
    rows = jaxpack.orders_as_rows(flat)
    found = jaxpack.solve_batch(kind(rows), bins=ROOM, packings=4)
    assert type(found) is type(kind(rows))
    placements, figures = jaxpack.solve_many(flat, ROOM, packings=4, workers=1)
    table = found if isinstance(found, pa.Table) else pa.table({n: list(found[n]) for n in found})
    names = ["ORDER", "STATUS", "BINS", "BOUND", "LEFT_OUT", "MESSAGE"]
    assert table.select(names).to_pylist() == figures.select(names).to_pylist()
    nested = [put for row in table["PLACEMENTS"].to_pylist() for put in row]
    assert nested == placements.drop_columns("ORDER").to_pylist()


def test_rows_of_a_batch_are_independent_and_in_order():
    rows = jaxpack.orders_as_rows(made_orders(8))
    whole = jaxpack.solve_batch(rows, bins=ROOM)
    back = jaxpack.solve_batch(rows.take([5, 2, 2]), bins=ROOM)
    assert back == whole.take([5, 2, 2])
    assert jaxpack.solve_batch(rows.slice(0, 0), bins=ROOM).schema == whole.schema


def test_a_bad_row_of_a_batch_stops_no_other():
    cube = {"X": 1, "Y": 1, "Z": 1}
    items = [[cube], [], None, [cube, cube | {"X": 99}], [cube | {"Y": None}], [cube]]
    table = pa.table({"ORDER": ["a", "b", "c", "d", "e", None], "ITEMS": items})
    found = jaxpack.solve_batch(table, bins=ROOM).to_pylist()
    assert [row["STATUS"] == "ERROR" for row in found] == [False, *[True] * 5]
    assert "row 0, column Y: empty" in found[4]["MESSAGE"]


def test_scattered_rows_of_an_order_come_together():
    flat = pa.table({"X": [1, 2, 3], "ORDER": ["b", "a", "b"]})
    expected = [{"ORDER": "b", "ITEMS": [{"X": 1}, {"X": 3}]}, {"ORDER": "a", "ITEMS": [{"X": 2}]}]
    assert jaxpack.orders_as_rows(flat).to_pylist() == expected
    with pytest.raises(UserError, match="row 1, column ORDER: empty"):
        jaxpack.orders_as_rows(pa.table({"X": [1, 2], "ORDER": ["b", None]}))


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"ORDER": np.array(["a"])}, "column ITEMS is missing"),
        ({"ORDER": ["a"], "ITEMS": [3]}, "is int64: give a list of items"),
        ({"ORDER": ["a"], "ITEMS": [[3]]}, "give items with named fields"),
        ({"ORDER": ["a"], "ITEMS": [[{"X": 1}, "b"]]}, "table: cannot be read"),
        ({"ORDER": ["a"], "ITEMS": [[{"X": 1, "Y": 1}]]}, "columns? .*Z"),
        (5, "table: cannot be read"),
    ],
)
def test_what_is_no_batch_is_one_line(table, message):
    with pytest.raises(UserError, match=message):
        jaxpack.solve_batch(table, bins=ROOM)


@pytest.mark.slow
def test_the_memory_does_not_grow_with_the_file(folder):
    peaks = []
    for count in (4_000, 20_000):
        pq.write_table(made_orders(count), folder / "orders.parquet", row_group_size=5_000)
        process = start(folder, "--packings", "1", "--workers", "2", out=f"out-{count}")
        peak = 0
        while process.poll() is None:
            peak = max(peak, sum(memory(number) for number in family(process.pid)))
            time.sleep(0.05)
        _, errors = process.communicate()
        assert process.returncode == 0, errors
        peaks.append(peak)
    assert peaks[1] < 1.15 * peaks[0], peaks
    assert peaks[1] < 2 * 2**30


def family(number):
    """A process and its children."""
    try:
        children = Path(f"/proc/{number}/task/{number}/children").read_text().split()
    except OSError:
        children = []
    return [number, *(one for child in children for one in family(int(child)))]


def memory(number):
    """Bytes that it holds."""
    try:
        pages = int(Path(f"/proc/{number}/statm").read_text().split()[1])
    except OSError:
        return 0
    return pages * resource.getpagesize()
