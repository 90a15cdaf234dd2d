"""What is wanted of a plan: value and height against everything tried, and what others want."""

import json
import math
import pickle
import random
import subprocess
import sys
from dataclasses import replace
from itertools import islice, permutations, product

import numpy as np
import pytest
from job_files import assert_refused
from optimum import greatest_value, lowest
from test_bounds import FLAT, FREE

import jaxpack
from jaxpack.errors import UserError
from jaxpack.io.jobs import job_from_columns, read_job
from jaxpack.model.bounds import Bounds
from jaxpack.model.encoding import Genes, fitting_ways, lane_genes, load_job, padded, plan_of
from jaxpack.model.job import UPRIGHT, BinType, ItemType, Job
from jaxpack.model.limits import BinLimits, Obstacle
from jaxpack.model.objectives import OBJECTIVES, Objective, Placed, bounds, objective_of
from jaxpack.model.plan_check import InvalidPlanError, check_plan
from jaxpack.model.rules import Rules
from jaxpack.plan_tables import figures_of_one
from jaxpack.search.portfolio import SolveOptions, solve_job
from jaxpack.search.quick import cost_of, pack_quickly, quick_plan
from jaxpack.search.record import End
from jaxpack.solution import Status


@pytest.fixture
def uncompiled(monkeypatch):
    """The search in NumPy alone."""
    monkeypatch.setattr("jaxpack.search.portfolio.compiles", lambda loading: False)


def tiny_job(rng, objective, items=5, bins=2):
    """A few items, of 2D or 3D, of which the bins hold some."""
    dimension = rng.choice((2, 3))
    largest = 5 if dimension == 3 else 8

    def size(low, high):
        width = rng.randint(low, high) if dimension == 3 else 1
        return rng.randint(low, high), width, rng.randint(low, high)

    heavy, dear = rng.random() < 0.4, rng.random() < 0.6
    return Job(
        tuple(
            ItemType(
                size(1, largest - 1),
                weight=rng.randint(0, 9) if heavy else 0,
                orientations=rng.choice(FREE if dimension == 3 else FLAT),
                profit=rng.choice((None, rng.randint(0, 30))) if dear else None,
            )
            for _ in range(rng.randint(2, items))
        ),
        tuple(
            BinType(size(2, largest), copies=rng.choice((0, 1, 1, 2)))
            if not heavy
            else BinType(size(2, largest), copies=1, max_weight=rng.randint(0, 20))
            for _ in range(rng.randint(1, bins))
        ),
        dimension,
        objective=objective,
    )


@pytest.mark.parametrize("seed", range(4))
def test_no_subset_is_worth_more_than_the_bound(seed):
    rng, reached = random.Random(seed), 0
    for _ in range(100):
        job = tiny_job(rng, "value")
        value, bins, volume = greatest_value(job)
        found = bounds(job)
        assert value <= found.best, job
        assert found.worth <= (-value, -bins, -volume), job
        reached += value == found.best
    assert reached > 40


@pytest.mark.parametrize("seed", range(4))
def test_no_fewer_items_are_left_out_than_the_bound_says(seed):
    rng, reached, some = random.Random(seed), 0, 0
    for _ in range(100):
        job = tiny_job(rng, "bins")
        alike = replace(
            job,
            items=tuple(replace(item, profit=1.0) for item in job.items),
            objective="value",
        )
        packed, bins, volume = greatest_value(alike)
        worth = job.count - packed, -bins, -volume
        found = bounds(job)
        assert found.worth <= worth, job
        if worth[0] > found.unfit:
            some, reached = some + 1, reached + (found.worth == worth)
    assert some > 10
    assert reached > some / 3


@pytest.mark.parametrize("objective", ["bins", "price", "value"])
@pytest.mark.parametrize("bins", [1, 2, 3])
def test_bins_that_are_full_end_the_search(objective, bins, uncompiled):
    profits = (2.0, 3.0) if objective == "value" else (None, None)
    items = tuple(ItemType((5, 5, 5), 20, profit=profit) for profit in profits)
    job = Job(items, (BinType((10, 10, 10), copies=bins, cost=7),), objective=objective)
    found = solve_job(job, SolveOptions(packings=100))
    assert found.end is End.BOUND
    assert found.packings < 5
    assert (len(found.plan.bins), len(found.plan.left_out)) == (bins, 40 - 8 * bins)


