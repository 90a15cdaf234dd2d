"""A run survives kill -9 at any moment and ends with the bits of one that was never killed."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import TINY

from jaxpack.errors import UserError
from jaxpack.io.runs import (
    Checkpoints,
    RunConfig,
    Snapshot,
    append_line,
    create_run,
    first_snapshot,
    lock_run,
    read_lines,
    read_policy,
    read_run,
    rewind_lines,
)
from jaxpack.io.weights import save_policy
from jaxpack.learning.presets import preset
from jaxpack.training import DivergedError, chunk_length, train_run, validate_policy

CONFIG = RunConfig(preset="test", seed=4, train=TINY, chunk=4, checkpoint_every=8)
TRAIN = (
    "import sys; from pathlib import Path\n"
    "from jaxpack.io.runs import read_run\n"
    "from jaxpack.training import train_run\n"
    "run = Path(sys.argv[1])\n"
    "for record in train_run(run, read_run(run)): print(record['update'], flush=True)\n"
)


def train_until(run: Path, update: int):
    """A new run, stopped once that many updates are done."""
    create_run(run, CONFIG)
    steps = train_run(run, CONFIG)
    while next(steps)["update"] < update:
        pass
    steps.close()


def final_leaves(run: Path):
    checkpoints = Checkpoints(run)
    snapshot = checkpoints.restore(CONFIG)
    checkpoints.close()
    assert snapshot is not None
    assert int(snapshot.state.update) == TINY.updates
    key = jax.random.key_data(snapshot.state.key)
    return [np.asarray(leaf) for leaf in jax.tree.leaves((*snapshot.state[:2], key, snapshot.best))]


def without_times(run: Path):
    timed = ("seconds", "updates_per_second")
    return [{k: v for k, v in r.items() if k not in timed} for r in read_lines(run)]


def assert_same_run(one, other):
    for ours, theirs in zip(final_leaves(one), final_leaves(other), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert without_times(one) == without_times(other), "a line was lost or repeated"


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    run = tmp_path_factory.mktemp("runs") / "whole"
    create_run(run, CONFIG)
    list(train_run(run, CONFIG))
    return run


def train_in_process(run: Path) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", TRAIN, str(run)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


@pytest.mark.long
def test_killed_and_resumed_is_bit_identical(uninterrupted, tmp_path):
    run = tmp_path / "killed"
    create_run(run, CONFIG)
    # Killed before the first checkpoint, then between two.
    for last_line in ("4", "28"):
        process = train_in_process(run)
        for line in process.stdout:
            assert line.strip().isdigit(), line
            if line.strip() == last_line:
                os.kill(process.pid, signal.SIGKILL)
                break
        process.wait()
        process.stdout.close()
        assert process.returncode == -signal.SIGKILL
    process = train_in_process(run)
    output, _ = process.communicate(timeout=300)
    assert process.returncode == 0, output
    assert int(output.split()[0]) > 24, "resumed from the start and not from a checkpoint"
    assert_same_run(run, uninterrupted)


@pytest.mark.long
def test_asked_to_stop_it_checkpoints_and_ends_with_the_same_bits(uninterrupted, tmp_path):
    run = tmp_path / "stopped"
    create_run(run, CONFIG)
    answers = iter([False, False, True])
    records = list(train_run(run, CONFIG, lambda: next(answers)))
    assert records[-1]["update"] == 12, "between the validations at 8 and 16"
    assert (run / "checkpoints" / "12").is_dir()
    assert next(train_run(run, CONFIG))["update"] == 16
    list(train_run(run, CONFIG))
    assert_same_run(run, uninterrupted)


@pytest.mark.long
def test_a_run_with_a_mean_of_its_weights_goes_on_with_the_same_bits(tmp_path):
    recipe = replace(TINY, average=0.9, epochs=1)
    config = replace(CONFIG, train=recipe)
    for name, answers in (("whole", ()), ("stopped", (False, True))):
        create_run(tmp_path / name, config)
        stop = iter(answers)
        records = list(train_run(tmp_path / name, config, lambda stop=stop: next(stop, False)))
    assert records[-1]["update"] == 8
    list(train_run(tmp_path / "stopped", read_run(tmp_path / "stopped")))
    snapshots = []
    for name in ("whole", "stopped"):
        checkpoints = Checkpoints(tmp_path / name)
        snapshots.append(checkpoints.restore(config))
        checkpoints.close()
    whole, stopped = (jax.tree.leaves((s.state[:2], s.best)) for s in snapshots)
    for ours, theirs in zip(whole, stopped, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert without_times(tmp_path / "whole") == without_times(tmp_path / "stopped")
    # What was validated, and is kept, is the mean.
    state, best = snapshots[0]
    again = validate_policy(recipe, state.kept, jax.random.key(CONFIG.seed))
    last = [line["validation"] for line in read_lines(tmp_path / "whole") if "validation" in line]
    assert again == last[-1]
    assert int(best.update) in (8, 16, 20)
    kept = validate_policy(recipe, best.params, jax.random.key(CONFIG.seed))
    assert kept == min(last, key=lambda figures: figures["cost"])


def test_a_full_disk_is_one_error_and_loses_nothing(uninterrupted, tmp_path):
    run = tmp_path / "full"
    create_run(run, CONFIG)
    steps = train_run(run, CONFIG)
    while next(steps)["update"] < 12:
        pass
    (run / "metrics.jsonl").rename(run / "kept")
    (run / "metrics.jsonl").symlink_to("/dev/full")
    with pytest.raises(UserError, match=r"metrics.jsonl: .*\(No space left on device\).*--resume"):
        next(steps)
    (run / "kept").rename(run / "metrics.jsonl")
    list(train_run(run, CONFIG))
    assert_same_run(run, uninterrupted)


def test_a_run_can_start_from_a_policy(uninterrupted, tmp_path):
    given, run = tmp_path / "given.npz", tmp_path / "run"
    policy = read_policy(uninterrupted)
    save_policy(given, policy, {})
    config = replace(CONFIG, start_from=str(given), train=replace(TINY, learning_rate=1e-12))
    create_run(run, config)
    *_, last = (record for record, _ in zip(train_run(run, config), range(3), strict=False))
    expected = validate_policy(TINY, policy.params, jax.random.key(CONFIG.seed))
    assert last["validation"] == pytest.approx(expected, rel=1e-5)
    given.unlink()
    assert next(train_run(run, read_run(run)))["update"] == 12, "what it began with is not needed"


def test_a_run_is_trained_by_one_process_at_a_time(tmp_path):
    run = tmp_path / "run"
    create_run(run, CONFIG)
    refused = pytest.raises(UserError, match="another process is training")
    with lock_run(run), refused, lock_run(run):
        pass
    with lock_run(run):
        pass
    refused = pytest.raises(UserError, match="No such file or directory")
    with refused, lock_run(tmp_path / "none"):
        pass


def test_what_cannot_be_written_is_one_error(tmp_path):
    run = tmp_path / "run"
    create_run(run, CONFIG)
    (run / "checkpoints").write_text("a file in the way")
    with pytest.raises(UserError, match=r"checkpoints.*: cannot be written .*--resume"):
        Checkpoints(run).save(first_snapshot(CONFIG))
    (run / "metrics.jsonl").mkdir()
    with pytest.raises(UserError, match=r"metrics.jsonl: cannot be written \(Is a directory\)"):
        append_line(run, {"update": 4})
    with pytest.raises(UserError, match="cannot be made"):
        create_run(run / "checkpoints" / "inside", CONFIG)


def test_reading_a_policy_leaves_the_trainers_files_alone(tmp_path):
    run = tmp_path / "run"
    train_until(run, 12)
    half = run / "checkpoints" / "16.orbax-checkpoint-tmp"
    half.mkdir()
    read_policy(run)
    assert half.is_dir(), "a checkpoint that another process is writing was deleted"


def test_a_finished_run_has_nothing_left_to_do(uninterrupted):
    before = without_times(uninterrupted)
    assert list(train_run(uninterrupted, CONFIG)) == []
    assert without_times(uninterrupted) == before
    updates = [r["update"] for r in before if "validation" not in r]
    assert updates == list(range(4, TINY.updates + 1, 4))
    validated = [r["update"] for r in before if "validation" in r]
    assert validated == [8, 16, 24, 32, 40, 48, 56, 60]


def test_the_policy_of_a_run_is_its_best_on_the_validation_set(uninterrupted):
    lines = [r for r in read_lines(uninterrupted) if "validation" in r]
    lowest = min(lines, key=lambda r: r["validation"]["cost"])
    checkpoints = Checkpoints(uninterrupted)
    best = checkpoints.restore(CONFIG).best
    checkpoints.close()
    assert int(best.update) == lowest["update"]
    again = validate_policy(TINY, read_policy(uninterrupted).params, jax.random.key(CONFIG.seed))
    assert again == lowest["validation"]


def test_a_torn_checkpoint_folder_is_passed_over(uninterrupted, tmp_path):
    run = tmp_path / "torn"
    train_until(run, 24)
    # What orbax leaves when it is killed while writing: a folder with its temporary suffix.
    half = run / "checkpoints" / "28.orbax-checkpoint-tmp-0"
    half.mkdir()
    (half / "garbage").write_text("half")
    list(train_run(run, CONFIG))
    for ours, theirs in zip(final_leaves(run), final_leaves(uninterrupted), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_lines_after_the_checkpoint_and_torn_lines_are_dropped(tmp_path):
    create_run(tmp_path / "run", CONFIG)
    for update in (4, 8, 12):
        append_line(tmp_path / "run", {"update": update})
    with open(tmp_path / "run" / "metrics.jsonl", "a") as file:
        file.write('{"update": 1')
    rewind_lines(tmp_path / "run", 8)
    assert read_lines(tmp_path / "run") == [{"update": 4}, {"update": 8}]


def test_nan_stops_the_run_and_keeps_the_last_checkpoint(tmp_path):
    run = tmp_path / "run"
    train_until(run, 12)
    # The weights of the newest checkpoint, made so large that the next loss overflows.
    checkpoints = Checkpoints(run)
    state, best = checkpoints.restore(CONFIG)
    huge = jax.tree.map(lambda leaf: leaf * 1e30, state.params)
    checkpoints.save(Snapshot(state._replace(params=huge, update=state.update + 4), best))
    checkpoints.close()
    with pytest.raises(DivergedError, match=r"between updates 12 and 16.*checkpoint of update 12"):
        list(train_run(run, CONFIG))
    assert (run / "checkpoints" / "12").is_dir()
    assert read_lines(run)[-1]["update"] <= 12
    assert all(jnp.isfinite(leaf).all() for leaf in jax.tree.leaves(read_policy(run).params))


def test_config_survives_the_round_trip(tmp_path):
    for name in ("paper-2d", "paper-3d"):
        config = RunConfig(preset=name, seed=9, train=preset(name))
        create_run(tmp_path / name, config)
        assert read_run(tmp_path / name) == config


def test_chunks_divide_an_epoch():
    assert chunk_length(CONFIG) == 4
    paper = RunConfig(preset="paper-2d", seed=0, train=preset("paper-2d"), chunk=70)
    assert chunk_length(paper) == 50  # the largest divisor of 2,000 up to 70


def test_bad_run_folders_are_refused(tmp_path, uninterrupted):
    with pytest.raises(UserError, match="no such run folder"):
        read_run(tmp_path / "nowhere")
    (tmp_path / "foreign").mkdir()
    with pytest.raises(UserError, match=r"has no config\.json"):
        read_run(tmp_path / "foreign")
    with pytest.raises(UserError, match="exists already"):
        create_run(tmp_path / "foreign", CONFIG)
    config = tmp_path / "foreign" / "config.json"
    for text, message in (
        ("{", r"config\.json: row 1, column 2: not JSON"),
        ("[1]", "expected a table of options"),
        ('{"preset": "x"}', "option 'seed' is missing"),
        ('{"colour": "red"}', "option"),
    ):
        config.write_text(text)
        with pytest.raises(UserError, match=message):
            read_run(tmp_path / "foreign")
    good = json.loads((uninterrupted / "config.json").read_text())
    good["train"]["batch"] = "fifty"
    config.write_text(json.dumps(good))
    with pytest.raises(UserError, match=r"config\.train\.batch|batch: 'fifty' is not of type int"):
        read_run(tmp_path / "foreign")


def test_damaged_checkpoints_are_refused(tmp_path):
    run = tmp_path / "run"
    create_run(run, CONFIG)
    with pytest.raises(UserError, match="no checkpoint yet"):
        read_policy(run)
    checkpoints = Checkpoints(run)
    checkpoints.save(first_snapshot(CONFIG))
    checkpoints.close()
    assert read_policy(run).config == TINY
    for file in (run / "checkpoints" / "0").rglob("*"):
        if file.is_file():
            file.write_bytes(b"not a checkpoint")
    with pytest.raises(
        UserError, match=r"checkpoints/0: damaged checkpoint .*; delete that folder"
    ):
        read_policy(run)


def test_a_checkpoint_of_another_shape_is_refused(tmp_path):
    run = tmp_path / "run"
    create_run(run, CONFIG)
    other = replace(CONFIG, train=replace(TINY, policy=replace(TINY.policy, hidden=16)))
    checkpoints = Checkpoints(run)
    checkpoints.save(first_snapshot(other))
    checkpoints.close()
    with pytest.raises(UserError, match="checkpoint"):
        read_policy(run)


def test_time_is_recorded(uninterrupted):
    records = [r for r in read_lines(uninterrupted) if "validation" not in r]
    assert all(r["updates_per_second"] > 0 for r in records)
    assert records[-1]["seconds"] <= time.perf_counter()
