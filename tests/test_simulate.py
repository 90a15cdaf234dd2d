"""`python -m jaxpack.simulate`: cases whose end everyone knows, and what the command says."""

import importlib
import json
import os
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jaxpack import cli
from jaxpack.errors import UserError
from jaxpack.io.certificates import write_certificate
from jaxpack.io.plans import write_plan_json
from jaxpack.model.job import BinType, ItemType, Job, PackedBin, Placement, Plan
from jaxpack.model.limits import BinLimits, Obstacle
from jaxpack.model.physics import simulate

door = importlib.import_module("jaxpack.simulate")

BOX = (400.0, 400.0, 300.0)
PALLET = BinType((1200.0, 800.0, 1600.0))


def stack(*boxes, weights=None, copies=1, bin_type=PALLET, dimension=3):
    """A job and a plan of boxes of (corner, size), each an item of its own, in `copies` bins."""
    weights = weights or [0.0] * len(boxes)
    items = tuple(
        ItemType(size, copies, weight, name=f"box {number}")
        for number, ((_, size), weight) in enumerate(zip(boxes, weights, strict=True))
    )
    places = tuple(Placement(number, "XYZ", corner) for number, (corner, _) in enumerate(boxes))
    job = Job(items, (bin_type,), dimension)
    return job, Plan((PackedBin(0, places),) * copies)


def carried(share, *more, axis=0, **options):
    """A box of which that share is carried by one below it."""
    corner = [0.0, 0.0, 300.0]
    corner[axis] = 400 * (1 - share)
    return stack(((0, 0, 0), BOX), (tuple(corner), BOX), *more, **options)


def flat(share):
    """The same in 2D."""
    size = (400.0, 1.0, 300.0)
    upper = ((400 * (1 - share), 0, 300), size)
    return stack(((0, 0, 0), size), upper, dimension=2, bin_type=BinType((1200.0, 1.0, 1000.0)))


@pytest.mark.parametrize("at_once", [False, True])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("share", [1.0, 0.6, 0.55, 0.51])
def test_what_is_carried_stays(share, axis, at_once):
    found = simulate(*carried(share, axis=axis), at_once=at_once)
    assert found.distance.max() < 1


@pytest.mark.parametrize("at_once", [False, True])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("share", [0.5, 0.45, 0.2])
def test_what_is_carried_by_half_or_less_falls(share, axis, at_once):
    found = simulate(*carried(share, axis=axis), at_once=at_once)
    assert found.distance[0] < 1
    assert found.distance[1] > 100


@pytest.mark.parametrize(("share", "falls"), [(0.6, False), (0.5, True), (0.45, True)])
def test_in_two_dimensions_as_well_and_nothing_leaves_the_plane(share, falls):
    found = simulate(*flat(share))
    assert (found.distance[1] > 100) == falls
    assert (found.distance[0] < 1) or falls
    np.testing.assert_array_equal(found.centre[:, 1], 0.5)
    np.testing.assert_allclose(found.rotation[:, 1], [[0, 1, 0]] * 2, atol=1e-9)


@pytest.mark.parametrize("weight", [0.2, 0.02])
def test_a_light_item_on_the_free_end_decides(weight):
    """Of a box carried by 55 %, the centre is 20 from the edge, and that of the bar 130 beyond it:
    it falls from 20/130 of its weight on."""
    bar = ((480.0, 0.0, 600.0), (100.0, 400.0, 100.0))
    found = simulate(*carried(0.55, bar, weights=[1.0, 1.0, weight]))
    assert found.distance[0] < 1
    assert (found.distance[1:] > 100).all() if weight > 20 / 130 else found.distance.max() < 1


def test_a_tower_of_ten_stays_and_so_does_what_is_heavy_on_top():
    for weights in ([1.0] * 10, [1.0] * 9 + [50.0]):
        boxes = [((300.0, 300.0, 100.0 * n), (300.0, 200.0, 100.0)) for n in range(10)]
        assert simulate(*stack(*boxes, weights=weights)).distance.max() < 1


def test_weights_and_sizes_of_every_magnitude():
    for weights in ([1e-9, 1e9], [1e9, 1e-9], [0.0, 25.0]):
        assert simulate(*carried(0.6, weights=weights)).distance.max() < 5
    small = ((0, 0, 100), (1e-3, 1e-3, 1e-3)), ((5, 0, 100), (1e-2, 1e-5, 1.0))
    found = simulate(*stack(((0, 0, 0), (1200.0, 800.0, 100.0)), *small))
    assert np.isfinite(found.distance).all()
    assert found.distance.max() < 5


