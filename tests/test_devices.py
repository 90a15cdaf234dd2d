"""Eight devices give what one gives, by the same functions: fake devices of the CPU."""

import json
import os
import subprocess
import sys

import pytest
from cases import TINY

from jaxpack.errors import UserError
from jaxpack.xla.devices import pick_devices

pytestmark = pytest.mark.slow

EIGHT = {"XLA_FLAGS": "--xla_force_host_platform_device_count=8"}
TRAINING = """
from dataclasses import replace

import jax, numpy as np
from cases import TINY
from jaxpack.learning.bin_aware import BinAwareConfig
from jaxpack.xla.devices import data_mesh, on_all
from jaxpack.learning.trainer import policy_gradient
from jaxpack.learning.trainer import init_state, train_chunk, training_instances
from jaxpack.training import validate_policy

def assert_close(one, two):
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(two), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-4, atol=3e-5)

ends = []
small = replace(TINY, valid_instances=20)
for mesh in (None, data_mesh(1), data_mesh(8)):
    state = jax.device_put(init_state(small, jax.random.key(0)), on_all(mesh) if mesh else None)
    state, metrics = train_chunk(small, state, 5, mesh)
    assert len(jax.tree.leaves(state.params)[0].devices()) == (mesh.size if mesh else 1)
    ends.append((state.params, metrics, validate_policy(small, state.params, state.key, mesh)))
assert_close(ends[0], ends[1])
assert_close(ends[0], ends[2])

config = replace(TINY, policy=BinAwareConfig(hidden=8), learner="leave-one-out", samples=2)
key = jax.random.key(0)
params = init_state(config, key).params
instances = training_instances(config, key, jax.numpy.arange(8))
gradient = jax.jit(policy_gradient, static_argnames=("config", "mesh"))
one, eight = (gradient(config, params, instances, key, data_mesh(n)) for n in (1, 8))
assert max(abs(leaf).max() for leaf in jax.tree.leaves(one)) > 0.01
assert_close(one, eight)
"""

BREEDING = """
import jax, numpy as np
from cases import TINY
from jaxpack import sample
from jaxpack.search.breeding import BrkgaConfig
from jaxpack.search.brkga import brkga
from jaxpack.xla.devices import data_mesh, on_all

keys = jax.random.split(jax.random.key(1), 2)
instances = sample(TINY.problem, TINY.distribution, jax.random.key(0), 2)
config = BrkgaConfig(population=30, generations=4)  # neither 30 nor 24 are all devices' share
alone = brkga(TINY.problem, keys, instances, config)
for devices in (1, 5, 8):
    mesh = data_mesh(devices)
    inputs = jax.device_put((keys, instances), on_all(mesh))
    search = jax.jit(lambda *inputs: brkga(TINY.problem, *inputs, config, mesh=mesh))
    np.testing.assert_array_equal(search(*inputs), alone)
"""


def run_on_eight(tmp_path, *arguments):
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=tmp_path,
        env=os.environ | EIGHT | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        timeout=400,
    )


def test_eight_devices_learn_what_one_learns(tmp_path):
    done = run_on_eight(tmp_path, "-c", TRAINING)
    assert done.returncode == 0, done.stderr


def test_devices_share_a_generation_and_breed_what_one_breeds(tmp_path):
    done = run_on_eight(tmp_path, "-c", BREEDING)
    assert done.returncode == 0, done.stderr


def test_the_training_door_shares_batches_among_devices(tmp_path):
    small = "paper-2d --items 6 --train-instances 80 --valid-instances 20 --batch 8 --hidden 8"
    options = [*small.split(), "--epochs", "1", "--devices", "8", "--run", "eight"]
    done = run_on_eight(tmp_path, "-m", "jaxpack.train", *options)
    assert done.returncode == 0, done.stderr
    assert "on 8 devices" in done.stdout
    for asked, message in (("3", "a batch of 8 cannot be cut into 3 equal"), ("9", "there are 8;")):
        done = run_on_eight(
            tmp_path, "-m", "jaxpack.train", "--resume", "eight", "--devices", asked
        )
        assert done.returncode == 2
        assert done.stderr.startswith(f"error: --devices {asked}: {message}")


def test_comparisons_do_not_depend_on_the_devices(tmp_path):
    options = ["--methods", "random,pointer,brkga", "--instances", "20", "--batch", "8"]
    options += ["--items", "12", "--brkga-population", "10", "--brkga-generations", "3"]
    rows = []
    for devices in ("1", "8"):
        more = ["--devices", devices, "--json", "rows.json"]
        done = run_on_eight(tmp_path, "-m", "jaxpack.evaluate", "paper-2d", *options, *more)
        assert done.returncode == 0, done.stderr
        rows.append(json.loads((tmp_path / "rows.json").read_text()))
        for row in rows[-1]:
            del row["ms_per_instance"]
    assert rows[0] == rows[1]
    options[1:3] = ["brkga", "--time-limit", "0.01", "--devices", "8", "--instances"]
    done = run_on_eight(tmp_path, "-m", "jaxpack.evaluate", "paper-2d", *options)
    assert done.returncode == 0, done.stderr


def test_devices_that_are_not_there_or_do_not_fit_are_refused():
    assert pick_devices(None, TINY.batch) == 1
    for asked in (0, 2):
        with pytest.raises(UserError, match=f"--devices {asked}: there are 1; ask for 1 to 1"):
            pick_devices(asked, TINY.batch)
