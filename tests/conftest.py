"""Most of the time of these tests is compiling: programs that several need compile once."""

import ctypes
import gc
import os
import resource
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import pytest


def pytest_configure(config):
    if not hasattr(config, "workerinput"):  # the workers inherit what their master set
        config.compilation_cache = tempfile.TemporaryDirectory(prefix="jaxpack-tests-")
        os.environ["JAX_COMPILATION_CACHE_DIR"] = config.compilation_cache.name
        os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
        os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
        # XLA does all it does, LLVM does little: half the time for programs that run briefly.
        add_flag("--xla_backend_optimization_level=0")
        # What makes code of its fusions takes two thirds of what is left; the one before it is
        # quick. The slow tests do without, and so do releases that no longer know the flag
        # (jaxlib 0.12): `.ci/run` has the quick ones run on those too.
        if config.option.markexpr != "slow":
            add_flag("--xla_cpu_use_fusion_emitters=false")
        add_flag("--xla_cpu_parallel_codegen_split_count=1")  # the cores have other tests to run
    from jaxpack.xla.programs import tune_for_cpu  # JAX reads its part of this when imported

    tune_for_cpu()  # as the doors do


def add_flag(flag):
    """Gives XLA a flag that nobody has given, if it is one that it knows: it ends a process
    otherwise.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if flag.partition("=")[0] in flags:
        return
    trial = [sys.executable, "-c", "import jax; jax.devices()"]
    more = {"XLA_FLAGS": f"{flags} {flag}"}
    alone = os.environ | more | {"JAX_PLATFORMS": "cpu"}
    if subprocess.run(trial, env=alone, capture_output=True).returncode == 0:
        os.environ.update(more)


def pytest_collection_modifyitems(items):
    """The pages first: each takes minutes, and one that came last would keep one core waiting."""
    items.sort(key=lambda item: not item.nodeid.startswith("tests/test_docs.py"))


def pytest_collection_finish():
    """What is imported stays: to look through it for garbage, again and again while programs are
    traced, takes a tenth of all time.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)


MOST_MEMORY = 2000  # MiB that a worker keeps from one test to the next


@pytest.fixture(autouse=True)
def _programs_leave_the_memory():
    """Those on disk come back quickly; all of them together take gigabytes."""
    import jax

    yield
    pages = Path("/proc/self/statm")
    held = int(pages.read_text().split()[1]) * resource.getpagesize() if pages.exists() else 0
    if held > MOST_MEMORY * 2**20:
        jax.clear_caches()
        gc.collect()
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).malloc_trim(0)


def pytest_unconfigure(config):
    if not hasattr(config, "workerinput"):
        config.compilation_cache.cleanup()