def everything(job, score):
    """The least score of first fit over all orders, orientations and sequences of bins.

    Args:
        score: (loading, rows of the job that are packed, where their tops are) -> a number.
    """
    loading, least = load_job(job, skip_unfit=True), math.inf
    sizes, N = loading.stock.sizes, len(loading.items)
    for order in permutations(range(N)):
        for turn in product(*map(range, loading.stock.ways)):
            for pool in permutations(range(len(loading.bins))):
                genes = Genes(*(np.array(row, np.int32) for row in (order, turn, pool)))
                bin, corner = pack_quickly(loading, genes, blocks=False)
                tops = corner[:, 2] + sizes[np.arange(N), genes.turn, 2]
                least = min(least, score(loading, loading.items[bin >= 0], tops[bin >= 0]))
    return least


@pytest.mark.parametrize("seed", range(6))
def test_the_search_finds_the_best_subset(seed, uncompiled):
    rng = random.Random(seed)
    jobs = (tiny_job(rng, "value", items=4, bins=1) for _ in range(99))
    for job in islice(filter(any_fits, jobs), 3):
        plan = solve_job(job, SolveOptions(packings=2000)).plan
        check_plan(job, plan)
        value = objective_of(job).measure(job, plan)
        assert value == -everything(job, loss) <= greatest_value(job)[0], job


def any_fits(job):
    return any(fitting_ways(job))


def loss(loading, packed, tops):
    items = [loading.job.items[n] for n in packed]
    return -sum(math.prod(i.size) if i.profit is None else i.profit for i in items)


ITEMS = "X,Y,Z,COPIES,PROFIT,ID\n6,10,10,1,8,large\n5,10,10,3,7,half\n1,1,1,1,-1,cube\n"
BIN = "X,Y,Z\n10,10,10\n"


def write(folder, **texts):
    for name, text in texts.items():
        (folder / f"{name}.csv").write_text(text)


def run(folder, *options):
    """(exit code, lines of the output, of the errors) of `python -m jaxpack`."""
    done = subprocess.run(
        [sys.executable, "-m", "jaxpack", *options], cwd=folder, capture_output=True, text=True
    )
    return done.returncode, done.stdout.splitlines(), done.stderr.splitlines()


def test_the_command_packs_the_best_subset_and_the_check_knows_it(tmp_path):
    write(tmp_path, items=ITEMS, bins=BIN)
    files = "items.csv", "bins.csv"
    code, output, _ = run(
        tmp_path, "solve", *files, "--objective", "value", "--out", "p.json", "--time-limit", "1"
    )
    assert code == 0, "to leave out is the point"
    assert "value        14 of 30, at most 14, gap 0.0 %" in output
    assert "left out     3 items (1 of large, 1 of half, 1 of cube)" in output
    assert "limited by   the bound: no plan can be better" in output
    plan = json.loads((tmp_path / "p.json").read_text())
    assert plan["objective"] == "value"
    assert [item["profit"] for item in plan["bins"][0]["items"]] == [7, 7]
    assert plan["bins"][0]["profit"] == 14
    valid = "valid: 1 bin, 2 items, fill 100.0 %, value 14, 3 items left out"
    assert run(tmp_path, "check", "p.json", *files)[:2] == (0, [valid])
    # Of another job, and of a certificate, which does not say what it is for.
    write(tmp_path, items=ITEMS.replace(",7,", ",8,"))
    code, _, errors = run(tmp_path, "check", "p.json", *files)
    assert code == 2
    assert "key 'profit': 7, but this job has 8: is it of another job?" in errors[-1]
    write(tmp_path, items=ITEMS)
    (tmp_path / "q.json").write_text((tmp_path / "p.json").read_text().replace('"value"', '"fun"'))
    code, _, errors = run(tmp_path, "check", "q.json", *files)
    assert (code, "q.json: key 'objective': objective 'fun': choose" in errors[-1]) == (2, True)
    options = ("--time-limit", "1", "--objective", "value", "--out", "p.csv")
    assert run(tmp_path, "solve", *files, *options)[0] == 0
    assert run(tmp_path, "check", "p.csv", *files)[0] == 2
    assert run(tmp_path, "check", "p.csv", *files, "--objective", "value")[1] == [valid]


def tables(**columns):
    return {"X": [4, 4], "Y": [4, 4], "Z": [4, 2], **columns}, {"X": [4], "Y": [4], "Z": [4]}


