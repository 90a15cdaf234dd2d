"""Whatever happened to a file of weights or of a run: it is read, or one line names it."""

import json
import random
import shutil
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import jax
import numpy as np
import pytest
from cases import TINY

import jaxpack
from jaxpack import load_policy, save_policy
from jaxpack.errors import UserError
from jaxpack.io.runs import (
    RunConfig,
    append_line,
    create_run,
    read_lines,
    read_policy,
    read_run,
    rewind_lines,
)
from jaxpack.training import chunk_length, train_run

WEIGHTS = Path(jaxpack.__file__).parent / "weights"
CONFIG = RunConfig(preset="test", seed=4, train=TINY, chunk=4, checkpoint_every=8)
DEEP = b"[" * 100_000


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    run = tmp_path_factory.mktemp("runs") / "run"
    create_run(run, CONFIG)
    for record in train_run(run, CONFIG):
        if record["update"] == 12:
            break
    return run


def flipped(data, rng):
    """The same bytes but for one bit."""
    at, bit = rng.randrange(len(data)), 1 << rng.randrange(8)
    return data[:at] + bytes([data[at] ^ bit]) + data[at + 1 :]


def damaged(data, rng):
    """One of the ways in which a file goes wrong."""
    at, end = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    return rng.choice(
        (
            flipped(data, rng),
            data[:at],
            data[:at] + data[end:],
            data[:at] + data[at:end] * 2 + data[end:],
            data[:at] + rng.randbytes(5) + data[at:],
            data[:at] + DEEP + data[at:],
            data[:at] + b"9" * 5_000 + data[at:],
            data[:at] + b"NaN" + data[at:],
        )
    )


def told(read, *names):
    """What `read` gives; None where it is one line that has one of the names in it."""
    try:
        return read()
    except UserError as error:
        line = str(error)
        assert "\n" not in line
        assert len(line) < 1_000
        assert any(str(name) in line for name in names), line
        return None


@pytest.mark.parametrize(
    "name", [pytest.param("pointer-2d", marks=pytest.mark.slow), "bin-aware-3d"]
)
def test_a_bit_flip_in_weights_is_told_or_harmless(name, tmp_path):
    rng, path = random.Random(name), tmp_path / "mine.npz"
    archive, record = ((WEIGHTS / f"{name}.{kind}").read_bytes() for kind in ("npz", "json"))
    shipped = load_policy(name)
    harmless = 0
    # All over the file, and where the headers and the directory of the archive are.
    places = [rng.randrange(len(archive)) for _ in range(300)]
    places += [*range(0, 200, 2), *range(len(archive) - 600, len(archive), 4)]
    path.with_suffix(".json").write_bytes(record)
    for place in places:
        bit = 1 << rng.randrange(8)
        path.write_bytes(archive[:place] + bytes([archive[place] ^ bit]) + archive[place + 1 :])
        policy = told(lambda: load_policy(str(path)), path)
        if policy is not None:
            harmless += 1
            assert policy.config == shipped.config
            jax.tree.map(np.testing.assert_array_equal, policy.params, shipped.params)
    assert harmless < len(places) / 2
    path.write_bytes(archive)
    for _ in range(200):
        path.with_suffix(".json").write_bytes(damaged(record, rng))
        told(lambda: load_policy(str(path)), path, path.with_suffix(".json"))


@pytest.mark.parametrize(
    "wrong",
    [np.float32(np.nan), np.int32(0), np.complex64(0), np.str_("abc")],
    ids=str,
)
def test_weights_of_another_type_or_that_are_no_numbers_are_refused(tmp_path, wrong):
    policy = load_policy("pointer-2d")
    leaves, tree = jax.tree.flatten(policy.params)
    params = jax.tree.unflatten(tree, [np.full(leaves[0].shape, wrong), *leaves[1:]])
    save_policy(tmp_path / "it.npz", replace(policy, params=params), {})
    with pytest.raises(UserError, match=r"it.npz: .*retrain"):
        load_policy(str(tmp_path / "it.npz"))


