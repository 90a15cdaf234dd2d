"""`python -m jaxpack.check`: anyone's plan in, "valid" or its violations out, or one line."""

import csv
import importlib
import json
import os
import subprocess
import sys

import pytest

from jaxpack import cli
from jaxpack.io.bed_bpp import write_bed_bpp
from jaxpack.io.certificates import write_certificate
from jaxpack.io.jobs import read_job
from jaxpack.io.plans import write_plan_json
from jaxpack.model.job import BinType, ItemType, Job, PackedBin, Placement, Plan

door = importlib.import_module("jaxpack.check")

ITEMS = "X,Y,Z,COPIES,WEIGHT,NAME\n4,4,2,2,1.5,jar\n8,4,1,1,2,lid\n"
BINS = "X,Y,Z,MAXIMUM_WEIGHT\n10,4,5,5\n"
JOB = Job(
    (ItemType((4, 4, 2), 2, 1.5, name="jar"), ItemType((8, 4, 1), 1, 2, name="lid")),
    (BinType((10, 4, 5), max_weight=5),),
)


def bridge(second=(4, 0, 0), lid=(0, 0, 2)):
    """Two jars with a lid over both, in one bin."""
    places = [(0, (0, 0, 0)), (0, second), (1, lid)]
    return Plan((PackedBin(0, tuple(Placement(item, "XYZ", at) for item, at in places)),))


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A folder with items and bins to run in."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli, "prepare_jax", lambda: None)
    (tmp_path / "items.csv").write_text(ITEMS)
    (tmp_path / "bins.csv").write_text(BINS)
    return tmp_path


def run(monkeypatch, *options):
    """The door in this process; its exit code."""
    monkeypatch.setattr(sys, "argv", ["check", *map(str, options)])
    monkeypatch.setattr(os, "_exit", sys.exit)
    try:
        cli.run_door(door.main)
    except SystemExit as stop:
        return stop.code or 0
    return 0


def checked(monkeypatch, capsys, *options):
    """(exit code, lines of the output, lines of the errors)."""
    code = run(monkeypatch, *options)
    output, errors = capsys.readouterr()
    return code, output.splitlines(), errors.splitlines()


@pytest.mark.parametrize("name", ["p.json", "p.csv"])
def test_a_valid_plan(home, monkeypatch, capsys, name):
    write = write_plan_json if name == "p.json" else write_certificate
    write(home / name, JOB, bridge())
    found = checked(monkeypatch, capsys, name, "items.csv", "bins.csv")
    assert found == (0, ["valid: 1 bin, 3 items, fill 48.0 %"], [])


def test_what_is_left_out_is_said(home, monkeypatch, capsys):
    plan = Plan((PackedBin(0, bridge().bins[0].placements[:1]),), (0, 1))
    write_certificate(home / "p.csv", JOB, plan)
    found = checked(monkeypatch, capsys, "p.csv", "items.csv", "bins.csv")
    assert found == (0, ["valid: 1 bin, 1 item, fill 16.0 %, 2 items left out"], [])
    write_certificate(home / "p.csv", JOB, Plan((), (0, 0, 1)))
    found = checked(monkeypatch, capsys, "p.csv", "items.csv", "bins.csv")
    assert found == (0, ["valid: 0 bins, 0 items, 3 items left out"], [])