def test_a_profit_is_obeyed_for_the_value_alone():
    goods, room = tables(PROFIT=[1, 1.5])
    assert_refused(lambda: jaxpack.solve(goods, room), "row 0, column PROFIT", "not obeyed")
    job = job_from_columns(goods, room, objective="value")
    assert [item.profit for item in job.items] == [1, 1.5]
    assert job.bins[0].copies == 1
    for same in ([None, -1], None):
        goods, room = tables(**({"PROFIT": same} if same else {}))
        job = job_from_columns(goods, room | {"COPIES": [-1]}, objective="value")
        assert [item.profit for item in job.items] == [None, None]
        assert job.bins[0].copies is None
    for column, values, words in (
        ("PROFIT", [1, -2], ("row 1, column PROFIT", "-2 is not a profit")),
        ("PROFIT", [1, "dear"], ("row 1, column PROFIT", "'dear' is not a number")),
        ("VALUE", [1, 2], ("column VALUE", "is PROFIT meant?")),
        ("COPIES_MIN", [1, 1], ("row 0, column COPIES_MIN", "not obeyed")),
    ):
        goods, room = tables(**{column: values})
        assert_refused(lambda: job_from_columns(goods, room, objective="value"), *words)  # noqa: B023
    goods, room = tables(PROFIT=[1, 2], COPIES_MIN=[0, 0])
    assert job_from_columns(goods, room, objective="value", ignore="PROFIT").items[0].profit is None


def test_an_objective_is_known_by_its_name(tmp_path):
    goods, room = tables()
    job = job_from_columns(goods, room)
    for name in ("valu", "paper"):
        wrong = f"objective '{name}': choose bins, price"
        assert_refused(lambda: jaxpack.solve(goods, room, objective=name), wrong)  # noqa: B023
        assert_refused(lambda: jaxpack.solve(job, objective=name), wrong)  # noqa: B023


@pytest.mark.parametrize("objective", ["bins", "price"])
def test_costs_count_as_the_objective_says(objective, uncompiled):
    """Two cheap bins, or a dear one."""
    kinds = BinType((10, 10, 10), cost=2.0), BinType((20, 10, 10), cost=5.0)
    job = Job((ItemType((10, 10, 10), 2),), kinds, objective=objective)
    found = solve_job(job, SolveOptions(0.5))
    assert [packed.bin for packed in found.plan.bins] == ([1] if objective == "bins" else [0, 0])
    assert found.end is End.BOUND


@pytest.mark.parametrize("cheap", [7.25, 7.49])
def test_a_little_cheaper_counts_before_smaller(cheap, uncompiled):
    kinds = BinType((10, 10, 10), cost=cheap), BinType((9, 9, 9), cost=7.5)
    found = solve_job(Job((ItemType((1, 1, 1), 3),), kinds), SolveOptions(packings=20))
    assert (found.cost, found.end) == (cheap, End.BOUND)
    kinds = BinType((10, 10, 10), cost=cheap), BinType((20, 10, 10), cost=15.0)
    found = solve_job(Job((ItemType((10, 10, 10), 2),), kinds), SolveOptions(packings=20))
    assert (found.cost, found.end) == (2 * cheap, End.BOUND)


def test_knapsack_files_have_profits_and_copies(tmp_path):
    lines = "3\n10 12\n1 3 5 0 4 15\n2 4 2 0 1 8\n3 1 1 0 1 1\n"
    path = tmp_path / "k.ins2D"
    path.write_text(lines)
    (job,) = read_job(path, objective="value")
    assert [(item.copies, item.profit) for item in job.items] == [(4, 15), (1, 8), (1, 1)]
    assert job.bins[0].copies == 1
    assert_refused(lambda: read_job(path), "column dmin: 0 is not possible")


def strip_job(rng, items=5):
    """A few items for an open bin, of 2D or 3D, all of which fit its floor."""
    job = tiny_job(rng, "", items, bins=1)
    x, y, _ = job.bins[0].size
    return replace(job, bins=(BinType((x, y, math.inf)),), objective="height")


@pytest.mark.parametrize("seed", range(4))
def test_no_height_is_below_the_bound(seed):
    rng, reached = random.Random(seed), 0
    for _ in range(60):
        job = strip_job(rng)
        least, found = lowest(job), bounds(job)
        assert found.best <= least, job
        assert found.worth == (sum(not ways for ways in fitting_ways(job)), found.best)
        reached += found.best == least
    assert reached > 40


@pytest.mark.parametrize("seed", range(6))
def test_the_search_finds_the_least_height(seed, uncompiled):
    rng = random.Random(seed)
    jobs = (strip_job(rng, items=4) for _ in range(99))
    for job in islice(filter(any_fits, jobs), 3):
        found = solve_job(job, SolveOptions(packings=2000, skip_unfit=True))
        check_plan(job, found.plan)
        height = objective_of(job).measure(job, found.plan)
        assert height == everything(job, top) >= lowest(job), job


def top(loading, packed, tops):
    """Of what holds all items."""
    return tops.max() if len(packed) == len(loading.items) else math.inf


