"""Where there is no `fcntl` (Windows) and no `os.sched_getaffinity` (macOS) everything goes on."""

import os
import signal
import subprocess
import sys

import pytest

from jaxpack.errors import UserError
from jaxpack.io.locks import held
from jaxpack.xla.environment import usable_cores

BARE = """
import os, sys
sys.modules["fcntl"] = None
del os.sched_getaffinity
"""
EVALUATE = """
import sys
from jaxpack.cli import run_door
from jaxpack.evaluate import main
sys.argv[1:] = ["paper-2d", "--methods", "random", "--instances", "8", "--batch", "4"]
sys.argv += ["--sweep", "sweep.jsonl"]
run_door(main)
"""
LOCKS = """
from pathlib import Path
from jaxpack.io.locks import held
from jaxpack.errors import UserError
with held(Path("lock"), "somebody has it"):
    try:
        with held(Path("lock"), "somebody has it"):
            raise SystemExit("twice")
    except UserError as error:
        assert str(error) == "somebody has it"
with held(Path("lock"), "somebody has it"):
    pass
"""
CORES = """
import jax
from jaxpack.xla.devices import use_all_cores
from jaxpack.xla.environment import usable_cores
use_all_cores()
assert usable_cores() == os.cpu_count() == len(jax.devices())
"""
HOLD = """
import time
from pathlib import Path
from jaxpack.io.locks import held
with held(Path("lock"), "somebody has it"):
    print("held", flush=True)
    time.sleep(600)
"""


def run(folder, program):
    return subprocess.Popen(
        [sys.executable, "-c", program],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize("program", [EVALUATE, LOCKS, CORES], ids=["evaluate", "locks", "cores"])
def test_without_what_only_linux_has(program, tmp_path):
    process = run(tmp_path, BARE + program)
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors


def test_cores_are_those_that_this_process_may_use(monkeypatch):
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {3, 5, 8}, raising=False)
    assert usable_cores() == 3
    monkeypatch.delattr("os.sched_getaffinity")
    monkeypatch.setattr("os.cpu_count", lambda: None)
    assert usable_cores() == 1


def test_a_lock_goes_with_the_process_that_is_killed(tmp_path):
    process = run(tmp_path, HOLD)
    assert process.stdout.readline() == "held\n"
    with pytest.raises(UserError, match="in use"), held(tmp_path / "lock", "in use"):
        pass
    process.send_signal(signal.SIGKILL)
    process.communicate()
    with held(tmp_path / "lock", "in use"):
        pass


def test_a_lock_makes_no_folders(tmp_path):
    with pytest.raises(FileNotFoundError), held(tmp_path / "none" / "lock", "in use"):
        pass
    assert not list(tmp_path.iterdir())
