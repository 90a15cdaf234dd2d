"""A sweep: every member is the run alone, whatever it is trained with and however it is stopped."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import TINY
from scipy import stats

from jaxpack import cli, train
from jaxpack.errors import UserError
from jaxpack.io.members import create_sweep, lock_sweep, read_sweep
from jaxpack.io.runs import Checkpoints, RunConfig, create_run, lock_run, read_lines, read_policy
from jaxpack.learning.bin_aware import BinAwareConfig
from jaxpack.learning.members import each_member, init_members, train_members
from jaxpack.learning.trainer import init_state, make_train, train_chunk
from jaxpack.sweep_report import estimate, setting_rows
from jaxpack.sweeping import group_members, newest_snapshot, train_sweep
from jaxpack.train_options import TrainOptions, plan_runs
from jaxpack.training import DivergedError, train_run
from jaxpack.xla.devices import data_mesh
from jaxpack.xla.target import Target, traced_for

# Two epochs of three chunks; checkpoints in the middle of both and at the end.
SHORT = replace(TINY, train_instances=96, epochs=2)
CONFIG = RunConfig(preset="test", seed=0, train=SHORT, chunk=4, checkpoint_every=8)
AWARE = replace(
    SHORT, policy=BinAwareConfig(hidden=8), learner="leave-one-out", samples=2, objective="bins"
)


def members_of(path, configs):
    """A new sweep: every config a setting of its own, but for the seed."""
    numbers = ("learning_rate", "entropy", "clip", "alpha", "batch")
    settings = [", ".join(str(getattr(c.train, name)) for name in numbers) for c in configs]
    folders = [f"member-{number}" for number in range(len(configs))]
    return create_sweep(path, list(zip(folders, settings, configs, strict=True)))


def grid(train, seeds=(4, 5), **lists):
    """A config for every seed and combination of numbers."""
    chosen = [dict(zip(lists, values, strict=True)) for values in product(*lists.values())]
    return [
        replace(CONFIG, seed=seed, train=replace(train, **numbers))
        for numbers in chosen
        for seed in seeds
    ]


def train_all(members, records=None, devices=1):
    """Trains a sweep; left after so many batches of records, as by a kill."""
    steps = train_sweep(group_members(members), devices=devices)
    for number, _ in enumerate(steps, 1):
        if number == records:
            steps.close()


def end_of(run, config):
    """(every array of the newest checkpoint, what was logged but for times)."""
    checkpoints = Checkpoints(run, read_only=True)
    state, best = checkpoints.restore(config)
    checkpoints.close()
    arrays = jax.tree.leaves((*state[:2], jax.random.key_data(state.key), *state[3:], best))
    timed = ("seconds", "updates_per_second")
    lines = [{k: v for k, v in r.items() if k not in timed} for r in read_lines(run)]
    return [np.asarray(array) for array in arrays], lines


def assert_same(one, other):
    for ours, theirs in zip(one[0], other[0], strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert one[1] == other[1]


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    """Two seeds with two rates, trained without a stop."""
    folder = tmp_path_factory.mktemp("sweep") / "whole"
    members = members_of(folder, grid(SHORT, learning_rate=(5e-4, 2e-3)))
    train_all(members)
    return members


def trained_alone(member, path):
    """The end of a run with the member's config, which no sweep knows."""
    create_run(path, member.config)
    list(train_run(path, member.config))
    return end_of(path, member.config)


@pytest.mark.parametrize("number", [pytest.param(0, marks=pytest.mark.long), 3])
def test_a_member_is_to_the_bit_the_run_alone(sweep, number, tmp_path):
    member = sweep[number]
    alone = trained_alone(member, tmp_path / "alone")
    assert_same(end_of(member.run, member.config), alone)
    assert len({end_of(m.run, m.config)[0][0].tobytes() for m in sweep}) == len(sweep)


@pytest.mark.long
def test_so_is_one_with_other_weights_in_its_loss(tmp_path):
    listed = grid(AWARE, (4,), entropy=(0.0, 0.01), clip=(0.0, 0.1))
    members = members_of(tmp_path / "sweep", [listed[0], listed[-1]])
    (group,) = group_members(members)
    assert set(group.numbers) == {"entropy", "clip"}
    train_all(members)
    alone = trained_alone(members[1], tmp_path / "alone")
    assert_same(end_of(members[1].run, members[1].config), alone)


@pytest.mark.slow
def test_weights_of_the_cost_are_traced_too(tmp_path):
    """XLA may round what it multiplies by a constant otherwise: to a tolerance."""
    listed = grid(AWARE, (4,), alpha=(0.3, 1.0), beta=(0.0, 0.2))
    members = members_of(tmp_path / "sweep", [listed[0], listed[-1]])
    (group,) = group_members(members)
    assert set(group.numbers) == {"alpha", "beta"}
    train_all(members)
    alone = trained_alone(members[0], tmp_path / "alone")
    for ours, theirs in zip(end_of(members[0].run, listed[0])[0], alone[0], strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=1e-4)


