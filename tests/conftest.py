"""Most of the time of these tests is compiling: programs that several need compile once."""

import ctypes
import gc
import os
import resource
import tempfile
from contextlib import suppress
from pathlib import Path

import jax
import pytest

from jaxpack.xla.programs import tune_for_cpu


def pytest_configure(config):
    if not hasattr(config, "workerinput"):  # the workers inherit what their master set
        config.compilation_cache = tempfile.TemporaryDirectory(prefix="jaxpack-tests-")
        os.environ["JAX_COMPILATION_CACHE_DIR"] = config.compilation_cache.name
        os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
        os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
        # XLA does all it does, LLVM does little: half the time for programs that run briefly.
        flags = os.environ.get("XLA_FLAGS", "")
        if "optimization_level" not in flags:
            os.environ["XLA_FLAGS"] = f"{flags} --xla_backend_optimization_level=0"
    tune_for_cpu()  # as the doors do


MOST_MEMORY = 1200  # MiB that a worker keeps from one file of tests to the next


@pytest.fixture(scope="module", autouse=True)
def _programs_leave_the_memory():
    """Those on disk come back quickly; all of them together take gigabytes."""
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