def test_a_bridge_over_two_piers_and_a_full_bin_stay():
    pier = (200.0, 400.0, 500.0)
    bridge = ((0, 0, 0), pier), ((700, 0, 0), pier), ((0, 0, 500), (900.0, 400.0, 100.0))
    assert simulate(*stack(*bridge)).distance.max() < 1
    size = (300.0, 200.0, 400.0)
    full = [
        ((300.0 * x, 200.0 * y, 400.0 * z), size)
        for z in range(4)
        for y in range(4)
        for x in range(4)
    ]
    assert simulate(*stack(*full), walls=True).distance.max() < 1


def test_an_item_that_is_held_by_the_next_one_falls_before_that_comes():
    beam = ((0, 0, 300), (1000.0, 400.0, 100.0))
    weight = ((0, 0, 400), (400.0, 400.0, 1000.0))
    plan = stack(((0, 0, 0), BOX), beam, weight, weights=[1.0, 1.0, 50.0])
    assert simulate(*plan, at_once=True).distance.max() < 1
    assert simulate(*plan).distance[1] > 10


def test_walls_hold_what_leans():
    slab = ((0.0, 0.0, 0.0), (1145.0, 800.0, 100.0))
    job, plan = stack(slab, ((1100.0, 0.0, 100.0), (100.0, 800.0, 1400.0)))  # 45 % carried
    assert simulate(job, plan).distance[1] > 500
    assert simulate(job, plan, walls=True).distance[1] < 10


def test_bins_are_worlds_of_their_own_and_rows_in_loading_order():
    job, plan = carried(0.45, copies=3)
    found = simulate(job, plan)
    assert found.bin.tolist() == [0, 0, 1, 1, 2, 2]
    assert found.turn.tolist() == found.item.tolist() == [0, 1] * 3
    np.testing.assert_array_equal(found.distance[:2], found.distance[4:])
    np.testing.assert_array_equal(found.centre[:2], found.centre[4:])


def test_the_unit_of_length_and_that_of_weight_do_not_matter():
    one = simulate(*carried(0.45, weights=[3.0, 2.0]))
    items = tuple(ItemType((0.4, 0.4, 0.3), weight=w) for w in (3000.0, 2000.0))
    places = Placement(0, "XYZ", (0, 0, 0)), Placement(1, "XYZ", (0.22, 0, 0.3))
    job = Job(items, (BinType((1.2, 0.8, 1.6)),))
    other = simulate(job, Plan((PackedBin(0, places),)))
    np.testing.assert_allclose(other.distance * 1000, one.distance, rtol=1e-3)


def test_an_item_without_weight_among_others_is_light():
    """On the free end it is too light to tip what carries it, which its volume would do."""
    block = ((480.0, 0.0, 600.0), (100.0, 400.0, 900.0))
    assert simulate(*carried(0.55, block)).distance.max() > 100
    assert simulate(*carried(0.55, block, weights=[1.0, 1.0, 0.0])).distance.max() < 1


def test_what_lies_on_nothing_falls_down_to_what_is_there():
    (row,) = simulate(*stack(((0, 0, 500), BOX))).distance
    assert row == pytest.approx(500, abs=1)
    found = simulate(*stack(((0, 0, 0), BOX), ((0, 0, 450), BOX)))
    assert found.distance[1] == pytest.approx(150, abs=1)


def test_obstacles_stand_fast_and_carry():
    arches = Obstacle((0, 0, 0), (300, 800, 250)), Obstacle((900, 0, 0), (300, 800, 250))
    kind = replace(PALLET, limits=BinLimits(obstacles=arches))
    bridge = ((0, 0, 250), (1200.0, 800.0, 100.0))
    assert simulate(*stack(bridge, bin_type=kind)).distance.max() < 1
    assert simulate(*stack(bridge)).distance.max() == pytest.approx(250, abs=1)
    through = simulate(*stack(((0, 0, 0), (300.0, 800.0, 200.0)), bin_type=kind))
    assert through.distance[0] == pytest.approx(250, abs=1)
    sill = Obstacle((0, 0, 0), (300, 1, 250))
    kind = BinType((1200.0, 1.0, 1000.0), limits=BinLimits(obstacles=(sill,)))
    for share in (0.55, 0.45):
        box = ((300 - 400 * share, 0, 250), (400.0, 1.0, 300.0))
        (row,) = simulate(*stack(box, bin_type=kind, dimension=2)).distance
        assert (row > 100) == (share < 0.5)


