"""`python -m jaxpack.solve` and `jaxpack.solve`: tables in, checked plans out, or one line.

Where the search itself does not matter, one that puts every item into a bin of its own stands in
for it: nothing has to be compiled.
"""

import importlib
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from dataclasses import replace

import numpy as np
import psutil
import pytest

import jaxpack
from jaxpack import cli
from jaxpack.errors import UserError
from jaxpack.io.certificates import read_certificate
from jaxpack.io.plans import read_plan_json
from jaxpack.model.job import BinType, ItemType, Job, PackedBin, Placement, Plan
from jaxpack.model.objectives import bounds
from jaxpack.model.plan_check import check_plan
from jaxpack.search.quick import pack_quickly
from jaxpack.search.record import End, Progress

door = importlib.import_module("jaxpack.solve")

ITEMS = "X,Y,Z,COPIES,WEIGHT,ID\n4,4,4,16,2.5,jar\n5,3,2,14,1,tin\n6,6,6,3,12,crate\n"
BINS = "X,Y,Z,COST,ID\n10,10,10,5,small\n12,10,10,5.5,large\n"
BIN = "X,Y,Z\n10,10,10\n"
TABLE = {"X": [4, 5], "Y": [4, 3], "Z": [4, 2], "COPIES": [3, 2]}
ROOM = {"X": [10], "Y": [10], "Z": [10]}
TINY = Job((ItemType((4.0, 4.0, 4.0), 3), ItemType((5.0, 3.0, 2.0), 2)), (BinType((10.0,) * 3),))


def one_per_bin(job, options, stop=None, progress=lambda better: None):
    """A plan that is valid and no good, as `solve_job` would end with it."""
    copies = [index for index, item in enumerate(job.items) for _ in range(item.copies)]
    bins = tuple(
        PackedBin(0, (Placement(item, job.items[item].orientations[0], (0.0, 0.0, 0.0)),))
        for item in copies
    )
    plan = Plan(bins)
    found = Progress(job, plan, bounds(job), 0.5, 7, End.TIME)
    progress(found)
    return found


@pytest.fixture
def quick(monkeypatch):
    """The stand-in for the search, in the function and in the door."""
    monkeypatch.setattr("jaxpack.solution.solve_job", one_per_bin)
    monkeypatch.setattr(door, "solve_job", one_per_bin)