@pytest.mark.slow
def test_side_by_side_members_learn_the_same():
    config = replace(TINY, entropy=0.01)
    seeds, rates = jnp.arange(3), jnp.asarray([5e-4, 2e-3, 1e-2])
    numbers = {"entropy": jnp.asarray([0.0, 0.01, 0.02])}
    start = init_members(config, seeds, rates, None)
    copied = jax.tree.map(jnp.copy, start)
    states, _ = train_members(config, copied, numbers, 5, data_mesh())
    with traced_for(Target(cpu=False)):
        again = replace(config, valid_instances=9)  # another program
        beside, _ = train_members(again, start, numbers, 5, data_mesh())
    for ours, theirs in zip(*map(jax.tree.leaves, (states.params, beside.params)), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=2e-5)
    alone = init_state(replace(config, entropy=0.02), jax.random.key(2), 1e-2)
    alone, _ = train_chunk(replace(config, entropy=0.02), alone, 5)
    assert int(beside.update[2]) == 5
    for ours, theirs in zip(*map(jax.tree.leaves, (beside.params, alone.params)), strict=True):
        np.testing.assert_allclose(ours[2], theirs, rtol=1e-4, atol=2e-5)


@pytest.mark.long
def test_the_pure_function_takes_numbers():
    config = replace(TINY, epochs=1, train_instances=16)
    run = jax.jit(make_train(replace(config, entropy=0.5)))
    expected, _ = run(jax.random.key(3))
    found, _ = jax.jit(make_train(config))(jax.random.key(3), numbers={"entropy": jnp.float32(0.5)})
    for ours, theirs in zip(*map(jax.tree.leaves, (found.params, expected.params)), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=1e-5)


@pytest.mark.long
@pytest.mark.parametrize("records", [1, 5])
def test_stopped_and_resumed_is_bit_identical(sweep, records, tmp_path):
    members = members_of(tmp_path / "again", [member.config for member in sweep])
    train_all(members, records)
    assert len(read_lines(members[0].run)) == records
    train_all(read_sweep(tmp_path / "again"))
    for ours, theirs in zip(members, sweep, strict=True):
        assert_same(end_of(ours.run, ours.config), end_of(theirs.run, theirs.config))


@pytest.mark.long
def test_members_that_are_not_at_one_update_end_alike(sweep, tmp_path):
    members = members_of(tmp_path / "again", [member.config for member in sweep])
    train_all(members, 4)
    # One is trained by itself, as any run, and left in between.
    steps = train_run(members[1].run, members[1].config)
    while next(steps)["update"] < 20:
        pass
    steps.close()
    groups = group_members(members)
    assert sorted((group.update, len(group.members)) for group in groups) == [(8, 3), (16, 1)]
    train_all(members)
    for ours, theirs in zip(members, sweep, strict=True):
        assert_same(end_of(ours.run, ours.config), end_of(theirs.run, theirs.config))


def test_a_sweep_that_is_done_has_nothing_left_to_do(sweep):
    before = [read_lines(member.run) for member in sweep]
    train_all(sweep)
    assert before == [read_lines(member.run) for member in sweep]


@pytest.mark.long
def test_asked_to_stop_all_are_checkpointed(tmp_path):
    members = members_of(tmp_path / "sweep", grid(SHORT, batch=(8, 16)))
    groups = group_members(members)
    assert [len(group.members) for group in groups] == [2, 2], "a program for each shape"
    assert len(list(train_sweep(groups, stop=lambda: True))) == 1
    updates = [(run := newest_snapshot(member)) and int(run.state.update) for member in members]
    assert updates == [4, 4, None, None]


@pytest.mark.long
def test_one_that_diverges_stops_no_other(sweep, tmp_path):
    configs = grid(SHORT, learning_rate=(5e-4, 1e30))
    members = members_of(tmp_path / "sweep", configs)
    train_all(members)
    for ours, theirs in zip(members[:2], sweep[:2], strict=True):
        assert_same(end_of(ours.run, ours.config), end_of(theirs.run, theirs.config))
    assert all(newest_snapshot(member) is None for member in members[2:])
    well, lost = setting_rows(members)
    assert (well.runs, well.diverged, lost.runs, lost.diverged) == (2, 0, 2, 2)
    assert not lost.figures
    alone = members_of(tmp_path / "alone", configs[2:])
    with pytest.raises(DivergedError, match=r"every run diverged: .* lower --learning-rate"):
        train_all(alone)


@pytest.mark.slow
def test_members_are_shared_by_devices(tmp_path):
    code = (
        "import sys; from pathlib import Path\n"
        "from jaxpack.io.members import read_sweep\n"
        "from jaxpack.sweeping import group_members, train_sweep\n"
        "list(train_sweep(group_members(read_sweep(Path(sys.argv[1]))), devices=2))\n"
    )
    configs = grid(SHORT, seeds=(4, 5, 6))  # three on two devices
    members, others = (members_of(tmp_path / name, configs) for name in ("one", "two"))
    train_all(members)
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=2"
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "two")],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "XLA_FLAGS": flags},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    for ours, theirs in zip(members, others, strict=True):
        assert_same(end_of(ours.run, ours.config), end_of(theirs.run, theirs.config))