@pytest.mark.parametrize("at_once", [False, True])
@pytest.mark.parametrize("share", [0.95, 0.55, 0.45, 0.0])
@pytest.mark.parametrize("edge", range(4))
def test_the_floor_ends_where_the_bin_does(edge, share, at_once):
    axis, far = edge % 2, edge // 2
    corner = [300.0, 300.0, 0.0]
    corner[axis] = PALLET.size[axis] - 400 * share if far else 400 * (share - 1)
    found = simulate(*stack((tuple(corner), BOX)), at_once=at_once)
    assert (found.distance[0] < 1) == (share > 0.5)
    if share < 0.5:
        assert found.centre[0, 2] < BOX[2] / 2 - 50
    flat = corner[0], 0.0, 0.0
    if axis == 0:
        sheet = BinType((1200.0, 1.0, 900.0))
        plan = stack((flat, (400.0, 1.0, 300.0)), dimension=2, bin_type=sheet)
        assert (simulate(*plan, at_once=at_once).distance[0] < 1) == (share > 0.5)


def test_walls_are_beside_what_reaches_out():
    size = (620.0, 820.0, 300.0)
    out = ((-20, -10, 0), size), ((600, -10, 0), size), ((-20, -10, 300), size)
    assert simulate(*stack(*out), walls=True).distance.max() < 1


def test_a_plan_of_no_bin_and_a_bin_of_no_item():
    job, _ = carried(1.0)
    for plan in (Plan((), (0, 1)), Plan((PackedBin(0, ()),), (0, 1))):
        found = simulate(job, plan)
        assert [len(column) for column in found] == [0] * 6


@pytest.mark.parametrize("friction", [-0.1, 1.1, float("nan")])
def test_friction_is_a_number_from_zero_to_one(friction):
    with pytest.raises(UserError, match=r"^friction .*: give a number from 0 to 1$"):
        simulate(*carried(1.0), friction=friction)


def test_without_mujoco_the_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(UserError, match=r"not installed: pip install 'jaxpack\[physics\]'$"):
        simulate(*carried(1.0))


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "items.csv").write_text("X,Y,Z,NAME\n400,400,300,box 0\n400,400,300,box 1\n")
    (tmp_path / "bins.csv").write_text("X,Y,Z\n1200,800,1600\n")
    return tmp_path


def said(monkeypatch, capsys, *options):
    """(exit code, lines of the output, lines of the errors)."""
    monkeypatch.setattr(os, "_exit", sys.exit)
    code = 0
    try:
        cli.run_door(door.main, list(map(str, options)), computes=False)
    except SystemExit as stop:
        code = stop.code or 0
    output, errors = capsys.readouterr()
    return code, output.splitlines(), errors.splitlines()


@pytest.mark.parametrize("name", ["p.json", "p.csv"])
def test_the_command_says_what_moved(home, monkeypatch, capsys, name):
    write = write_plan_json if name == "p.json" else write_certificate
    files = name, "items.csv", "bins.csv"
    write(home / name, *carried(0.6))
    found = said(monkeypatch, capsys, *files)
    assert found == (0, ["nothing moved by more than 10 mm: 2 items in 1 bin"], [])
    write(home / name, *carried(0.45))
    code, lines, errors = said(monkeypatch, capsys, *files)
    assert (code, errors) == (1, [])
    sentence = r"bin 0 item 1 'box 1' \(loaded as number 1\): moved by \d+(\.\d)? mm"
    assert re.fullmatch(sentence, lines[0])
    assert lines[1:] == ["1 of 2 items moved by more than 10 mm, in 1 of 1 bin"]
    code, lines, _ = said(monkeypatch, capsys, *files, "--moved", "2", "--unit", "in")
    assert lines[-1] == "1 of 2 items moved by more than 2 in, in 1 of 1 bin"
    assert said(monkeypatch, capsys, *files, "--moved", "900")[0] == 0
    assert said(monkeypatch, capsys, *files, "--at-once", "--walls")[0] == 1


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ("--friction -1", "--friction -1.0: give a number from 0 to 1"),
        ("--moved 0", "--moved 0.0: give a length above 0"),
        ("--moved nan", "--moved nan: give a length above 0"),
        ("--html no/p.html", "--html no/p.html: its folder does not exist; make it first"),
        ("--html items.csv", "--html items.csv: it is read; name another"),
    ],
)
def test_bad_options_are_one_line(home, monkeypatch, capsys, options, line):
    write_certificate(home / "p.csv", *carried(0.6))
    files = "p.csv", "items.csv", "bins.csv"
    assert said(monkeypatch, capsys, *files, *options.split()) == (2, [], [f"error: {line}"])