@pytest.fixture
def home(tmp_path, monkeypatch):
    """An empty folder to run in."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli, "prepare_jax", lambda: None)
    return tmp_path


def write(home, **texts):
    """Files by name: items="..." is items.csv."""
    for name, text in texts.items():
        data = text if isinstance(text, bytes) else text.encode()
        (home / f"{name}.csv").write_bytes(data)


def run(monkeypatch, *options):
    """The door in this process; its exit code."""
    monkeypatch.setattr(sys, "argv", ["solve", *map(str, options)])
    monkeypatch.setattr(os, "_exit", sys.exit)
    try:
        cli.run_door(door.main)
    except SystemExit as stop:
        return stop.code or 0
    return 0


def order(sides, count=1, weight=6.5):
    length, width, height = sides
    item = {"article": "jam-7", "id": "7", "product_group": "food", "weight/kg": weight}
    item |= {"length/mm": length, "width/mm": width, "height/mm": height, "sequence": 1}
    return {"item_sequence": {str(number + 1): item for number in range(count)}}


ORDERS = {"0017": order((600, 400, 220)), "a/b": order((300, 400, 220), count=2)}

# What is wrong; the items, the bins, options; what the line says.
BAD = {
    "no file": (None, BIN, "", "items.csv: cannot be read (No such file"),
    "no bins": (ITEMS, None, "", "bins.csv: cannot be read"),
    "empty": ("", BIN, "", "items.csv: the file is empty"),
    "no rows": ("X,Y,Z\n", BIN, "", "items.csv: row 1: no items below the header"),
    "a missing column": ("X,Y\n4,4\n", BIN, "", "items.csv: row 1: column Z is missing"),
    "a misspelt column": (
        "WIDHT,HEIGHT\n4,4\n",
        "WIDTH,HEIGHT\n9,9\n",
        "",
        "items.csv: row 1: column WIDTH is missing: is 'WIDHT' meant?",
    ),
    "two meanings": ("X;Y;Z\n1.200;4;4\n", BIN, "", "items.csv: row 2, column X: "),
    "a near miss": ("X,Y,Z,QTY\n4,4,4,9\n", BIN, "", "items.csv: row 1: column QTY"),
    "NaN": ("X,Y,Z\n4,nan,4\n", BIN, "", "items.csv: row 2, column Y: 'nan' is not a number"),
    "a text": ("X,Y,Z\n4,4,4\n4,4,tall\n", BIN, "", "items.csv: row 3, column Z: 'tall' is not"),
    "negative": ("X,Y,Z\n-4,4,4\n", BIN, "", "items.csv: row 2, column X: -4 is not a size"),
    "zero": (ITEMS, "X,Y,Z\n10,0,10\n", "", "bins.csv: row 2, column Y: 0 is not a size"),
    "absurd": ("X,Y,Z\n4,4,1e300\n", BIN, "", "items.csv: row 2, column Z: 1e+300 is out of range"),
    "a million": ("X,Y,Z,COPIES\n1,1,1,1000000\n", BIN, "", "row 2, column COPIES: 1000000 copies"),
    "half a copy": ("X,Y,Z,COPIES\n1,1,1,0.5\n", BIN, "", "items.csv: row 2, column COPIES: 0.5"),
    "a command": (ITEMS, BIN, "--ignore HUE", "--ignore 'HUE': there is no such column"),
    "2D and 3D": (
        ITEMS,
        "WIDTH,HEIGHT\n10,10\n",
        "",
        "bins.csv: row 1: bins of 2D for items of 3D",
    ),
    "too large": ("X,Y,Z,NAME\n4,4,4,a\n4,11,4,b\n", BIN, "", "items.csv: row 3 (b): no bin can"),
    "too heavy": (
        "X,Y,Z,WEIGHT\n4,4,4,31\n",
        "X,Y,Z,MAXIMUM_WEIGHT\n10,10,10,30\n",
        "",
        "items.csv: row 2: weight 31 is over the limit of every bin",
    ),
    "all too large": ("X,Y,Z\n4,11,4\n", BIN, "--skip-unfit", "items.csv: row 2: no bin can"),
    "no time": (ITEMS, BIN, "--time-limit 0", "--time-limit 0: give seconds, more than 0"),
    "NaN time": (ITEMS, BIN, "--time-limit nan", "--time-limit: nan is not a finite number"),
    "negative time": (ITEMS, BIN, "--time-limit=-3", "--time-limit -3: give seconds"),
    "endless": (ITEMS, BIN, "--time-limit inf", "--time-limit: inf is not a finite number"),
    "seed": (ITEMS, BIN, "--seed=-1", "--seed: -1 is not possible: give a whole number, 0"),
    "support": (ITEMS, BIN, "--support 1.5", "--support 1.5: give a share of the base, 0 to 1"),
    "NaN support": (ITEMS, BIN, "--support nan", "--support: nan is not a finite number"),
    "negative unit": (
        ITEMS,
        BIN,
        "--resolution=-1",
        "--resolution -1: give more than 0, at most 10, a bin's",
    ),
    "fine unit": (ITEMS, BIN, "--resolution 1e-9", "--resolution 1e-09: too many digits beside"),
    "coarse unit": (
        ITEMS,
        BIN,
        "--resolution 11",
        "--resolution 11: give more than 0, at most 10, a bin's",
    ),
    "a name": ("X,Y,Z,NAME\n99,4,4,\x1b[31mred\x07\n", BIN, "", "row 2 (?[31mred?): no bin"),
    "digits": (
        "X,Y,Z\n1.12345678,4,4\n",
        BIN,
        "--out plan.csv",
        "plan.csv: PackingSolver knows whole lengths up to 2^31 only",
    ),
    "a dear bin": (ITEMS, "X,Y,Z,COST\n9,9,9,1e300\n", "", "cost: 1e+300 is not a cost"),
    "an order": (ITEMS, BIN, "--order 0017", "--order '0017': items.csv has items"),
    "out suffix": (ITEMS, BIN, "--out plan.txt", "--out plan.txt: end it with .csv or .json"),
    "no suffix": (ITEMS, BIN, "--html plan", "--html plan: end it with .html or .htm"),
    "png suffix": (ITEMS, BIN, "--png plan.jpg", "--png plan.jpg: end it with .png"),
    "no folder": (ITEMS, BIN, "--out no/p.csv", "--out no/p.csv: its folder does not exist"),
    "a folder": (ITEMS, BIN, "--out folder.csv", "--out folder.csv: is a folder"),
    "read-only": (ITEMS, BIN, "--steps /proc/p.csv", "--steps /proc/p.csv: cannot be written ("),
    "long": (ITEMS, BIN, f"--png {'a' * 300}.png", "cannot be written (File name too long)"),
    "its input": (ITEMS, BIN, "--out ./items.csv", "--out items.csv: the job is read from it"),
    "twice": (ITEMS, BIN, "--out p.csv --steps p.csv", "--steps p.csv: --out is written to it"),
    "no orders": (ITEMS, BIN, "--bed-bpp p.json", "items.csv is no file of BED-BPP orders"),
    "unknown": (ITEMS, BIN, "--speed 3", "Unrecognized options: --speed"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_leaves_nothing(home, monkeypatch, capsys, name):
    items, bins, options, message = BAD[name]
    write(home, **{k: v for k, v in (("items", items), ("bins", bins)) if v is not None})
    (home / "folder.csv").mkdir()
    before = sorted(home.iterdir())
    outputs = [] if "--" in options else ["--out", "plan.csv", "--html", "plan.html"]
    assert run(monkeypatch, "items.csv", "bins.csv", *options.split(), *outputs) == 2
    output, errors = capsys.readouterr()
    assert errors.startswith("error: ")
    assert len(errors.strip().splitlines()) == 1, errors
    assert message in errors
    assert output == ""
    assert sorted(home.iterdir()) == before, "something was left behind"


def test_items_without_bins_are_refused(home, monkeypatch, capsys):
    write(home, items=ITEMS)
    assert run(monkeypatch, "items.csv") == 2
    assert "items.csv: a CSV file of items needs one of bins too" in capsys.readouterr().err
    assert run(monkeypatch) == 2
    assert capsys.readouterr().err.startswith("error: Missing from python -m jaxpack.solve: ITEMS;")


def test_a_byte_order_mark_and_capitals_are_fine(home, monkeypatch, capsys, quick):
    write(home, items=b"\xef\xbb\xbfx,y,z\r\n4,4,4\r\n", bins=b"\xef\xbb\xbfx,Y,Z\r\n9,9,9\r\n")
    assert run(monkeypatch, "items.csv", "bins.csv") == 0
    assert "bins         1\n" in capsys.readouterr().out


def test_the_figures(home, monkeypatch, capsys, quick):
    write(home, items=ITEMS, bins=BINS)
    assert run(monkeypatch, "items.csv", "bins.csv", "--out", "p.json", "--steps", "p.csv") == 0
    output, errors = capsys.readouterr()
    assert output.splitlines() == [
        "bins         33 (33 of small)",
        "fill         6.3 %",
        "weight       90",
        "cost         165, at least 10.5",
        "lower bound  2 bins, gap 1471.4 %",
        "search       0.5 s, 7 packings tried",
        "limited by   time",
        "minimised    least cost, then the fewest bins, then the least volume of bins",
    ]
    assert errors.splitlines() == [
        "0.5 s: 33 bins, fill 6.3 %, gap 1471.4 %",
        "written: p.json, p.csv",
    ]


def test_names_are_no_commands_to_the_terminal(home, monkeypatch, capsys, quick):
    write(home, items=ITEMS, bins="X,Y,Z,ID\n9,9,9,\x1b[31m[red]x\n10,10,10,b\n")
    assert run(monkeypatch, "items.csv", "bins.csv") == 0
    assert "bins         33 (33 of ?[31m[red]x)" in capsys.readouterr().out


def test_what_is_left_out_is_named(home, monkeypatch, capsys):
    def leaves_out(job, *how):
        progress = one_per_bin(job, *how)
        plan = Plan(progress.plan.bins[2:], (0, 0, 2, 2, 2))
        kept = replace(plan, bins=plan.bins[:-3])
        return replace(progress, plan=kept, end=End.BOUND)

    monkeypatch.setattr(door, "solve_job", leaves_out)
    few = (
        BINS.replace("ID\n", "ID,COPIES\n").replace("small", "small,9").replace("large", "large,9")
    )
    write(home, items=ITEMS.replace("6,6,6", "6,6,16"), bins=few)
    assert run(monkeypatch, "items.csv", "bins.csv", "--skip-unfit") == 2
    output, errors = capsys.readouterr()
    lines = output.splitlines()
    left_out = lines.index("left out     5 items (3 of crate, 2 of jar)")
    assert lines[left_out + 1] == "of these     2 items would fit: there are too few bins"
    assert lines[left_out + 2].startswith("minimised    least cost")
    assert "error: items.csv: 2 items not packed, there are too few bins; give more" in errors
    assert "lower bound  2 bins" in lines, "a gap would compare different loads"
    assert "limited by   the bound: no plan can be better" in lines


def test_bins_are_not_too_few_where_there_are_any_number(home, monkeypatch, capsys):
    def errors(bins, *options):
        write(home, items="X,Y,Z\n6,6,2\n4,3,2\n", bins=bins)
        assert run(monkeypatch, "items.csv", "bins.csv", "--packings", "2", *options) == 2
        return capsys.readouterr().err.splitlines()[-1]

    by_rule = "--balance", "0.01", "--resolution", "4"
    assert "no place was found by all the rules; ask less" in errors("X,Y,Z\n12,8,9\n", *by_rule)
    few = errors("X,Y,Z,COPIES\n6,6,3,1\n3,3,3,-1\n")
    assert "error: items.csv: 1 item not packed, there are too few bins; give more" in few
    low = errors("X,Y,Z\n6,6,3\n", "--objective", "height")
    assert "1 item not packed, there is one bin; give a larger one" in low


def test_lengths_that_are_cut_off_are_reported(home, monkeypatch, capsys, quick):
    write(home, items="X,Y,Z\n4.123456789012,3.5,4\n", bins=BIN)
    assert run(monkeypatch, "items.csv", "bins.csv") == 0
    assert "lengths      are cut off to 1e-08: finer ones" in capsys.readouterr().out
    write(home, items="WIDTH,HEIGHT\n4,3.5\n", bins="WIDTH,HEIGHT\n10,10\n")
    assert run(monkeypatch, "items.csv", "bins.csv", "--resolution", "2") == 0
    assert "lengths" not in capsys.readouterr().out


def test_an_invalid_plan_is_never_written(home, monkeypatch, capsys):
    def floats(loading, genes, *how):
        bin, corner = pack_quickly(loading, genes, *how)
        corner[0, 2] += 1
        return bin, corner

    monkeypatch.setattr("jaxpack.search.quick.pack_quickly", floats)
    write(home, items=ITEMS, bins=BINS)
    stop = run(monkeypatch, "items.csv", "bins.csv", "--out", "p.csv")
    assert str(stop).startswith("error: items.csv: no valid plan, nothing is written: bin 0 item 0")
    assert sorted(path.name for path in home.iterdir()) == ["bins.csv", "items.csv"]


def test_orders_have_files_each_and_one_for_all(home, monkeypatch, capsys):
    (home / "orders.json").write_text(json.dumps(ORDERS | {"tall": order((600, 400, 2700))}))
    outputs = ["--out", "p.json", "--steps", "s.csv", "--bed-bpp", "all.json", "--packings", "2"]
    assert run(monkeypatch, "orders.json", *outputs) == 2, "not all of it could be done"
    output, errors = capsys.readouterr()
    names = {path.name for path in home.iterdir()}
    assert names == {"orders.json", "all.json"} | {
        f"{stem}-{name}{suffix}"
        for stem, suffix in (("p", ".json"), ("s", ".csv"))
        for name in ("0017", "a_b")
    }
    assert [line.split()[:4] for line in output.splitlines()[2:4]] == [
        ["0017", "1", "0", "1"],
        ["a/b", "2", "0", "1"],
    ]
    assert "2 orders" in output
    assert "error: orders.json: order 'tall': " in errors
    plans = json.loads((home / "all.json").read_text())
    assert {name: len(plan) for name, plan in plans.items()} == {"0017": 1, "a/b": 2}


def test_one_order_by_name(home, monkeypatch, capsys, quick):
    (home / "orders.json").write_text(json.dumps(ORDERS))
    assert run(monkeypatch, "orders.json", "--order", "a/b", "--out", "p.json") == 0
    (job,) = (job for job in jaxpack.read_job(home / "orders.json") if job.name == "a/b")
    assert len(read_plan_json(home / "p.json", job).bins) == 2
    capsys.readouterr()
    assert run(monkeypatch, "orders.json", "--order", "c") == 2
    assert capsys.readouterr().err == "error: --order 'c': orders.json has 0017, a/b\n"


def test_a_column_to_ignore_is_a_name_or_several(quick):
    for ignore in ("QTY", ["qty"], ("QTY",)):
        assert jaxpack.solve(TABLE | {"QTY": [1, 1]}, ROOM, ignore=ignore).job == TINY


def test_what_was_assumed_is_said_on_standard_error(home, monkeypatch, capsys, quick):
    text = "Length (mm);Width (mm);Height (mm);Colour\n1;2,5;3;red\n"
    write(home, items=text, bins=BIN)
    assert run(monkeypatch, "items.csv", "bins.csv", "--ignore", "COLOUR") == 0
    output, errors = capsys.readouterr()
    assert "LENGTH (MM) as X" in errors
    assert "LENGTH" not in output
    found = jaxpack.solve(home / "items.csv", home / "bins.csv")
    assert any("LENGTH (MM) as X" in note for note in found.notes)


def test_orders_whose_files_would_have_one_name_are_refused(home, monkeypatch, capsys):
    (home / "orders.json").write_text(json.dumps({"a/b": ORDERS["a/b"], "a_b": ORDERS["a/b"]}))
    assert run(monkeypatch, "orders.json", "--out", "p.csv") == 2
    assert "--out p-a_b.csv: --out is written to it" in capsys.readouterr().err


class Frame:
    """What counts of a data frame."""

    def to_dict(self, orient):
        assert orient == "list"
        return TABLE


def rows(table):
    return [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]


@pytest.mark.parametrize(
    ("items", "bins"),
    [(TABLE, ROOM), (Frame(), ROOM), (rows(TABLE), rows(ROOM)), (TINY, None)],
    ids=["dicts", "frame", "rows", "job"],
)
def test_the_function_takes_tables_and_jobs(quick, items, bins):
    solution = jaxpack.solve(items, bins)
    assert solution.job == TINY
    assert (solution.figures.bins, solution.bound, solution.gap) == (5, 1, 4.0)
    assert (solution.seconds, solution.packings, solution.limited_by) == (0.5, 7, "time")


def test_the_function_takes_paths_and_writes_files(quick, home):
    write(home, items=ITEMS, bins=BINS)
    solution = jaxpack.solve("items.csv", home / "bins.csv", dimension=3)
    solution.write_csv("p.csv")
    solution.write_json(home / "p.json")
    solution.write_steps("s.csv")
    assert read_certificate(home / "p.csv", solution.job) == solution.plan
    assert read_plan_json(home / "p.json", solution.job) == solution.plan
    assert (home / "s.csv").read_text().count("\n") == 34


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((TABLE,), {}, "bins: give a table of them, as the items are one"),
        ((TABLE, "bins.csv"), {}, "bins: give a table of them"),
        (("items.csv", ROOM), {}, "bins: give the path of a file"),
        ((TINY, ROOM), {}, "bins: a job has its bins already"),
        (("no.csv", "no.csv"), {}, "no.csv: cannot be read"),
        (("orders.json",), {}, "orders.json: 2 orders, one is solved at a time"),
        ((TABLE | {"X": [4, None]}, ROOM), {}, "items: row 1, column X: empty"),
        ((3, ROOM), {}, "items: 3 is not a table"),
        ((TABLE, ROOM), {"dimension": 2}, "dimension 2: the items have the columns of 3D"),
        ((TABLE, ROOM), {"time_limit": 0}, "time_limit 0: give seconds, more than 0"),
        ((TABLE, ROOM), {"support": -0.1}, "support -0.1: give a share"),
        ((TABLE, ROOM), {"resolution": 0.0}, "resolution 0: give more than 0, at most 10"),
        ((TABLE, ROOM), {"resolution": 1e-9}, "resolution 1e-09: too many digits"),
        ((TABLE, ROOM), {"seed": None}, "seed: empty"),
        ((TABLE, ROOM), {"skip_unfit": "no"}, "skip_unfit 'no': give True or False"),
        ((TABLE, ROOM), {"time_limit": float("nan")}, "time_limit: nan is not a finite number"),
        ((TABLE, {"X": [4], "Y": [4], "Z": [4]}), {}, "row 1: no bin can hold 5 x 3 x 2"),
    ],
)
def test_the_function_refuses_in_one_line(home, arguments, options, message):
    (home / "orders.json").write_text(json.dumps(ORDERS))
    with pytest.raises(UserError) as refused:
        jaxpack.solve(*arguments, **options)
    assert str(refused.value).startswith(message)
    assert "\n" not in str(refused.value)


NAMES = """
import inspect, sys, jaxpack
assert inspect.isfunction(jaxpack.solve)
import jaxpack.evaluate
assert inspect.isfunction(jaxpack.solve)
import jaxpack.solve
from jaxpack.solve import main
assert not {"matplotlib", "plotly", "pandas"} & set(sys.modules), "slow to import"
try:
    jaxpack.solve({"X": [1], "Y": [1], "Z": [1]}, {"X": [2], "Y": [2], "Z": [2]}, seed=-1)
