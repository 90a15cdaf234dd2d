"""Files that are either the old or the new ones, never half of one; and folders."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from jaxpack.errors import UserError


@contextmanager
def replace_file(path: Path, mode: str = "w") -> Iterator[IO[Any]]:
    """Opens a file beside `path` and renames it into place when the block ends well.

    Raises:
        UserError: where the folder is missing or may not be written.
    """
    beside = _beside(path)
    try:
        with open(beside, mode) as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        with suppress(OSError):
            beside.unlink()


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A folder beside `path` to be filled, which has that name once the block has ended well.

    Raises:
        UserError: where it exists or cannot be made.
    """
    if path.exists():
        raise UserError(f"{path}: exists already; go on with --resume {path} or name another run")
    beside = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
        beside.chmod(0o755)
        yield beside
        os.rename(beside, path)
    except OSError as error:
        raise UserError(f"{path}: cannot be made ({error.strerror}); name another run") from error
    finally:
        if beside is not None:
            shutil.rmtree(beside, ignore_errors=True)


def check_writable(path: Path) -> None:
    """Checks that `replace_file` could write there, before there is anything to write.

    Raises:
        UserError: where it could not.
    """
    if not path.name or os.path.isdir(path):  # unlike that of Path false for a name too long
        raise UserError(f"{path}: is a folder; name a file in it")
    if not os.path.isdir(path.absolute().parent):
        raise UserError(f"{path}: its folder does not exist; make it first")
    beside = _beside(path)
    try:
        beside.touch()
        beside.unlink()
    except OSError as error:
        raise _unwritable(path, error) from error


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


def _unwritable(path: Path, error: OSError) -> UserError:
    return UserError(f"{path}: cannot be written ({error.strerror}); make room or name another")
