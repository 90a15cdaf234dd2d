"""The process of the compiled search: it answers, it can be left at any time, and nothing of it
goes on then.
"""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import numpy as np
import psutil
import pytest

from jaxpack.io.locks import held
from jaxpack.model.encoding import lane_genes, load_job
from jaxpack.model.job import BinType, ItemType, Job
from jaxpack.model.plan_check import check_plan
from jaxpack.search import background, portfolio
from jaxpack.search.background import SearchProcess, borrow, give_back
from jaxpack.search.portfolio import SolveOptions, improve, solve_job
from jaxpack.search.record import End
from jaxpack.search.requests import Request

# The bound says three bins, which would have to be filled to the last few units: the search goes on
# for as long as it may.
SIZES = np.random.default_rng(5).integers(2, 6, (70, 3)).tolist()
JOB = Job(tuple(ItemType(tuple(size)) for size in SIZES), (BinType((10.0,) * 3),))
ANSWER = 200.0  # seconds in which a busy machine has compiled it


@pytest.fixture
def process():
    """One of its own, gone afterwards."""
    running = SearchProcess()
    yield running
    running.kill()


def ask(process, seconds, seed=0):
    loading = load_job(JOB)
    process.ask(Request(loading, seed, seconds, lane_genes(loading, 0, 0), ""))
    return loading


def assert_at_rest(process):
    """It is halted, or waits for what it is asked next."""
    running = psutil.Process(process.process.pid)
    for _ in range(20):  # on a busy machine what ends takes its time
        before = used(running)
        time.sleep(0.5)
        halted = running.status() == psutil.STATUS_STOPPED
        if used(running) - before < 0.05 and halted == bool(process.running):
            return
    raise AssertionError("it goes on")


def used(*processes):
    """Seconds of CPU that they have used."""
    return sum(sum(one.cpu_times()[:2]) for one in processes)


def test_it_answers_each_search_and_waits_for_the_next(process):
    for seed in range(2):
        loading = ask(process, seconds=ANSWER, seed=seed)
        found = process.next(ANSWER)
        assert found.packings >= 8
        best = found.best
        assert len(set(best.bin.tolist())) >= 4
        assert (best.bin >= 0).all()
        assert len(best.bin) == len(loading.items) == len(best.genes.order)
        process.end()
        assert process.alive
    assert_at_rest(process)


@pytest.mark.parametrize("after", [0.0, 1.0, pytest.param(4.0, marks=pytest.mark.slow)])
def test_left_in_the_middle_of_anything_it_uses_no_time_and_goes_on_later(process, after):
    assert process.listening.wait(ANSWER)
    ask(process, seconds=ANSWER)
    time.sleep(after)
    begun = time.perf_counter()
    process.end()
    assert time.perf_counter() - begun < ANSWER / 10, "it is not waited for"
    assert_at_rest(process)
    ask(process, seconds=ANSWER, seed=7)
    assert process.next(ANSWER) is not None


def test_it_finishes_and_ends_when_it_is_let_go(process):
    ask(process, seconds=ANSWER)
    time.sleep(1)
    process.end()
    process.let_go()
    assert process.process.wait(ANSWER) == 0


@pytest.mark.parametrize("packings", [None, 200])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV])
def test_a_search_goes_on_without_it(number, packings, monkeypatch):
    """And says so: a plan by a number of packings may be another one then."""
    taken = []

    def borrowed():
        taken.append(SearchProcess())
        return taken[-1]

    def stop():
        for process in taken:
            process.process.send_signal(number)
        return False

    monkeypatch.setattr(portfolio, "borrow", borrowed)
    *_, last = improve(
        JOB, SolveOptions(4.0 if packings is None else 60.0, packings=packings), stop
    )
    assert last.end == End.LOST
    assert last.packings == packings or (packings is None and last.packings > 1)
    check_plan(JOB, last.plan)
    assert taken[0].process.wait(ANSWER) == -number


def test_where_there_can_be_no_process_a_search_goes_on_alone(monkeypatch):
    monkeypatch.setattr(background, "_waiting", [])
    for executable in ("", "/no/such/interpreter"):
        monkeypatch.setattr(sys, "executable", executable)
        found = solve_job(JOB, SolveOptions(2.0))
        assert found.packings > 1
        assert found.end == End.TIME


def test_searches_side_by_side_have_a_process_each():
    one, other = borrow(), borrow()
    assert one is not other
    give_back(one)
    assert borrow() is one
    one.kill()
    other.kill()
    give_back(one)
    third = borrow()
    assert third not in (one, other)
    give_back(third)
    assert third in background._waiting


def test_the_end_of_time_is_the_end_of_work():
    begun = time.perf_counter()
    found = solve_job(JOB, SolveOptions(2.0))
    assert time.perf_counter() - begun < ANSWER / 10
    assert found.end in (End.TIME, End.UNREADY)
    me = psutil.Process()
    everyone = [me, *me.children(recursive=True)]
    for _ in range(5):  # on a busy machine what ends takes its time
        before = used(*everyone)
        time.sleep(1)
        if used(*everyone) - before < 0.2:
            return
    raise AssertionError("something goes on")


SCRIPT = """
import jaxpack
from jaxpack.search import background
items = [dict(zip("XYZ", size)) for size in %s]
background.LISTENING = 100.0  # on a busy machine
for _ in range(60):
    if not background._waiting:
        jaxpack.solve(items, [{"X": 10, "Y": 10, "Z": 10}], time_limit=1)
print(background._waiting[0].process.pid, flush=True)
"""
LEFT_AT_ONCE = """
from jaxpack.model.encoding import lane_genes, load_job
from jaxpack.model.job import BinType, ItemType, Job
from jaxpack.search import background, requests
items = tuple(ItemType(tuple(size)) for size in %s)
loading = load_job(Job(items, (BinType((10.0,) * 3),)))
background.LISTENING = 100.0  # on a busy machine
process = background.borrow()
process.ask(requests.Request(loading, 0, 1.0, lane_genes(loading, 0, 0), ""))
background.give_back(process)
print(process.process.pid, flush=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize("killed", [False, True])
@pytest.mark.parametrize("script", [SCRIPT, LEFT_AT_ONCE])
def test_nobody_waits_for_it_and_it_does_not_stay(script, killed, tmp_path):
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(tmp_path)}
    script = script % SIZES + "import time; time.sleep(1000)" * killed
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", script], env=environment, **pipes) as running:
        left = psutil.Process(int(running.stdout.readline()))
        begun = time.perf_counter()
        if killed:
            running.kill()
        _, errors = running.communicate(timeout=100)
        assert time.perf_counter() - begun < ANSWER / 10
        assert killed or not errors
    while left.is_running() and left.status() != psutil.STATUS_ZOMBIE:
        waited = time.perf_counter() - begun
        assert waited < 2 * ANSWER
        with suppress(psutil.NoSuchProcess):
            assert waited < ANSWER / 4 or left.status() != psutil.STATUS_STOPPED
        time.sleep(0.5)
    assert [*tmp_path.glob("*-cache")], "what it was compiling is there for the next one"


def test_of_many_that_are_let_go_one_goes_on(tmp_path, monkeypatch):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    second = SearchProcess()
    ask(second, seconds=ANSWER)
    second.end()
    with held(tmp_path / ".finishing", "it is the other one that goes on"):
        second.let_go()
        assert second.process.wait(ANSWER) == 0
    assert not [*tmp_path.glob("*-cache")]