except jaxpack.UserError as error:
    print(error)
"""


def test_the_door_and_the_function_share_a_name(tmp_path):
    command = [sys.executable, "-c", NAMES]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100)
    assert done.stdout == "seed: -1 is not possible: give a whole number, 0 to 4294967295\n", (
        done.stderr
    )


@contextmanager
def process(home, *options, start=("-m", "jaxpack.solve")):
    """The door as a process."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    running = subprocess.Popen([sys.executable, *start, *options], cwd=home, **pipes)
    with running:
        try:
            yield running
        finally:
            running.kill()


def test_a_plan_in_every_form(tmp_path):
    write(tmp_path, items="X,Y,Z,COPIES,ID\n4,4,4,3,a\n5,3,2,2,b\n11,2,2,1,long\n", bins=BIN)
    names = {"out": "p.csv", "steps": "s.csv", "html": "p.html", "png": "p.png"}
    outputs = [part for option, name in names.items() for part in (f"--{option}", name)]
    with process(tmp_path, "items.csv", "bins.csv", "--skip-unfit", *outputs) as running:
        output, errors = running.communicate(timeout=400)
    assert running.returncode == 0, errors
    assert (
        "limited by   the bound: no plan can be better\nleft out     1 item (1 of long)\n" in output
    )
    assert errors.endswith("written: p.csv, s.csv, p.html, p.png\n")
    (job,) = jaxpack.read_job(tmp_path / "items.csv", tmp_path / "bins.csv")
    plan = read_certificate(tmp_path / "p.csv", job)
    check_plan(job, plan)
    assert (len(plan.bins), plan.left_out) == (1, (2,))
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    assert "<html" in (tmp_path / "p.html").read_text()
    assert (tmp_path / "s.csv").read_text().count("\n") == 6
    assert len(list(tmp_path.iterdir())) == 6