STRIP = "WIDTH,HEIGHT,COPIES,ID\n4,3,2,a\n2,6,1,b\n"


@pytest.mark.parametrize(
    "high", ["", *(pytest.param(high, marks=pytest.mark.long) for high in ("-1", "inf", "20"))]
)
@pytest.mark.parametrize("out", ["p.json", "p.csv"])
def test_the_command_finds_the_least_height_and_the_check_knows_it(tmp_path, high, out):
    write(tmp_path, items=STRIP, bins=f"WIDTH,HEIGHT\n6,{high}\n")
    files = "items.csv", "bins.csv", "--objective", "height"
    code, output, _ = run(tmp_path, "solve", *files, "--out", out, "--time-limit", "1")
    assert code == 0
    assert output[:3] == [
        "bins         1",
        "fill         100.0 %",
        "height       6, at least 6, gap 0.0 %",
    ]
    valid = "valid: 1 bin, 3 items, fill 100.0 %, height 6"
    assert run(tmp_path, "check", out, *files)[:2] == (0, [valid])
    text = (tmp_path / out).read_text()
    lower = text.replace("[6, 1, 6]", "[6, 1, 5.5]").replace(
        "BIN,0,1,0,0,0,6,6", "BIN,0,1,0,0,0,6,5"
    )
    assert lower != text
    (tmp_path / out).write_text(lower)
    code, output, _ = run(tmp_path, "check", out, *files)
    assert code == 1
    assert "outside the bin: along z it reaches to 6, the bin to 5" in output[0]


def test_an_open_height_has_room_for_gaps_and_on_obstacles():
    items = (ItemType((10.0, 1.0, 3.0), 3),)
    sheet = Job(items, (BinType((10.0, 1.0, math.inf)),), 2, objective="height")
    assert jaxpack.solve(sheet, packings=2, gap=0.1).height == pytest.approx(9.2)
    for top, corner in ((6.0, 0.0), (6.0, 5.0), (0.5, 4.0)):
        held = Obstacle((0.0, 0.0, corner), (10.0, 8.0, top))
        open_bin = BinType((10.0, 8.0, math.inf), limits=BinLimits(obstacles=(held,)))
        job = Job((ItemType((10.0, 8.0, 1.0), 2),), (open_bin,), objective="height")
        found = jaxpack.solve(job, packings=2)
        assert found.height == corner + top + 2
        jaxpack.check_plan(replace(job, bins=found.job.bins), found.plan)


def test_a_height_is_open_for_the_objective_height_alone(tmp_path):
    goods = {"X": [4], "Y": [4], "Z": [4]}
    for z in (None, -1, math.inf):
        room = {"X": [10], "Y": [10], "Z": [z]}
        assert job_from_columns(goods, room, objective="height").bins[0].open
        for other in ("", "bins", "value"):
            words = "row 0, column Z", "the height is open", "--objective height"
            assert_refused(lambda: job_from_columns(goods, room, objective=other), *words)  # noqa: B023
        assert_refused(
            lambda: job_from_columns(goods, room | {"Y": [z]}, objective="height"),  # noqa: B023
            "row 0, column Y",
        )
    item, open_bin = ItemType((4, 4, 4)), BinType((10, 10, math.inf))
    assert_refused(lambda: jaxpack.solve(Job((item,), (open_bin,))), "the height is open")
    assert_refused(lambda: bounds(Job((item,), (open_bin,))), "the height is open")
    two = Job((item,), (open_bin, BinType((5, 5, 5))), objective="height")
    assert_refused(lambda: jaxpack.solve(two), "objective height: 2 types of bins; give one bin")
    assert_refused(lambda: Job((ItemType((4, 4, math.inf)),), (open_bin,)), "item 0, size: inf")
    assert_refused(lambda: Job((ItemType((4, 4, 1e9), 5),), (open_bin,)), "choose a larger unit")
    path = tmp_path / "strip.ins2D"
    path.write_text("2\n6 -1\n1 4 3 2\n2 2 6 1\n")
    (job,) = read_job(path, objective="height")
    assert job.bins[0].size == (6, 1, math.inf)
    assert bounds(job).best == 6
    assert_refused(lambda: read_job(path), "column H: -1 is not a size")


@pytest.mark.parametrize("dimension", [2, 3])
def test_an_open_bin_holds_all_however_little_time_there_is(dimension):
    """Columns side by side, not all on top of each other."""
    rng = random.Random(dimension)
    sizes = [[rng.randint(1, 9) for _ in range(3)] for _ in range(300)]
    items = tuple(ItemType((x, y if dimension == 3 else 1, z)) for x, y, z in sizes)
    room = BinType((50, 40 if dimension == 3 else 1, math.inf))
    job = Job(items, (room,), dimension, objective="height")
    loading = load_job(job)
    best = quick_plan(loading, lane_genes(loading, 0, 0), stop=lambda: True)
    plan = plan_of(loading, best.genes.order, best.genes.turn, best.bin, best.corner, {0: 0})
    check_plan(job, plan, Rules(1.0))
    assert plan.left_out == ()
    assert plan.bins[0].height < 3 * bounds(job).best