def damage_every_file(run):
    """Each file of a run in turn, in several ways: it is read, or one line names it."""
    rng = random.Random(0)
    rewound = read_lines(run)
    parts = [file for file in sorted(run.rglob("*")) if file.is_file() and file.stat().st_size]
    assert {"config.json", "metrics.jsonl", "_METADATA"} <= {file.name for file in parts}
    for file in parts:
        whole = file.read_bytes()
        for turn in range(40 if file.parent == run else 4):
            file.write_bytes(flipped(whole, rng) if turn % 2 else damaged(whole, rng))
            if config := told(lambda: read_run(run), run):
                assert chunk_length(config) >= 1
            told(lambda: read_policy(run), run)
            told(lambda: rewind_lines(run, 12), run / "metrics.jsonl")
        file.write_bytes(whole)
    assert read_lines(run) == rewound


@pytest.mark.slow
def test_every_file_of_a_run_may_be_damaged(trained, tmp_path):
    shutil.copytree(trained, tmp_path / "run")
    # In a process of its own: a restore that fails leaves coroutines of orbax that complain when
    # they are collected, whenever that is. Of the tests, a later one would fail for it.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        process.submit(damage_every_file, tmp_path / "run").result()


@pytest.mark.long
def test_absurd_options_of_a_run_are_refused_by_name(trained, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(trained, run)
    file = run / "config.json"
    good = json.loads(file.read_text())
    absurd = (0, -1, 10**30, 1.5, float("nan"), float("inf"), True, None, "4", [4], {}, 2**31)

    def options(table, path=()):
        for name, value in table.items():
            yield (*path, name)
            if isinstance(value, dict):
                yield from options(value, (*path, name))

    refused = set()
    for path in options(good):
        for value in absurd:
            config = json.loads(json.dumps(good))
            table = config
            for name in path[:-1]:
                table = table[name]
            table[path[-1]] = value
            file.write_text(json.dumps(config))
            if told(lambda: read_run(run), file) is None:
                refused.add((path[-1], str(value)))
            else:
                told(lambda: read_policy(run), run)
    assert {("chunk", "0"), ("checkpoint_every", "-1"), ("seed", str(10**30)), ("hidden", "0"),
            ("learning_rate", "nan"), ("items", str(10**30)), ("epochs", str(2**31)),
            ("input_scale", "inf"), ("bin", "[4]"), ("others", "0"), ("critic", "-1"),
            ("turns", "4"), ("support", "10" + "0" * 29)} <= refused  # fmt: skip


@pytest.mark.parametrize(
    "line",
    [b"\xff\xfe", b"something else", b"3", b"[]", b'{"loss": 1}', b'{"update": "4"}', DEEP, b""],
)
def test_a_foreign_line_of_a_log_is_refused_by_row(line, tmp_path):
    create_run(tmp_path / "run", CONFIG)
    append_line(tmp_path / "run", {"update": 4})
    log = tmp_path / "run" / "metrics.jsonl"
    before = log.read_bytes()
    log.write_bytes(before + line + b"\n" + before)
    for read in (read_lines, lambda run: rewind_lines(run, 8)):
        with pytest.raises(UserError, match=r"metrics\.jsonl: row 2: .*; delete that line"):
            read(tmp_path / "run")
    assert log.read_bytes() == before + line + b"\n" + before, "a refused file was changed"
    log.write_bytes(before + line)  # at the end a kill may have cut it short
    assert read_lines(tmp_path / "run") == [{"update": 4}]


def test_reading_executes_nothing(trained, tmp_path):
    class Trap:
        def __reduce__(self):
            return (tmp_path.joinpath("sprung").write_text, ("x",))

    path = tmp_path / "mine.npz"
    path.with_suffix(".json").write_bytes((WEIGHTS / "pointer-2d.json").read_bytes())
    np.savez(path, encoder=np.asarray([Trap()], dtype=object))
    with pytest.raises(UserError, match="not a policy, or damaged"):
        load_policy(str(path))
    run = tmp_path / "run"
    shutil.copytree(trained, run)
    for file in run.rglob("*"):
        if file.is_file():
            np.save(tmp_path / "trap.npy", np.asarray([Trap()], dtype=object))
            shutil.copy(tmp_path / "trap.npy", file)
    for read in (read_run, read_policy, read_lines):
        with suppress(UserError):
            read(run)
    assert not tmp_path.joinpath("sprung").exists()