def test_a_sweep_is_trained_by_one_process_at_a_time(sweep):
    folder = sweep[0].run.parent
    refused = pytest.raises(UserError, match="another process is training")
    with lock_sweep(folder, sweep), refused, lock_run(sweep[1].run):
        pass
    refused = pytest.raises(UserError, match="another process is training")
    with lock_run(sweep[1].run), refused, lock_sweep(folder, sweep):
        pass


def test_the_interval_is_students():
    values = np.asarray([4.13, 4.12, 4.15, 4.11, 4.14])
    found = estimate(values)
    low, high = stats.t.interval(0.95, 4, values.mean(), stats.sem(values))
    np.testing.assert_allclose([found.mean, found.low, found.high], [values.mean(), low, high])
    assert str(estimate(values[:1])) == "4.130"


def test_a_setting_is_measured_by_what_its_members_pack(sweep):
    rows = setting_rows(sweep)
    assert [row.runs for row in rows] == [2, 2]
    policy = read_policy(sweep[0].run)
    assert policy.config == sweep[0].config.train
    for row in rows:
        one = row.figures["bins"]
        assert one.low <= one.mean <= one.high
        assert 1 < one.mean < 8


def test_every_combination_is_planned_with_every_seed():
    options = TrainOptions(seed=3, seeds=2, learning_rate="1e-3,3e-3", items="10,20", batch="8")
    planned = plan_runs(options)
    assert [run.folder for run in planned[:2]] == [
        "seed-3-items-10-learning-rate-0.001",
        "seed-4-items-10-learning-rate-0.001",
    ]
    assert planned[0].setting == planned[1].setting == "items 10, learning-rate 0.001"
    found = [
        (run.config.train.distribution.items, run.config.train.learning_rate)
        for run in planned[::2]
    ]
    assert found == [(10, 1e-3), (10, 3e-3), (20, 1e-3), (20, 3e-3)]
    assert {run.config.train.batch for run in planned} == {8}
    assert len({run.folder for run in planned}) == 8
    (single,) = plan_runs(TrainOptions())
    assert (single.folder, single.setting) == ("seed-0", "")
    for wrong, message in (
        ({"alpha": "1,x"}, "--alpha '1,x': give numbers separated by commas, such as 1e-3,3e-3"),
        ({"clip": "inf"}, "--clip 'inf': give numbers"),
        ({"clip": "1,1.0"}, "--clip: 1.0 is there twice"),
        ({"seeds": 0}, "seeds 0: give at least 1"),
        ({"epochs": "1,0"}, "epochs 0: give at least 1"),
    ):
        with pytest.raises(UserError, match=message):
            plan_runs(TrainOptions(**wrong))


@pytest.mark.long
def test_the_command_trains_resumes_and_reports(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli, "prepare_jax", lambda: None)
    monkeypatch.setenv("COLUMNS", "100")
    small = "--items 6 --train-instances 80 --valid-instances 20 --batch 8 --hidden 8 --chunk 5"
    lists = "--seeds 2 --learning-rate 1e-3,3e-3 --devices 1"
    train.main([*small.split(), *lists.split(), "--run", "s"])
    output = capsys.readouterr().out
    assert "bin-aware-2d, 4 runs in s" in output
    assert "learning-rate 0.003     2" in output
    assert "curves: s/curves.png\nsweep: s" in output
    folder = tmp_path / "s"
    assert (folder / "curves.png").read_bytes().startswith(b"\x89PNG")
    assert "±" in (folder / "table.txt").read_text()
    rows = json.loads((folder / "table.json").read_text())
    assert [row["setting"] for row in rows] == ["learning-rate 0.001", "learning-rate 0.003"]
    assert {"mean", "low", "high"} == rows[0]["figures"]["bins"].keys()
    member = folder / "seed-1-learning-rate-0.003"
    assert read_policy(member).config.learning_rate == 3e-3
    assert [r["update"] for r in read_lines(member) if "validation" not in r] == [5, 10]
    train.main(["--resume", "s"])
    assert capsys.readouterr().out.rstrip().endswith("sweep: s")
    for wrong in (
        ["--resume", "s", "--epochs", "3"],
        [*small.split(), "--seeds", "2", "--run", "s"],
    ):
        with pytest.raises(UserError, match=r"takes no other option|exists already"):
            train.main(wrong)
    (folder / "sweep.json").write_text('{"members": [{"folder": 3, "setting": ""}]}')
    with pytest.raises(UserError, match=r"sweep.json.members\[0\].folder: 3 is not of type str"):
        train.main(["--resume", "s"])


def test_each_member_is_alone_whatever_the_axis():
    found = each_member(lambda x, y: (x * 2, y + 1), jnp.arange(3), jnp.ones((3, 2)))
    np.testing.assert_array_equal(found[0], [0, 2, 4])
    assert found[1].shape == (3, 2)