@pytest.mark.parametrize("name", ["p.json", "p.csv"])
def test_an_invalid_plan(home, monkeypatch, capsys, name):
    write = write_plan_json if name == "p.json" else write_certificate
    write(home / name, JOB, bridge(second=(3, 0, 0), lid=(0, 0, 2.5)))
    found = checked(monkeypatch, capsys, name, "items.csv", "bins.csv")
    assert found == (
        1,
        [
            "bin 0 item 0 'jar' (loaded as number 1): overlaps the item loaded as number 0 by 1 "
            "along x",
            "bin 0 item 1 'lid' (loaded as number 2): floats: its bottom is at 2.5, but what it "
            "can rest on at 2",
        ],
        [],
    )


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ("", 1),
        ("--support 0.5", 1),
        ("--support 0.5 --support-inclusive", 0),
        ("--support 0.4999", 0),
        ("--support 0", 0),
        ("--support 0.51 --support-inclusive", 1),
        ("--support 1", 1),
    ],
)
def test_half_a_base(home, monkeypatch, capsys, options, code):
    """A lid on one jar: more than half is asked for if nothing is said."""
    (home / "items.csv").write_text(ITEMS.replace(",2,1.5,", ",1,1.5,"))
    (job,) = read_job(home / "items.csv", home / "bins.csv")
    places = bridge().bins[0].placements
    write_plan_json(home / "p.json", job, Plan((PackedBin(0, (places[0], places[2])),)))
    found = checked(
        monkeypatch,
        capsys,
        *["p.json", "items.csv", "bins.csv", "--stability", "share"],
        *options.split(),
    )
    assert found[0] == code
    assert ("50 % of its footprint" in found[1][0]) == (code == 1)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ("", "its centre is not inside what carries it"),
        ("--stability share", "valid"),
        ("--stability static", "valid"),
        ("--stability centre", "its centre is not inside what carries it"),
    ],
)
def test_a_lid_that_the_rest_holds_down(home, monkeypatch, capsys, options, told):
    """Half of a lid hangs out; with something heavy on the other half."""
    (home / "items.csv").write_text(ITEMS + "4,4,1,1,90,anvil\n")
    (home / "bins.csv").write_text("X,Y,Z\n10,4,9\n")
    (job,) = read_job(home / "items.csv", home / "bins.csv")
    jar, _, lid = bridge().bins[0].placements
    places = jar, lid, Placement(2, "XYZ", (0, 0, 3))
    write_plan_json(home / "p.json", job, Plan((PackedBin(0, places),), left_out=(0,)))
    rules = ["--support", "0.4", *options.split(), "--out", "v.json"]
    code, lines, _ = checked(monkeypatch, capsys, "p.json", "items.csv", "bins.csv", *rules)
    assert (code, len(lines)) == (told != "valid", 1)
    assert told in lines[0]
    if code:
        (record,) = json.loads((home / "v.json").read_text())
        assert (record["rule"], record["turn"], record["what"], record["amount"]) == (
            "centre",
            1,
            "x",
            0.125,
        )


def test_weight_and_count_from_a_certificate_of_another(home, monkeypatch, capsys):
    """Columns in another order, a bin of two copies, numbers with many digits."""
    (home / "bins.csv").write_text(BINS.replace(",5\n", ",4.9\n"))
    (home / "p.csv").write_text(
        "BIN,TYPE,ID,COPIES,ROTATION,X,Y,Z,LX,LY,LZ\n"
        "0,BIN,0,2,,0,0,0,10,4,5\n"
        "0,ITEM,0,2,XYZ,0,0,0,4,4,2\n"
        "0,ITEM,0,2,XYZ,4.0000000000001,0,0,4,4,2\n"
        "0,ITEM,1,2,XYZ,0,0,2,8,4,1\n"
    )
    heavy = "its items weigh 5, more than 4.9; the heaviest is item 1 'lid'"
    assert checked(monkeypatch, capsys, "p.csv", "items.csv", "bins.csv") == (
        1,
        [
            "item 0 'jar': 2 to pack, but 4 packed (bins 0, 1) and 0 left out",
            "item 1 'lid': 1 to pack, but 2 packed (bins 0, 1) and 0 left out",
            f"bin 0: {heavy}",
            f"bin 1: {heavy}",
        ],
        [],
    )


def test_a_plan_of_two_dimensions(home, monkeypatch, capsys):
    (home / "items.csv").write_text("WIDTH,HEIGHT\n4,3\n")
    (home / "bins.csv").write_text("WIDTH,HEIGHT\n5,6\n")
    text = "TYPE,ID,COPIES,BIN,X,Y,LX,LY\nBIN,0,1,0,0,0,5,6\nITEM,0,1,0,{},0,4,3\n"
    (home / "p.csv").write_text(text.format(1))
    found = checked(monkeypatch, capsys, "p.csv", "items.csv", "bins.csv")
    assert found == (0, ["valid: 1 bin, 1 item, fill 40.0 %"], [])
    (home / "p.csv").write_text(text.format(1.5))
    code, (line,), _ = checked(monkeypatch, capsys, "p.csv", "items.csv", "bins.csv")
    assert (code, "along x it reaches to 5.5, the bin to 5" in line) == (1, True)


