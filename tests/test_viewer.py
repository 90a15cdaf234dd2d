"""The page and the picture of a plan; the page in a real browser: Chromium, from the system's
packages or from `playwright install chromium`.
"""

import math
import re
import shutil
from io import BytesIO

import numpy as np
import pytest
from matplotlib import image
from matplotlib.figure import Figure
from playwright.sync_api import sync_playwright

from jaxpack.io import pictures
from jaxpack.io.pictures import write_png
from jaxpack.io.viewer import write_html
from jaxpack.model.job import BinType, ItemType, Job, PackedBin, Placement, Plan

pytestmark = pytest.mark.slow

NASTY = "</script><img src=x onerror=alert(1)> & {{plotly}}"
TURNED = {2: "ZYX", 3: "YXZ"}


def two_bins(dimension):
    """Left and right half of bin 0, the right one turned; one item in bin 1; one left out."""
    y, z = (1.0, 4.0) if dimension == 2 else (4.0, 4.0)
    own = (z, y, 5.0) if dimension == 2 else (y, 5.0, z)
    items = (
        ItemType((5.0, y, z), 1, 2.5, name="left"),
        ItemType(own, 2, 3.25, ("XYZ", TURNED[dimension]), NASTY),
        ItemType((1.0, 1.0, 0.1 + 0.2)),
    )
    bins = (BinType((10.0, y, z), max_weight=20.0, name="crate"), BinType((20.0, y, 2 * z)))
    first = Placement(0, "XYZ", (0.0, 0.0, 0.0)), Placement(1, TURNED[dimension], (5.0, 0.0, 0.0))
    second = (Placement(2, "XYZ", (0.0, 0.0, 0.0)),)
    plan = Plan((PackedBin(0, first), PackedBin(1, second)), left_out=(1,))
    return Job(items, bins, dimension, "two bins"), plan


def many(bins, each):
    """A row of cubes along every bin."""
    job = Job((ItemType((1.0, 1.0, 1.0), bins * each),), (BinType((float(each), 2.0, 2.0)),))
    row = tuple(Placement(0, "XYZ", (float(x), 0.0, 0.0)) for x in range(each))
    return job, Plan((PackedBin(0, row),) * bins)


@pytest.fixture(scope="module")
def chromium():
    # Where there is no GPU, WebGL has to be drawn by the processor.
    options = {"args": ["--enable-unsafe-swiftshader"]}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), **options)
        yield browser
        browser.close()


@pytest.fixture
def show(chromium, tmp_path):
    """Opens the page of a plan; nothing may be asked of a network nor go wrong on the way."""
    page = chromium.new_page(viewport={"width": 1100, "height": 600})
    asked, wrong = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
    page.on("dialog", lambda dialog: (wrong.append(dialog.message), dialog.dismiss()))
    path = tmp_path / "plan.html"

    def open_page(job, plan, title=""):
        write_html(path, job, plan, title)
        page.goto(path.as_uri())
        until(page, "!!window.jaxpack")
        return page

    yield open_page
    page.close()
    assert wrong == []
    assert {url for url in asked if not url.startswith(("data:", "blob:"))} == {path.as_uri()}


def until(page, expression):
    """Waits for it from here: the page's own policy forbids it to evaluate a text over and over."""
    for _ in range(200):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(100)
    raise AssertionError(f"never: {expression}")


def shown(page):
    return page.evaluate("jaxpack.shown()")


def picture(page, wanted=lambda now: True):
    """What is seen, once it has stopped changing and is as wanted."""
    before = None
    for _ in range(60):
        now = page.locator("#plot").screenshot()
        if now == before and wanted(now):
            return now
        before = now
        page.wait_for_timeout(200)
    raise AssertionError("the picture keeps changing or stays as it was")


def point_at(page, across, down):
    """Moves the mouse to a point of the plot, given as parts of its width and height."""
    box = page.locator("#plot").bounding_box()
    page.mouse.move(box["x"] + across * box["width"], box["y"] + down * box["height"])


def pointed_at(page, across, down, step):
    """What the label says where the item of that step has to be."""
    point_at(page, across, down)
    until(page, f"jaxpack.hovered && jaxpack.hovered.step === {step}")
    page.wait_for_selector(".hovertext")
    return page.locator(".hovertext").text_content()


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_slider_loads_item_by_item_over_all_bins_or_one(show, dimension):
    page = show(*two_bins(dimension))
    assert shown(page) == [1, 2, 3]
    assert page.locator("#count").text_content() == "3 of 3"
    full = picture(page)
    slider = page.locator("#step")
    slider.press("ArrowLeft")
    assert shown(page) == [1, 2]
    assert page.locator("#count").text_content() == "2 of 3"
    fewer = picture(page, lambda now: now != full)
    slider.press("Home")
    assert shown(page) == []
    picture(page, lambda now: now not in (full, fewer))
    page.get_by_label("1", exact=True).check()
    assert shown(page) == [3]
    slider.press("Home")
    assert shown(page) == []
    assert page.evaluate("jaxpack.step") == 2
    page.get_by_label("all").check()
    assert shown(page) == [1, 2, 3]


