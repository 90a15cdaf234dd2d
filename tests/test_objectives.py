"""What is wanted of a plan: value and height against everything tried, and what others want."""

import json
import math
import random
import subprocess
import sys
from itertools import islice, permutations, product

import numpy as np
import pytest
from job_files import assert_refused
from optimum import greatest_value
from test_bounds import FLAT, FREE

import jaxpack
from jaxpack.io.jobs import job_from_columns, read_job
from jaxpack.model.encoding import Genes, fitting_ways, load_job
from jaxpack.model.job import BinType, ItemType, Job
from jaxpack.model.objectives import bounds, objective_of
from jaxpack.model.plan_check import check_plan
from jaxpack.search.portfolio import End, SolveOptions, solve_job
from jaxpack.search.quick import pack_quickly


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
        plan = solve_job(job, SolveOptions(0.5)).plan
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
    assert "left out     3 items (1 of half, 1 of large, 1 of cube)" in output
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


def test_knapsack_files_have_profits_and_copies(tmp_path):
    lines = "3\n10 12\n1 3 5 0 4 15\n2 4 2 0 1 8\n3 1 1 0 1 1\n"
    path = tmp_path / "k.ins2D"
    path.write_text(lines)
    (job,) = read_job(path, objective="value")
    assert [(item.copies, item.profit) for item in job.items] == [(4, 15), (1, 8), (1, 1)]
    assert job.bins[0].copies == 1
    assert_refused(lambda: read_job(path), "column dmin: 0 is not possible")