def test_of_many_violations_the_first_are_shown_and_all_are_written(home, monkeypatch, capsys):
    (home / "items.csv").write_text("X,Y,Z,COPIES,NAME\n1,1,1,60,=cmd|x\n")
    (job,) = read_job(home / "items.csv", home / "bins.csv")
    places = tuple(Placement(0, "XYZ", (0, 0, 0)) for _ in range(60))
    write_plan_json(home / "p.json", job, Plan((PackedBin(0, places),)))
    options = ["p.json", "items.csv", "bins.csv", "--out"]
    code, lines, _ = checked(monkeypatch, capsys, *options, "v.json")
    assert (code, len(lines), lines[-1]) == (1, 21, "and 39 violations more")
    records = json.loads((home / "v.json").read_text())
    assert len(records) == 59
    assert records[58] == {
        "order": "items",
        "rule": "overlap",
        "bin": 0,
        "item": 0,
        "turn": 59,
        "other": 0,
        "what": "x",
        "found": 1.0,
        "allowed": 0.0,
        "amount": 1.0,
        "sentence": "bin 0 item 0 (loaded as number 59): overlaps the item loaded as number 0 by "
        "1 along x",
    }
    assert checked(monkeypatch, capsys, *options, "v.csv")[0] == 1
    with open(home / "v.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["TURN"] for row in rows] == [str(record["turn"]) for record in records]
    assert {row["RULE"] for row in rows} == {"overlap"}
    write_plan_json(home / "p.json", job, Plan((), (0,) * 60))
    assert checked(monkeypatch, capsys, *options, "v.json")[0] == 0
    assert json.loads((home / "v.json").read_text()) == []


HOSTILE = ["\x1b[31m[red]x[/red]", "a\rb", "\x07\x9b2J", "[link=x]y[/link]", "\u202eabc"]


@pytest.mark.parametrize("name", HOSTILE)
def test_names_are_no_commands_to_the_terminal(home, monkeypatch, capsys, name):
    box = {"length/mm": 400, "width/mm": 400, "height/mm": 200, "weight/kg": 1, "article": name}
    orders = {key: {"item_sequence": {"1": box}} for key in (name, "b")}
    (home / "o.json").write_text(json.dumps(orders))
    jobs = read_job(home / "o.json")
    high = Plan((PackedBin(0, (Placement(0, "XYZ", (0, 0, 5)),)),))
    write_bed_bpp(home / "p.json", jobs, [high, high])
    code, lines, errors = checked(monkeypatch, capsys, "p.json", "o.json")
    assert (code, len(lines), errors) == (1, 2, [])
    shown = "".join(c if c.isprintable() else "?" for c in name)
    floats = "(loaded as number 0): floats: its bottom is at 5, but what it can rest on at 0"
    assert lines[0] == f"{shown}: bin 0 item 0 '{shown}' {floats}"


def order(*sides):
    items = {
        str(n): {"article": f"a{n}", "length/mm": x, "width/mm": y, "height/mm": z, "weight/kg": n}
        for n, (x, y, z) in enumerate(sides)
    }
    return {"item_sequence": items}


ORDERS = {"0017": order((600, 400, 200), (400, 600, 200)), "a/b": order((300, 400, 200))}


def action(number, corner, orientation=0, sides=(600, 400, 200)):
    item = {"article": f"a{number}", "id": "7", "product_group": "x", "weight/kg": number}
    item |= dict(zip(("length/mm", "width/mm", "height/mm"), sides, strict=True))
    return {"item": item, "flb_coordinates": corner, "orientation": orientation}


def test_packing_plans_of_bed_bpp(home, monkeypatch, capsys):
    (home / "o.json").write_text(json.dumps(ORDERS))
    plans = {
        "a/b": [action(0, [0, 0, 0], 1, (300, 400, 200))],
        "0017": [action(0, [0, 0, 0]), action(1, [0, 0, 200], 1, (400, 600, 200))],
    }
    (home / "p.json").write_text(json.dumps(plans))
    code, lines, errors = checked(monkeypatch, capsys, "p.json", "o.json")
    assert (code, errors) == (0, [])
    assert [line.partition(", fill")[0] for line in lines] == [
        "0017: valid: 1 bin, 2 items",
        "a/b: valid: 1 bin, 1 item",
    ]
    plans["0017"] = [action(1, [700, 0, 0], 0, (400, 600, 200)), action(0, [700, 0, 200])]
    (home / "p.json").write_text(json.dumps(plans))
    code, lines, _ = checked(monkeypatch, capsys, "p.json", "o.json")
    assert code == 1
    assert lines[0].startswith("0017: bin 0 item 0 'a0' (loaded as number 1): outside the bin")
    assert "a/b: valid: 1 bin, 1 item" in lines[1]
    assert checked(monkeypatch, capsys, "p.json", "o.json", "--order", "a/b")[0] == 0
    assert checked(monkeypatch, capsys, "p.json", "o.json", "--order", "0017")[0] == 1
    del plans["0017"]
    (home / "p.json").write_text(json.dumps(plans))
    code, lines, _ = checked(monkeypatch, capsys, "p.json", "o.json")
    assert (code, lines[0]) == (0, "0017: valid: 0 bins, 0 items, 2 items left out")


def test_a_plan_of_one_of_several_orders(home, monkeypatch, capsys):
    (home / "o.json").write_text(json.dumps(ORDERS))
    job = read_job(home / "o.json")[1]
    plan = Plan((PackedBin(0, (Placement(0, "XYZ", (0, 0, 0)),)),))
    write_plan_json(home / "p.json", job, plan)
    assert checked(monkeypatch, capsys, "p.json", "o.json", "--order", "a/b")[0] == 0
    code, _, errors = checked(monkeypatch, capsys, "p.json", "o.json")
    said = "error: o.json: 2 orders, and a plan of one: say which with --order"
    assert (code, errors) == (2, [said])
    code, _, errors = checked(monkeypatch, capsys, "p.json", "o.json", "--order", "c")
    assert (code, errors) == (2, ["error: --order 'c': o.json has 0017, a/b"])


# The plan's text, options, what the line says.
BAD = {
    "no file": (None, "", "p.json: cannot be read (No such file"),
    "empty": ("", "", "p.json: the file is empty"),
    "no JSON": ("{", "", "p.json: row 1, column 2: not JSON"),
    "a list": ("[]", "", "p.json: expected an object"),
    "another item": ('"item": 7', "", "bin 0, item 0, key 'item': 7 is not possible"),
    "another bin": ('"type": 3', "", "bin 0, key 'type': 3 is not possible"),
    "another size": ('"size": [11, 4, 5]', "", "but this job has [10, 4, 5]: is it of another job"),
    "no position": ('"position": [0, NaN, 0]', "", "key 'position': nan is not a finite number"),
    "an orientation": ('"orientation": "UP"', "", "key 'orientation': 'UP' is not known"),
    "deep": ("[" * 100_000, "", "p.json: cannot be read as JSON"),
    "orders": ('{"x": []}', "", "order 'x': is not among the orders of the items, items"),
    "no list": ('{"items": 3}', "", "order 'items': expected a list of items in loading order"),
    "no action": ('{"items": [3]}', "", "item 0: expected an object with key 'item', found 3"),
    "support": (bridge(), "--support 1.5", "--support 1.5: give a share of the base, 0 to 1"),
    "no support": (bridge(), "--support nan", "--support: nan is not a finite number"),
    "stability": (bridge(), "--stability x", "--stability 'x' is not known: use share, cen"),
    "suffix": (bridge(), "--out v.txt", "--out v.txt: end it with .csv or .json"),
    "folder": (bridge(), "--out no/v.csv", "--out no/v.csv: its folder does not exist"),
    "its input": (bridge(), "--out ./items.csv", "--out items.csv: it is read; name another"),
    "the plan": (bridge(), "--out p.json", "--out p.json: it is read; name another"),
    "unknown": (bridge(), "--speed 3", "Unrecognized options: --speed"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line(home, monkeypatch, capsys, name):
    plan, options, message = BAD[name]
    path = home / "p.json"
    if isinstance(plan, str) and plan.startswith('"'):  # instead of that key's value
        write_plan_json(path, JOB, bridge())
        data = json.loads(path.read_text())
        (key, value), *_ = json.loads(f"{{{plan}}}").items()
        place = data["bins"][0] if key in data["bins"][0] else data["bins"][0]["items"][0]
        place[key] = value
        path.write_text(json.dumps(data))
    elif isinstance(plan, str):
        path.write_text(plan)
    elif plan:
        write_plan_json(path, JOB, plan)
    before = sorted(home.iterdir())
    code, lines, errors = checked(
        monkeypatch, capsys, "p.json", "items.csv", "bins.csv", *options.split()
    )
    assert (code, lines, len(errors)) == (2, [], 1), errors
    assert errors[0].startswith("error: ")
    assert message in errors[0]
    assert sorted(home.iterdir()) == before


def test_what_is_not_given_is_named(home, monkeypatch, capsys):
    for given, missing in ((["p.csv"], "ITEMS"), ([], "PLAN ITEMS")):
        code, _, (error,) = checked(monkeypatch, capsys, *given)
        assert code == 2
        assert error.startswith(f"error: Missing from python -m jaxpack.check: {missing}; see ")


@pytest.mark.slow
def test_a_plan_of_more_items_than_a_job_may_have(home, monkeypatch, capsys):
    rows = ["TYPE,ID,COPIES,BIN,X,Y,Z,LX,LY,LZ,ROTATION", "BIN,0,100000,0,0,0,0,10,4,5,"]
    rows += ["ITEM,0,100000,0,0,0,0,4,4,2,XYZ"] * 1000
    (home / "p.csv").write_text("\n".join(rows) + "\n")
    code, _, (error,) = checked(monkeypatch, capsys, "p.csv", "items.csv", "bins.csv")
    assert code == 2
    assert "p.csv: 100,000,000 items, a job has at most 100,000" in error


def test_as_a_process(home):
    write_certificate(home / "p.csv", JOB, bridge())
    for plan, code in (("p.csv", 0), ("q.csv", 1), ("no.csv", 2)):
        write_certificate(home / "q.csv", JOB, bridge(second=(7, 0, 0)))
        command = [sys.executable, "-m", "jaxpack.check", plan, "items.csv", "bins.csv"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
        assert done.returncode == code, done.stderr
        assert done.stdout[:4] == ["vali", "bin ", ""][code]
        assert done.stderr.count("\n") == (code == 2)