@pytest.mark.parametrize("dimension", [2, 3])
def test_pointing_at_an_item_says_which_it_is(show, dimension):
    page = show(*two_bins(dimension))
    page.get_by_label("0", exact=True).check()
    page.locator("#step").press("ArrowLeft")
    page.locator("#step").press("ArrowRight")  # drawn again: the same answers
    left = pointed_at(page, 0.35, 0.5, step=1)
    assert "left" in left
    assert "weight 2.5" in left
    right = pointed_at(page, 0.6, 0.6, step=2)
    assert NASTY in right  # as it is written, not as a tag
    assert page.locator("img").count() == 0
    sides = "5 × 4" if dimension == 2 else "5 × 4 × 4"
    own = "4 × 5" if dimension == 2 else "4 × 5 × 4"
    place = "5, 0" if dimension == 2 else "5, 0, 0"
    for part in (
        "id 1, step 2, bin 0",
        f"size {sides}",
        f"position {place}",
        f"orientation {TURNED[dimension]} of {own}",
        "weight 3.25",
    ):
        assert part in right, part
    point_at(page, 0.02, 0.02)
    until(page, "jaxpack.hovered === null")


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_mouse_turns_or_moves_and_zooms_and_the_slider_leaves_the_view(show, dimension):
    page = show(*two_bins(dimension))
    first = picture(page)
    point_at(page, 0.5, 0.5)
    page.mouse.down()
    point_at(page, 0.6, 0.55)
    page.mouse.up()
    point_at(page, 0.02, 0.02)
    turned = picture(page, lambda now: now != first)
    point_at(page, 0.5, 0.5)
    page.mouse.wheel(0, -300)
    point_at(page, 0.02, 0.02)
    zoomed = picture(page, lambda now: now not in (first, turned))
    page.locator("#step").press("Home")
    picture(page, lambda now: now not in (first, turned, zoomed))
    page.locator("#step").press("End")
    picture(page, lambda now: now == zoomed)


def test_the_table_has_every_bin_and_what_was_left_out(show):
    page = show(*two_bins(3))
    cells = [row.locator("td").all_text_contents() for row in page.locator("tbody tr").all()]
    assert [[cell.strip() for cell in row] for row in cells] == [
        ["all", "", "3", "20.0 %", "5.75"],
        ["0", "crate (10 × 4 × 4)", "2", "100.0 %", "5.75 of 20"],
        ["1", "type 1 (20 × 4 × 8)", "1", "0.0 %", "0"],
    ]
    assert page.locator("#left-out summary").text_content() == "Left out: 1"
    assert page.locator("#left-out p").text_content() == f"1 × {NASTY}"
    assert page.title() == "two bins"


def test_a_title_is_text_and_no_button_sends_the_plan_away(show):
    page = show(*two_bins(3), title=NASTY)
    assert page.title() == NASTY
    assert page.locator("h1").text_content() == NASTY
    buttons = page.locator(".modebar-btn")
    assert [button.get_attribute("data-title") for button in buttons.all()] == [
        "Download plot as a PNG",
        "Reset camera to default",
    ]


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_plan_without_bins_and_a_bin_without_items_open(show, dimension):
    job, _ = two_bins(dimension)
    page = show(job, Plan((), (0, 1, 1, 2)))
    assert page.locator("#left-out summary").text_content() == "Left out: 4"
    assert page.locator("#step").count() == 0
    page = show(job, Plan((PackedBin(0, ()), PackedBin(1, ()))))
    assert shown(page) == []


@pytest.mark.parametrize("width", [330, 720, 950])
@pytest.mark.parametrize("bins", [1, 2, 5])
def test_nothing_is_cut_off_in_a_narrow_window(show, width, bins):
    job = Job((ItemType((12.0, 8.0, 15.0), bins),), (BinType((12.0, 8.0, 16.0)),))
    page = show(job, Plan((PackedBin(0, (Placement(0, "XYZ", (0.0, 0.0, 0.0)),)),) * bins))
    page.set_viewport_size({"width": width, "height": 800})
    page.reload()
    until(page, "!!window.jaxpack")
    seen = image.imread(BytesIO(picture(page)))[32:-12, 22:-22, :3]  # less the margins
    assert seen.min() < 0.5
    for edge in (seen[0], seen[-1], seen[:, 0], seen[:, -1]):
        assert (edge == 1).all()


