"""A number of packings gives the same plan on a busy machine; what a search says of itself."""

import math
import subprocess
import sys
from contextlib import contextmanager

import numpy as np
import pytest
from job_files import assert_refused
from test_background import JOB

import jaxpack
from jaxpack.model.encoding import compiles, load_job
from jaxpack.model.job import BinType, ItemType, Job
from jaxpack.search.portfolio import SolveOptions, solve_job
from jaxpack.search.record import End
from jaxpack.solution import Status

FLAT = Job(
    tuple(ItemType((side, 1.0, 12.0 - side), 3) for side in (3.0, 4.0, 5.0, 7.0)),
    (BinType((10.0, 1.0, 10.0)),),
    2,
)


@pytest.fixture
def uncompiled(monkeypatch):
    """The search in NumPy alone."""
    monkeypatch.setattr("jaxpack.search.portfolio.compiles", lambda loading: False)


@contextmanager
def busy():
    """A core, or more of them, with something else to do."""
    running = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(3)]
    try:
        yield
    finally:
        for one in running:
            one.kill()
            one.wait()


def counted(job, packings, seed=3, **options):
    """(the progress at the end, (packings, worth) of every better plan)."""
    better = []
    how = SolveOptions(packings=packings, seed=seed, **options)
    found = solve_job(job, how, progress=lambda one: better.append((one.packings, one.plan)))
    return found, better


@pytest.mark.long
@pytest.mark.parametrize("policy", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_packings_give_the_same_plan_on_a_busy_machine(policy):
    """What nobody compiles, then lanes, two dispatches or more, and a rest."""
    sides = np.random.default_rng(6).integers(4, 9, (70, 3)).tolist()
    items = tuple(ItemType(tuple(map(float, size))) for size in sides)
    job = Job(items, (BinType((13.0,) * 3, copies=1),), objective="value")
    assert compiles(load_job(job))
    number = 49 + 32 + 2 * 8 * 32 + 2 * 2 * 32 + 39
    found, better = counted(job, number, policy=policy)
    assert (found.end, found.packings) == (End.BUDGET, number)
    assert any(packings > 49 for packings, _ in better), "something came of the compiled search"
    with busy():
        again, same = counted(job, number, policy=policy)
    assert same == better
    assert (again.plan, again.end, again.packings) == (found.plan, End.BUDGET, number)
    other, _ = counted(job, number, seed=4, policy=policy)
    assert other.plan != found.plan


@pytest.mark.long
def test_a_budget_is_used_up_where_no_bin_is_filled_by_value():
    job = Job(JOB.items, (BinType((10.0, 10.0, math.inf)),), objective="height")
    number = 49 + 32 + 2 * 8 * 32 + 21
    found, _ = counted(job, number, policy=False)
    assert (found.end, found.packings) == (End.BUDGET, number)


@pytest.mark.parametrize("number", [1, 5, 20])
@pytest.mark.parametrize("objective", ["", "value", "height"])
def test_packings_are_counted_without_compiling_too(number, objective, uncompiled):
    side = 10.0 if objective != "value" else 9.5  # that nothing fills to its bound
    job = Job(JOB.items, (BinType((side,) * 3, copies=1 if objective else None),), 3, "", objective)
    found, better = counted(job, number)
    assert (found.end, found.packings) == (End.BUDGET, number)
    with busy():
        assert counted(job, number)[1] == better


def test_a_time_limit_ends_a_search_of_many_packings(uncompiled):
    found, _ = counted(JOB, 10**9, time_limit=0.5)
    assert found.end is End.TIME
    assert found.packings < 10**9
    assert SolveOptions(packings=5).seconds == math.inf
    assert SolveOptions().seconds == 10
    for wrong in (0, 1.5, "few"):
        assert_refused(lambda: jaxpack.solve(FLAT, packings=wrong), "packings")  # noqa: B023


@pytest.mark.parametrize("true", [True, 1])
def test_who_looks_on_sees_every_better_plan_and_can_end_the_search(true, uncompiled):
    seen = []
    found = jaxpack.solve(JOB, packings=40, progress=seen.append)
    assert found.status is Status.FEASIBLE
    assert found.limited_by == "the number of packings"
    assert seen[-1].plan == found.plan
    assert [one.measure for one in seen] == sorted((one.measure for one in seen), reverse=True)
    for one in seen:
        assert one.bins == one.measure >= one.bound == found.bound
        assert one.gap == one.bins / one.bound - 1
        assert one.packings <= 40
        assert 0 < one.seconds < found.seconds
    ended = jaxpack.solve(JOB, time_limit=600, progress=lambda one: true)
    assert (ended.status, ended.end) == (Status.INTERRUPTED, End.INTERRUPT)
    assert ended.plan == seen[0].plan

    def fails(better):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        jaxpack.solve(JOB, time_limit=600, progress=fails)


def test_the_status_is_honest(uncompiled):
    items = (ItemType((5.0, 1.0, 10.0), 4),)

    def status(bins, objective="", time_limit=0.3):
        job = Job(items, bins, 2, objective=objective)
        return jaxpack.solve(job, time_limit=time_limit).status

    assert status((BinType((10.0, 1.0, 10.0)),)) is Status.OPTIMAL
    few = (BinType((10.0, 1.0, 10.0), copies=1),)
    assert status(few) is Status.INFEASIBLE
    assert status(few, "value") is Status.OPTIMAL
    assert status(few, "height") is Status.INFEASIBLE
    assert status((BinType((10.0, 1.0, math.inf)),), "height") is Status.OPTIMAL
    assert jaxpack.solve(JOB, time_limit=0.3).status is Status.FEASIBLE


def test_the_command_takes_a_number_of_packings(tmp_path):
    (tmp_path / "items.csv").write_text("X,Y,Z\n" + "".join(
        f"{x},{y},{z}\n" for x, y, z in (item.size for item in JOB.items)
    ))  # fmt: skip
    (tmp_path / "bins.csv").write_text("X,Y,Z\n10,10,10\n")
    options = "items.csv", "bins.csv", "--packings", "6", "--out", "p.json"
    plans = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-m", "jaxpack", "solve", *options],
            cwd=tmp_path, capture_output=True, text=True,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert "limited by   the number of packings" in done.stdout
        assert " s, 6 packings tried" in done.stdout
        plans.append((tmp_path / "p.json").read_text())
    assert plans[0] == plans[1]