def test_a_plan_of_fine_lengths_reaches_to_its_height(uncompiled):
    sizes = [(0.1, 0.3, 0.7), (0.25, 0.3, 0.125), (0.125, 0.1, 0.3)]
    items = tuple(ItemType(size, 7, orientations=UPRIGHT) for size in sizes)
    job = Job(items, (BinType((0.5, 0.5, math.inf)),), objective="height")
    found = jaxpack.solve(job, time_limit=0.5)
    (packed,) = found.plan.bins
    tops = [put.corner[2] + job.items[put.item].size[2] for put in packed.placements]
    assert found.height == packed.height == pytest.approx(max(tops), rel=1e-12)
    assert found.figures.utilisation == pytest.approx(
        sum(7 * math.prod(size) for size in sizes) / (0.25 * found.height)
    )
    lower = replace(found.plan, bins=(replace(packed, height=found.height - 1e-6),))
    with pytest.raises(InvalidPlanError, match="outside the bin: along z"):
        check_plan(job, lower)
    check_plan(job, replace(found.plan, bins=(replace(packed, height=None),)))


def most_items(job, plan):
    return float(sum(len(packed.placements) for packed in plan.bins))


def many_cost(stock, placed):
    return ((placed.bin < 0) & stock.mask).sum(1) / stock.mask.sum()


MANY = Objective(
    minimised="most items",
    worth=lambda job, plan: (-int(most_items(job, plan)),),
    bound=lambda job, seconds: Bounds(0, 0.0, 0, (-job.count,), float(job.count)),
    measure=most_items,
    cost=many_cost,
    figure="items packed",
    maximised=True,
    leaves_out=True,
)


def test_an_objective_of_somebody_else_is_one_entry(monkeypatch):
    """Large items first, as the sorts have them, leave no room for many.

    Its functions have no names by which another process could find them: the compiled search does
    without.
    """
    monkeypatch.setitem(OBJECTIVES, "many", MANY)
    goods = {"WIDTH": [10, 1], "HEIGHT": [10, 1], "COPIES": [1, 60]}
    room = {"WIDTH": [10], "HEIGHT": [10]}
    assert len(jaxpack.solve(goods, room, objective="value", packings=20).plan.left_out) == 60
    found = jaxpack.solve(goods, room, objective="many", packings=400)
    assert found.plan.left_out == (0,)
    assert found.gap == pytest.approx(1 / 61)
    assert found.status is Status.FEASIBLE
    assert figures_of_one(found)["items packed"] == "60, at most 61, gap 1.6 %"
    with pytest.raises(UserError, match="choose bins, price, value, height or many"):
        jaxpack.solve(goods, room, objective="more")


@pytest.mark.parametrize("name", [name for name, one in OBJECTIVES.items() if one.of_orders])
def test_a_packing_costs_the_same_alone_and_among_others(name):
    """Padding or not."""
    sizes = np.random.default_rng(0).integers(1, 6, (20, 3)).tolist()
    items = tuple(ItemType(tuple(map(float, size)), 2, orientations=UPRIGHT) for size in sizes)
    kinds = BinType((9.0, 8.0, 7.0), 3.0, 2), BinType((6.0, 9.0, 9.0), 2.0, 1)
    job = Job(items, kinds[: 1 if name == "height" else 2], objective=name)
    loading, goal = load_job(job), OBJECTIVES[name]
    assert pickle.loads(pickle.dumps(loading)).objective.cost is goal.cost
    stock, lanes, alone = padded(loading.stock, 64, 16), [], []
    for lane in range(4):
        genes = lane_genes(loading, 0, lane)
        bin, corner = pack_quickly(loading, genes)
        lies = loading.stock.sizes[np.arange(len(bin)), genes.turn]
        rows = (0, 64 - len(bin))
        sides = (np.pad(leaf, (rows, (0, 0))) for leaf in (corner, lies))
        lanes.append(Placed(np.pad(bin, rows, constant_values=-1), *sides))
        alone.append(cost_of(loading, genes, bin, corner))
    together = goal.cost(stock, Placed(*map(np.stack, zip(*lanes, strict=True))))
    np.testing.assert_allclose(together, alone, rtol=1e-12)