def child(running):
    """The process of its compiled search."""
    for _ in range(600):
        if children := psutil.Process(running.pid).children():
            return children[0]
        time.sleep(0.1)
    raise AssertionError("there is none")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_writes_the_best_plan_so_far(tmp_path, number, code):
    sizes = np.random.default_rng(5).integers(2, 6, (70, 3)).tolist()  # three bins are not enough
    rows = [",".join(map(str, size)) for size in sizes]
    write(tmp_path, items="\n".join(["X,Y,Z", *rows]), bins=BIN)
    outputs = ["--out", "p.csv", "--time-limit", "1000"]
    with process(tmp_path, "items.csv", "bins.csv", *outputs) as running:
        line = running.stderr.readline()
        assert " s: " in line, line + running.stderr.read()
        compiling = child(running)
        compiling.suspend()  # a compilation that never ends is not waited for
        running.send_signal(number)
        output, errors = running.communicate(timeout=400)
        with suppress(psutil.NoSuchProcess):
            compiling.resume()
    assert running.returncode == code
    assert errors.endswith("written: p.csv\ninterrupted: this is the best plan so far\n")
    assert "limited by   an interrupt" in output
    (job,) = jaxpack.read_job(tmp_path / "items.csv", tmp_path / "bins.csv")
    check_plan(job, read_certificate(tmp_path / "p.csv", job))


