"""A sweep has the same figures however it is split and wherever it was interrupted."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from os import environ, pathsep

import numpy as np
import pytest

from jaxpack import Cell, Comparison, MethodOptions, UserError, compare, make_method, preset
from jaxpack.io.sweeps import open_sweep, tally

PAPER = preset("paper-2d")
CELL = Cell(PAPER.problem.bin, PAPER.distribution)
WHOLE = Comparison(PAPER.problem, instances=50, seeds=2, batch=20)


def rows(comparison, sweep=None):
    method = make_method("random", PAPER.problem, MethodOptions())
    made = compare(comparison, "random", method, [CELL], sweep)
    return [replace(row, ms_per_instance=0, batch=0) for row in made]


@pytest.mark.long
def test_chunks_and_interruptions_do_not_change_a_bit(tmp_path):
    whole = rows(WHOLE)
    assert rows(replace(WHOLE, chunk=7, batch=3)) == whole
    file = tmp_path / "sweep.jsonl"
    with open_sweep(file, {"seed": 0}) as sweep:
        rows(replace(WHOLE, chunk=30), sweep)
    lines = file.read_text().splitlines(keepends=True)
    assert [json.loads(line)["count"] for line in lines[1:]] == [30, 30, 30, 10]
    file.write_text("".join(lines[:3]) + lines[3][:40])  # killed in the middle of a line
    with open_sweep(file, {"seed": 0}) as sweep:
        assert rows(replace(WHOLE, chunk=25), sweep) == whole
    counts = [json.loads(line)["count"] for line in file.read_text().splitlines()[1:]]
    assert counts == [30, 30, 25, 15]


def test_means_and_standard_errors_are_those_of_the_values():
    values = np.random.default_rng(0).random(1000)
    parts = [tally({"bins": part}, 1.0) for part in np.split(values, [1, 300])]
    total = parts[2].plus(parts[0]).plus(parts[1])
    assert (total.count, total.seconds) == (1000, 3.0)
    assert total.mean("bins") == pytest.approx(values.mean(), rel=1e-11)
    assert total.standard_error("bins") == pytest.approx(values.std(ddof=1) / 1000**0.5, rel=1e-9)
    assert parts[0].standard_error("bins") == 0


def evaluate(folder, *options):
    command = [sys.executable, "-m", "jaxpack.evaluate", "paper-2d", "--methods", "random"]
    paths = environ | {"PYTHONPATH": pathsep.join(sys.path)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([*command, *options], cwd=folder, env=paths, **pipes)


@pytest.mark.slow
def test_a_killed_sweep_goes_on_where_it_was(tmp_path):
    many, file = ["--instances", "4000", "--json", "rows.json"], tmp_path / "s"
    process = evaluate(tmp_path, *many, "--sweep", "s", "--chunk", "100")
    while not file.exists() or file.read_text().count("\n") < 4:
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    before = file.read_text()
    found = []
    for options in (["--sweep", "s", "--chunk", "900"], []):
        process = evaluate(tmp_path, *many, *options)
        _, errors = process.communicate(timeout=200)
        assert process.returncode == 0, errors
        (row,) = json.loads((tmp_path / "rows.json").read_text())
        del row["ms_per_instance"]
        found.append(row)
    assert file.read_text().startswith(before.rpartition("\n")[0])
    assert found[0] == found[1]
    other = evaluate(tmp_path, *many, "--sweep", "s", "--seed", "1")
    _, errors = other.communicate(timeout=200)
    assert other.returncode == 2
    assert errors == (
        "error: --sweep s: was begun with seed 0, not 1; give the same options or name another "
        "file\n"
    )


def test_a_file_that_cannot_be_used_is_one_error(tmp_path):
    (tmp_path / "foreign").write_text("something else\n")
    for path, message in (
        (tmp_path / "foreign", "not a sweep's file"),
        (tmp_path, "Is a directory"),
        (tmp_path / "none" / "s", "No such file or directory"),
    ):
        with pytest.raises(UserError, match=message), open_sweep(path, {}):
            pass
    used = pytest.raises(UserError, match="another process is at it")
    with open_sweep(tmp_path / "s", {}), used, open_sweep(tmp_path / "s", {}):
        pass


def test_what_is_no_sweep_is_refused_by_name_and_left_as_it_is(tmp_path):
    good = {"method": "x", "cell": 0, "count": 2, "seconds": 0.5, "sums": {"bins": [3, 4]}}
    lines = [
        good | wrong
        for wrong in (
            {"count": "2"}, {"count": 0}, {"count": 1.5}, {"count": True}, {"cell": "a"},
            {"cell": []}, {"seconds": None}, {"seconds": float("nan")}, {"sums": 3},
            {"sums": {"bins": [1]}}, {"sums": {"bins": "ab"}}, {"sums": {"bins": [1.0, 2]}},
        )
    ]  # fmt: skip
    texts = [b'{"seed": 0}\n' + json.dumps(line).encode() + b"\n" for line in lines]
    texts += [b"a note without an end", b"\xff\xfe\n", b"[" * 100_000 + b"\n", b'{"seed": 1}\nx']
    file = tmp_path / "s"
    for text in texts:
        file.write_bytes(text)
        refused = pytest.raises(UserError, match=f"--sweep {file}: ")
        with refused as caught, open_sweep(file, {"seed": 0}):
            pass
        assert "\n" not in str(caught.value)
        assert file.read_bytes() == text
    file.write_text('{"see')  # killed in its first line
    with open_sweep(file, {"seed": 0}) as sweep:
        sweep.recall(good)
    assert file.read_text() == '{"seed": 0}\n'
