"""`solve --online`: items of a file one by one, each where it has to stay."""

import pytest

from jaxpack import BinType, ItemType, Job, Rules, UserError, check_plan
from jaxpack.model.job import ORIENTATIONS
from jaxpack.search.online_orders import pack_online
from jaxpack.search.portfolio import SolveOptions
from jaxpack.solve import main

ITEMS = (
    ItemType((600, 400, 300), 3, name="crate", weight=20),
    ItemType((300, 200, 200), 5, name="carton", weight=4, orientations=("XYZ", "YXZ")),
    ItemType((400, 350, 250), 4, name="box", weight=9, orientations=tuple(ORIENTATIONS)),
)
BINS = (BinType((800, 600, 700), max_weight=60),)


def came(job):
    """(what was told of every item, the plan)."""
    told = []
    found = pack_online(job, SolveOptions(), lambda *one: told.append(one))
    check_plan(job, found.plan)
    return told, found.plan


def test_every_item_goes_where_it_was_said_in_the_order_of_the_file():
    told, plan = came(Job(ITEMS, BINS))
    assert [item for item, *_ in told] == [0] * 3 + [1] * 5 + [2] * 4
    for number, packed in enumerate(plan.bins):
        mine = [(one.item, one.orientation, one.corner) for one in packed.placements]
        assert mine == [(item, way, corner) for item, way, n, corner in told if n == number]
        weight = sum(ITEMS[one.item].weight for one in packed.placements)
        assert weight <= 60
    assert not plan.left_out
    assert len(plan.bins) > 1


def test_what_comes_later_moves_nothing():
    told, _ = came(Job(ITEMS, BINS))
    fewer, _ = came(Job(ITEMS[:2], BINS))
    assert fewer == told[:8]


def test_what_no_bin_is_left_for_is_left_out():
    bins = (BinType((800, 600, 700), copies=1, max_weight=60),)
    told, plan = came(Job(ITEMS, bins))
    assert [item for item, _, number, _ in told if number < 0] == list(plan.left_out)
    assert plan.left_out


def test_what_it_cannot_keep_to_is_refused():
    with pytest.raises(UserError, match="one by one: the objective"):
        pack_online(Job(ITEMS, (BinType((800, 600, 700), copies=1),), objective="value"),
                    SolveOptions())  # fmt: skip
    heavy = SolveOptions(rules=Rules(heavy_below=True))
    with pytest.raises(UserError, match="without rules of loads"):
        pack_online(Job(ITEMS, BINS), heavy)


def test_the_command_prints_each_item_and_writes_the_plan(tmp_path, monkeypatch, capsys):
    (tmp_path / "items.csv").write_text("X,Y,Z,COPIES,NAME\n600,400,300,2,crate\n300,200,200,3,b\n")
    (tmp_path / "bins.csv").write_text("X,Y,Z,COPIES\n800,600,700,-1\n")
    monkeypatch.chdir(tmp_path)
    command = ["items.csv", "bins.csv", "--online", "--out", "plan.csv"]
    with pytest.raises(SystemExit) as ended:
        main(command)
    assert not ended.value.code
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "crate: bin 0, XYZ at 0, 0, 0"
    assert [line.split(":")[0] for line in lines[:5]] == ["crate"] * 2 + ["b"] * 3
    assert (tmp_path / "plan.csv").exists()
    with pytest.raises(UserError, match="--online: nothing is searched for"):
        main([*command, "--time-limit", "3"])
