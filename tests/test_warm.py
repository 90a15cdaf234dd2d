"""`jaxpack warm`: what it compiles is what a search would have compiled."""

import os
import subprocess
import sys
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxpack.model.encoding import lane_genes, load_job
from jaxpack.model.job import BinType, ItemType, Job
from jaxpack.search.background import SearchProcess
from jaxpack.search.packer import program_of, programs
from jaxpack.search.portfolio import policy_name
from jaxpack.search.requests import Request
from jaxpack.warm import drop_cut_short

WAYS = {2: ("XYZ", "ZYX"), 3: ("XYZ", "YXZ", "ZYX", "YZX", "XZY", "ZXY")}


def warmed(folder, *options):
    command = [sys.executable, "-m", "jaxpack.warm", *options]
    here = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(folder)}
    done = subprocess.run(command, env=here, capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


def job_of(dimension, count, ways, types=1, unit=1.0, weight=0.0):
    rng = np.random.default_rng(count)
    depth = 1 if dimension == 2 else None
    sizes = [
        (float(x) * unit, depth or float(y) * unit, float(z) * unit)
        for x, y, z in rng.integers(2, 9, (count, 3))
    ]
    rooms = [((12.0 + n) * unit, depth or 10 * unit, 11 * unit) for n in range(types)]
    limit = 50 * weight or np.inf
    return Job(
        tuple(ItemType(size, weight=weight, orientations=WAYS[dimension][:ways]) for size in sizes),
        tuple(BinType(room, max_weight=limit) for room in rooms),
        dimension,
    )


def search_all(jobs):
    """In a process as `solve` uses it, with the orders that the policy draws."""
    process = SearchProcess()
    try:
        for job in jobs:
            loading, best = load_job(job), None
            policy = policy_name(job.dimension)
            process.ask(Request(loading, 0, 500.0, lane_genes(loading, 0, 0), policy, 200))
            while process.running:
                assert process.alive
                best = process.next(1.0) or best
            assert best is not None
    finally:
        process.kill()


def programs_in(folder):
    return {path.name for path in folder.iterdir() if path.name.startswith("jit")}


@pytest.mark.long
@pytest.mark.parametrize(
    ("dimension", "most", "ways"),
    [(2, 16, (1, 2)), pytest.param(3, 32, (1, 2, 6), marks=pytest.mark.slow)],
)
def test_a_search_has_nothing_to_compile_after_it(dimension, most, ways, tmp_path, monkeypatch):
    options = "--items", str(most), "--dimension", f"{dimension}d"
    code, output, errors = warmed(tmp_path, *options)
    assert code == 0, errors
    assert " programs, 0 were there: " in output
    assert str(tmp_path) in output
    assert len(errors.splitlines()) == int(output.split()[0])
    there = programs_in(tmp_path)
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    some = [job_of(dimension, *of) for of in zip((most, 11, 1), ways, strict=False)]
    some += [job_of(dimension, most, 2, types=4), job_of(dimension, 9, 1, unit=5e4)]
    search_all(some)
    assert programs_in(tmp_path) == there
    code, output, errors = warmed(tmp_path, *options)
    count = int(output.split()[0])
    assert (code, errors) == (0, "")
    assert f"{count} programs, {count} were there: " in output


@settings(deadline=None, max_examples=60)
@given(
    dimension=st.sampled_from([2, 3]),
    count=st.integers(1, 300),
    types=st.integers(1, 4),
    unit=st.sampled_from([0.1, 1.0, 3e3, 1e5]),
    weight=st.sampled_from([0.0, 0.5, 123_456.789]),
)
def test_there_is_a_program_for_every_job(dimension, count, types, unit, weight):
    job = job_of(dimension, count, 2, types, unit, weight)
    loading = load_job(job)
    program = program_of(loading)
    assert program in set(programs(dimension == 2, count))
    fewer = replace(job, items=job.items[:1])
    assert program_of(load_job(fewer)) in set(programs(dimension == 2, 1))


def test_programs_that_were_cut_short_are_not_kept(tmp_path):
    whole, other = zlib.compress(b"a program" * 99), b"not zlib's"
    for name, kept in (("a", whole), ("b", whole[:-5]), ("c", other), ("d", b"")):
        (tmp_path / f"jit_{name}-cache").write_bytes(kept)
    assert drop_cut_short(tmp_path) == 2
    assert {path.name[4] for path in tmp_path.iterdir()} == {"a", "c"}


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").touch()
    code, output, errors = warmed(tmp_path / "file")
    assert (code, output) == (2, "")
    assert errors.startswith(f"error: {tmp_path / 'file'}: programs cannot be kept there; name ")
    assert errors.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--items", "0"), "error: --items 0: give at least 1\n"),
        (("--items", "1025"), "error: --items 1025: give at most 1024\n"),
        (("--dimension", "4d"), "--dimension"),
    ],
)
def test_wrong_options_are_one_line(options, said, tmp_path):
    code, _, errors = warmed(tmp_path, *options)
    assert code == 2
    assert said in errors
    assert errors.count("\n") == 1
