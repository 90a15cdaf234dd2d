"""Most of the time of these tests is compiling: programs that several need compile once."""

import os
import tempfile

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


def pytest_unconfigure(config):
    if not hasattr(config, "workerinput"):
        config.compilation_cache.cleanup()
