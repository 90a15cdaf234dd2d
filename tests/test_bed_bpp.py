"""BED-BPP: its orders as jobs, and plans as its evaluator reads them."""

import json
import math
from dataclasses import replace

import pytest
from job_files import BINS_3D, ORDERS, SOLID_JOB, assert_refused, ordered, read, stopped_after

from jaxpack.io.bed_bpp import write_bed_bpp
from jaxpack.model.job import UPRIGHT, BinType, ItemType, Job, PackedBin, Placement, Plan


def test_bed_bpp_has_a_job_per_order(tmp_path):
    jobs = read(tmp_path, json.dumps(ORDERS), name="orders.json")
    jam = ItemType((600.0, 400.0, 220.0), 2, 6.5, UPRIGHT, "jam-7")
    tea = ItemType((300.0, 200.0, 100.0), 1, 2.0, UPRIGHT, "tea-8")
    assert jobs[0].items == (jam, tea, replace(jam, size=(600.0, 400.0, 221.0), copies=1))
    assert [job.name for job in jobs] == ["0017", "0018", "0019"]
    roll, euro = (BinType((800.0, 700.0, 2000.0)), BinType((1200.0, 800.0, 2000.0)))
    targets = replace(roll, name="rollcontainer"), replace(euro, name="euro-pallet")
    assert [job.bins[0] for job in jobs] == [targets[0], targets[1], targets[1]]
    jobs = read(tmp_path, json.dumps(ORDERS), BINS_3D, "orders.json")
    assert all(job.bins == SOLID_JOB.bins for job in jobs)


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
    (orders_with(article=[1]), "item '1': article [1]: expected a text"),
    (
        json.dumps({"o": ORDERS["0019"] | {"properties": {"target": "ship"}}}),
        "order 'o': key 'target': 'ship' is not known: use euro-pallet or rollcontainer",
    ),
    (json.dumps({"o": ORDERS["0019"] | {"properties": 3}}), "key 'properties': expected an obj"),
]


@pytest.mark.parametrize(("text", "message"), BAD_ORDERS, ids=[text for _, text in BAD_ORDERS])
def test_bad_orders(tmp_path, text, message):
    assert_refused(lambda: read(tmp_path, text, name="a.json"), "a.json: ", message)


STACK = (Placement(0, "YXZ", (0.0, 0.0, 0.0)), Placement(1, "XYZ", (0.0, 10.0, 220.0)))


def test_plans_have_what_their_orders_say_of_the_items(tmp_path):
    jobs = read(tmp_path, json.dumps(ORDERS), name="orders.json")
    twice = (*STACK, Placement(0, "XYZ", (400.0, 0.0, 0.0)))
    path = tmp_path / "plans.json"
    notes = []
    plans = [Plan((PackedBin(0, twice),)), Plan(()), Plan((PackedBin(0, STACK[:1]),))]
    write_bed_bpp(path, jobs, plans, notes.append)
    data = json.loads(path.read_text())
    assert list(data) == ["0017", "0018", "0019"]
    given = ORDERS["0017"]["item_sequence"]
    assert data["0017"] == [
        {"item": given["1"], "flb_coordinates": [0, 0, 0], "orientation": 1},
        {"item": given["2"], "flb_coordinates": [0, 10, 220], "orientation": 0},
        {"item": given["3"], "flb_coordinates": [400, 0, 0], "orientation": 0},
    ]
    assert data["0018"] == []
    assert [line.split("': ")[1] for line in notes] == [
        "1 of 4 items are left off its one target",
        "1 of 1 items are left off its one target",
    ]


def test_of_several_bins_the_one_with_the_most_items_is_the_plan(tmp_path):
    (job, *_) = read(tmp_path, json.dumps(ORDERS), name="orders.json")
    largest = PackedBin(0, (Placement(2, "XYZ", (0.0, 0.0, 0.0)),))
    path, notes = tmp_path / "plans.json", []
    write_bed_bpp(path, [job], [Plan((largest, PackedBin(0, STACK)), (0,))], notes.append)
    assert [action["item"]["sequence"] for action in json.loads(path.read_text())["0017"]] == [1, 2]
    assert "order '0017': 2 of 4 items are left off" in notes[0]
    equal = Plan((PackedBin(0, STACK[1:]), PackedBin(0, STACK[:1])))
    write_bed_bpp(path, [job], [equal])
    assert [action["item"]["id"] for action in json.loads(path.read_text())["0017"]] == ["7"]


def test_items_of_other_jobs_have_a_name_for_all(tmp_path):
    job = Job((ItemType((5.0, 4.0, 3.0), name="jam-7"),), (BinType((9.0, 9.0, 9.0)),), name="o")
    path, notes = tmp_path / "plans.json", []
    stack = (Placement(0, "XYZ", (0.5, 0.0, 0.0)),)
    write_bed_bpp(path, [job], [Plan((PackedBin(0, stack),))], notes.append)
    (action,) = json.loads(path.read_text())["o"]
    assert action["item"] == ordered(1, sides=(5, 4, 3), weight=0) | {"product_group": ""}
    assert "cuts off the decimals" in notes[0]


def test_what_the_format_cannot_hold_is_refused(tmp_path):
    jobs = read(tmp_path, json.dumps(ORDERS), name="orders.json")
    path = tmp_path / "plans.json"
    path.write_text("before")
    plan = Plan((PackedBin(0, STACK),))
    lying = Plan((PackedBin(0, (Placement(1, "ZYX", (0.0, 0.0, 0.0)),)),))
    assert_refused(lambda: write_bed_bpp(path, jobs[:1], [lying]), "order '0017': item 1 lies ZYX")
    assert_refused(lambda: write_bed_bpp(path, jobs[:1] * 2, [plan] * 2), "'0017': is there twice")
    assert path.read_text() == "before"


def test_a_key_that_is_there_twice_is_found_among_many(tmp_path):
    keys = [f'"k{number}": 1' for number in range(200_000)]
    text = "{" + ", ".join([*keys, keys[-1]]) + "}"
    with stopped_after(60):  # one compared with all others takes hours
        assert_refused(lambda: read(tmp_path, text, name="a.json"), "key 'k199999' is there twice")