@pytest.mark.parametrize("command", ["solve", "check"])
def test_output_that_cannot_be_written_is_not_a_wrong_plan(tmp_path, command):
    write(tmp_path, items=ITEMS, bins=BIN)
    options = ["items.csv", "bins.csv", "--out", "p.json", "--time-limit", "1"]
    jaxpack.solve(tmp_path / "items.csv", tmp_path / "bins.csv", time_limit=1).write_json(
        tmp_path / "plan.json"
    )
    if command == "check":
        options = ["plan.json", "items.csv", "bins.csv"]
    start = [sys.executable, "-m", "jaxpack", command, *options]
    pipes = {"cwd": tmp_path, "stderr": subprocess.PIPE, "text": True, "timeout": 100}
    with open("/dev/full", "w") as full:
        done = subprocess.run(start, stdout=full, **pipes)
    assert (done.returncode, done.stderr.splitlines()[-1]) == (
        2,
        "error: No space left on device; make room, or write elsewhere",
    )
    reading, writing = os.pipe()
    os.close(reading)
    with open(writing, "w") as nobody:
        done = subprocess.run(start, stdout=nobody, **pipes)
    assert done.returncode == 141
    assert "Traceback" not in done.stderr
    assert command == "check" or (tmp_path / "p.json").exists()