def test_a_thousand_items_open_and_step(show):
    page = show(*many(20, 50))
    assert len(shown(page)) == 1000
    page.locator("#step").press("PageDown")
    assert len(shown(page)) == 900


def test_the_page_has_no_address_to_fetch_from(tmp_path):
    write_html(tmp_path / "plan.html", *two_bins(3), title="not Unicode: \udce9")
    page = (tmp_path / "plan.html").read_text("utf-8")
    own = re.sub(r"<script>.*?</script>", "", page, count=1, flags=re.DOTALL)  # the library
    assert len(own) < 30_000
    assert "http:" not in own
    assert "https:" not in own
    assert "default-src 'none'" in own


@pytest.fixture
def figures(monkeypatch):
    """The figures that were written."""
    kept, save = [], Figure.savefig

    def keep(figure, *arguments, **options):
        kept.append(figure)
        save(figure, *arguments, **options)

    monkeypatch.setattr(Figure, "savefig", keep)
    return kept


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_png_has_a_title_with_the_fill_for_every_bin(tmp_path, figures, dimension):
    write_png(tmp_path / "plan.png", *two_bins(dimension))
    assert image.imread(tmp_path / "plan.png").std() > 0.05
    assert [axis.get_title() for axis in figures[0].axes] == ["bin 0 (crate): 100%", "bin 1: 0%"]
    names = [text.get_text() for text in figures[0].legends[0].get_texts()]
    assert names == ["left", "</script><img src=x…", "item 2"]


@pytest.mark.parametrize(
    ("bins", "rows", "columns", "note"),
    [(1, 1, 1, None), (3, 1, 3, None), (6, 2, 5, None), (30, 6, 5, None), (33, 6, 5, "and 3 more")],
)
def test_a_png_has_rows_of_five_and_says_how_many_more(
    tmp_path, figures, bins, rows, columns, note
):
    write_png(tmp_path / "plan.png", *many(bins, 1))
    grid = figures[0].axes[0].get_gridspec()
    assert (grid.nrows, grid.ncols) == (rows, columns)
    assert (figures[0].get_supxlabel() or None) == note
    drawn = [axis for axis in figures[0].axes if axis.get_title()]
    assert len(drawn) == min(bins, 30)


def test_a_png_of_no_bin_says_so(tmp_path, figures):
    write_png(tmp_path / "plan.png", two_bins(3)[0], Plan((), (0, 1, 1, 2)))
    assert figures[0].get_suptitle() == "no bin is used"


def test_names_are_not_read_as_formulas(tmp_path):
    item, kind = ItemType((1.0, 1.0, 1.0), name="$\\frac$"), BinType((2.0, 2.0, 2.0), name="$x_{$")
    plan = Plan((PackedBin(0, (Placement(0, "XYZ", (0.0, 0.0, 0.0)),)),))
    write_png(tmp_path / "plan.png", Job((item,), (kind,)), plan)


def parts_of_a_box(random, count):
    """Boxes that fill a room: it is cut in two, again and again."""
    boxes = [(np.zeros(3), np.array([12.0, 8.0, 10.0]))]
    while len(boxes) < count:
        corner, size = boxes.pop(int(random.integers(len(boxes))))
        axis = int(random.integers(3))
        cut = size[axis] * random.uniform(0.3, 0.7)
        one, other, shift = size.copy(), size.copy(), corner.copy()
        one[axis], other[axis] = cut, size[axis] - cut
        shift[axis] += cut
        boxes += [(corner, one), (shift, other)]
    return (np.stack(column) for column in zip(*boxes, strict=True))


@pytest.mark.parametrize("seed", range(5))
def test_no_box_is_painted_over_one_in_front_of_it(seed):
    random = np.random.default_rng(seed)
    corner, size = parts_of_a_box(random, 40)
    shuffled = random.permutation(len(corner))
    corner, size = corner[shuffled], size[shuffled]
    order = pictures._back_to_front(corner, size)
    assert sorted(order) == list(range(len(corner)))
    painted = np.argsort(order)
    elevation, azimuth = math.radians(28), math.radians(-55)
    towards = np.array(
        [
            math.cos(elevation) * math.cos(azimuth),
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
        ]
    )
    start = corner + size * random.uniform(size=(20, *corner.shape))
    for way in np.linspace(0.1, 15, 100):
        points = start + way * towards
        inside = (points[:, :, None] > corner) & (points[:, :, None] < corner + size)
        _, behind, before = np.nonzero(inside.all(-1))
        assert (painted[behind] <= painted[before]).all()
