"""Files that one process holds at a time."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from jaxpack.errors import UserError


@contextmanager
def held(path: Path, in_use: str) -> Iterator[None]:
    """Keeps every other process out of a block that holds the same file; never waits.

    The lock is the operating system's where it has one, and goes with the process that held it,
    however that ended. The file is made where it is missing, and stays: who removed it could let
    two others in.

    Args:
        path: an empty file for this alone.
        in_use: what the UserError says where another process, or another block, holds it.

    Raises:
        UserError: see `in_use`.
        OSError: where the file cannot be made or opened.
    """
    path.parent.stat()  # a folder that is missing is an error; the library would make it
    lock = FileLock(path)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise UserError(in_use) from None
    try:
        yield
    finally:
        lock.release()