def test_a_bin_of_which_a_centimetre_is_a_large_part_asks_for_the_unit(home, monkeypatch, capsys):
    (home / "items.csv").write_text("X,Y,Z\n4,4,3\n")
    (home / "bins.csv").write_text("X,Y,Z\n12,8,16\n")
    job = Job((ItemType((4.0, 4.0, 3.0)),), (BinType((12.0, 8.0, 16.0)),))
    write_certificate(home / "p.csv", job, Plan((PackedBin(0, (Placement(0, "XYZ", (0, 0, 0)),)),)))
    files = "p.csv", "items.csv", "bins.csv"
    line = (
        "error: a bin is 16 mm long, and a centimetre no small movement: say with --unit what one "
        "of its units is, or give --moved"
    )
    assert said(monkeypatch, capsys, *files) == (2, [], [line])
    assert said(monkeypatch, capsys, *files, "--unit", "cm")[0] == 0
    assert said(monkeypatch, capsys, *files, "--moved", "1")[0] == 0


def page_of(path: Path):
    """What the script of a page is given."""
    text = re.search(r'id="plan">(.*?)</script>', path.read_text("utf-8"), re.DOTALL)
    return json.loads(text[1])


def test_the_page_has_every_moment_and_what_moved(home, monkeypatch, capsys):
    write_certificate(home / "p.csv", *carried(0.45))
    code, _, _ = said(monkeypatch, capsys, "p.csv", "items.csv", "bins.csv", "--html", "p.html")
    assert code == 1
    shown = page_of(home / "p.html")
    assert shown["moments"] == shown["bins"][0]["last"] == 2 + 20
    still, fallen = shown["bins"][0]["items"]
    assert (still["step"], still["moved"], len(still["poses"])) == (1, None, 1)
    assert fallen["step"] == 2
    assert fallen["moved"] > 100
    assert fallen["poses"][0]["corner"] == [220, 0, 300]
    assert len(fallen["poses"]) > 5
    steps = [pose["step"] for pose in fallen["poses"]]
    assert steps == sorted(steps)


@pytest.mark.slow
@pytest.mark.parametrize("plan", [carried(0.45, copies=2), flat(0.45)], ids=["3D", "2D"])
def test_a_browser_steps_through_the_page(plan, home, monkeypatch, capsys):
    from playwright.sync_api import sync_playwright

    write_plan_json(home / "p.json", *plan)
    job, packed = plan
    least, film = 10.0, door.Film(job, packed, 10.0)
    film.write_html(home / "p.html", simulate(job, packed, seen=film.see))
    assert film.least == least
    wrong = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--enable-unsafe-swiftshader"]
        )
        page = browser.new_page(viewport={"width": 1100, "height": 600})
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda asked: wrong.append(asked.url) if "http" in asked.url else None)
        page.goto((home / "p.html").as_uri())
        page.wait_for_timeout(2000)
        bins = len(packed.bins)
        assert page.evaluate("jaxpack.step") == 22 * bins
        assert len(page.evaluate("jaxpack.shown()")) == 2 * bins
        assert page.locator("#summary").text_content().endswith(f"moved: {bins}")
        page.locator("#step").press("Home")
        assert page.evaluate("jaxpack.shown()") == []
        page.locator("#step").press("ArrowRight")
        assert page.evaluate("jaxpack.shown()") == [1]
        page.get_by_role("button", name="play").click()
        for _ in range(100):
            if page.evaluate("jaxpack.step") == 22 * bins:
                break
            page.wait_for_timeout(200)
        assert page.evaluate("jaxpack.step") == 22 * bins
        browser.close()
    assert wrong == []
