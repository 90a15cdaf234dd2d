"""Two real processes over loopback train one run, are killed, and go on as two and as one."""

import json
import signal
import socket
import subprocess
import sys
import time
from os import environ, pathsep

import pytest

from jaxpack.errors import UserError
from jaxpack.xla.devices import join_processes

pytestmark = pytest.mark.slow

SMALL = (
    "paper-2d --items 6 --train-instances 80 --valid-instances 20 --batch 8 --hidden 8 --chunk 5"
)


def start(folder, count, *options):
    """`count` processes of the training door that know each other, or one that is alone."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    processes = []
    for index in range(count):
        command = [sys.executable, "-m", "jaxpack.train", *options]
        if count > 1:
            command += ["--coordinator", address, "--num-processes", str(count)]
            command += ["--process-id", str(index)]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        paths = environ | {"PYTHONPATH": pathsep.join(sys.path)}
        processes.append(subprocess.Popen(command, cwd=folder, env=paths, **pipes))
    return processes


def finish(processes):
    """[(exit code, output, errors)] of processes that end by themselves."""
    ends = [(*process.communicate(timeout=200), process.returncode) for process in processes]
    return [(code, output, errors) for output, errors, code in ends]


def costs(run):
    """{update: cost} of the chunks, each there once."""
    records = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    chunks = [record for record in records if "cost" in record]
    found = {record["update"]: record["cost"] for record in chunks}
    assert list(found) == list(range(5, 5 * len(chunks) + 1, 5)), "a line was lost or repeated"
    return found


def wait_for_lines(run, beyond):
    while not (run / "metrics.jsonl").exists() or max(costs(run), default=0) <= beyond:
        time.sleep(0.1)


def test_two_processes_train_what_one_trains(tmp_path):
    short = [*SMALL.split(), "--epochs", "1"]
    two = finish(start(tmp_path, 2, *short, "--run", "two"))
    one = finish(start(tmp_path, 1, *short, "--run", "one"))
    assert [code for code, _, _ in two + one] == [0, 0, 0], two + one
    assert "on 2 devices" in two[0][1]
    assert two[0][1].rstrip().endswith("run: two")
    assert two[1][1].startswith("[Gloo]"), "only process 0 prints, and what joins them"
    assert len(two[1][1].splitlines()) == 1
    assert costs(tmp_path / "two") == pytest.approx(costs(tmp_path / "one"), rel=1e-4)
    for name in ("table.txt", "packing.png"):
        assert (tmp_path / "two" / name).exists()
    again = finish(start(tmp_path, 2, *short, "--run", "two"))
    assert [code for code, _, _ in again] == [2, 2]
    assert "error: two: exists already" in again[0][2]
    assert "error: process 0 cannot begin" in again[1][2]


def test_killed_as_two_resumed_as_two_and_as_one(tmp_path):
    run = tmp_path / "run"
    endless = ["--epochs", "100000", "--checkpoint-every", "50", "--run", "run"]
    processes = start(tmp_path, 2, *SMALL.split(), *endless)
    wait_for_lines(run, 100)
    processes[1].send_signal(signal.SIGKILL)
    (code, _, errors), _ = finish(processes)
    assert code == 2, errors
    assert "error: a process was lost" in errors
    assert errors.rstrip().endswith("start all again with --resume run")
    for count in (2, 1):
        before = max(costs(run))
        processes = start(tmp_path, count, "--resume", "run")
        wait_for_lines(run, before)
        processes[-1].send_signal(signal.SIGTERM)  # one is told, all stop
        ends = finish(processes)
        assert [code for code, _, _ in ends] == [0] * count, ends
        assert "python -m jaxpack.train --resume run" in ends[0][1]
        assert (run / "checkpoints" / str(max(costs(run)))).is_dir()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("localhost:1", None, 2), "give all three or none"),
        (("localhost", 0, 2), "--coordinator 'localhost': give HOST:PORT"),
        (("localhost:1", 2, 2), "--process-id 2: of 2 processes"),
    ],
)
def test_what_does_not_go_together_is_refused(given, message):
    with pytest.raises(UserError, match=message):
        join_processes(*given)
