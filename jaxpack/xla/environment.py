"""What is read from the environment without importing JAX, which takes a second."""

import os
import platform
from pathlib import Path


def cache_folder() -> Path:
    """Where programs are kept between runs: JAX_COMPILATION_CACHE_DIR or the user's cache."""
    if own := os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jaxpack"


def compiler() -> tuple[str, ...]:
    """What a program depends on besides itself: JAX, its compiler with its flags, and the host."""
    from importlib.metadata import version  # not for those who compile nothing

    return version("jax"), version("jaxlib"), os.environ.get("XLA_FLAGS", ""), platform.node()


def environment_of_another(package: Path) -> dict[str, str]:
    """The environment of a process beside this one that computes too.

    Args:
        package: the folder that the package is in.
    """
    path = os.pathsep.join(filter(None, (str(package), os.environ.get("PYTHONPATH"))))
    return os.environ | {"PYTHONPATH": path, "XLA_PYTHON_CLIENT_PREALLOCATE": "false"}


def usable_cores() -> int:
    """How many cores this process may use, at least 1; where nobody says, those of the machine."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
