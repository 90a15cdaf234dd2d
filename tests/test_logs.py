"""What is said of a training while it goes on: to a function, as JSON lines, to TensorBoard."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from cases import TINY

from jaxpack import UserError, train_policy
from jaxpack.io.board import tensorboard
from jaxpack.io.runs import lock_run, read_lines, read_policy

HOW = {"seed": 4, "chunk": 4, "checkpoint_every": 8}


def same(policy, other):
    for ours, theirs in zip(
        jax.tree.leaves(policy.params), jax.tree.leaves(other.params), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs)
    return policy.config == other.config


@pytest.mark.long
def test_a_function_is_told_what_the_file_says_and_may_end_it(tmp_path):
    records = []
    policy = train_policy(TINY, tmp_path / "whole", log=records.append, **HOW)
    assert records == read_lines(tmp_path / "whole")
    assert {record["update"] for record in records} == set(range(4, TINY.updates + 1, 4))
    assert same(policy, read_policy(tmp_path / "whole"))

    def enough(record):
        return record["update"] == 20

    run = str(tmp_path / "stopped")
    train_policy(TINY, run, log=enough, **HOW)
    assert read_lines(tmp_path / "stopped")[-1]["update"] == 20
    again = []
    assert same(train_policy(TINY, run, log=again.append, **HOW), policy)
    assert again[0]["update"] == 24
    for other in ({"recipe": replace(TINY, alpha=0.1)}, {"seed": 5}):
        with pytest.raises(UserError, match="exists already and is of another recipe or seed"):
            train_policy(**({"recipe": TINY, "run": run} | HOW | other))
    with lock_run(tmp_path / "stopped"), pytest.raises(UserError, match="another process"):
        train_policy(TINY, run, **HOW)
    with pytest.raises(UserError, match="there are 1; ask for 1 to 1"):
        train_policy(TINY, tmp_path / "more", devices=2)
    assert not (tmp_path / "more").exists()


def test_tensorboard_has_what_is_measured(tmp_path):
    with tensorboard(tmp_path) as log:
        log({"update": 4, "epoch": 1, "cost": 2.5})
        log({"update": 8, "epoch": 1, "validation": {"bins": 4.25}})
    (events,) = (tmp_path / "tensorboard").glob("events.out.tfevents.*")
    data = events.read_bytes()
    for tag, value in ((b"train/cost", 2.5), (b"validation/bins", 4.25)):
        assert tag in data
        assert np.float32(value).tobytes() in data
    assert b"epoch" not in data
