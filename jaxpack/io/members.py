"""Sweep folders: runs that are trained as one program, side by side.

SWEEP/sweep.json           its members: folder and setting
SWEEP/.lock                held by who trains
SWEEP/MEMBER/              a run folder, see `jaxpack.io.runs`
SWEEP/table.json, table.txt, curves.png   the end of the sweep
"""

import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from jaxpack.io.atomic import new_folder
from jaxpack.io.configs import config_from_dict, config_to_dict
from jaxpack.io.runs import RunConfig, create_run, lock_run, read_run
from jaxpack.io.texts import read_json

FILE = "sweep.json"


@dataclass(frozen=True)
class Named:
    """A member as sweep.json has it."""

    folder: str
    setting: str  # what it has in common with those that differ from it in their seeds alone


@dataclass(frozen=True)
class Listed:
    """What sweep.json holds."""

    members: tuple[Named, ...]


@dataclass(frozen=True)
class Member:
    """One run of a sweep."""

    run: Path
    setting: str
    config: RunConfig


def create_sweep(path: Path, members: Sequence[tuple[str, str, RunConfig]]) -> list[Member]:
    """Makes the folder of a sweep with a run folder for each member.

    Args:
        members: (folder, setting, config) of each.

    Raises:
        UserError: where it exists or cannot be made.
    """
    listed = Listed(tuple(Named(folder, setting) for folder, setting, _ in members))
    with new_folder(path) as beside:
        for folder, _, config in members:
            create_run(beside / folder, config)
        (beside / FILE).write_text(json.dumps(config_to_dict(listed), indent=2) + "\n")
    return [Member(path / folder, setting, config) for folder, setting, config in members]


def is_sweep(path: Path) -> bool:
    """Whether there is the folder of a sweep."""
    return (path / FILE).is_file()


def read_sweep(path: Path) -> list[Member]:
    """The members of a sweep. Raises UserError where one is missing, foreign or damaged."""
    listed = config_from_dict(Listed, read_json(path / FILE), str(path / FILE))
    return [
        Member(path / named.folder, named.setting, read_run(path / named.folder))
        for named in listed.members
    ]


@contextmanager
def lock_sweep(path: Path, members: Sequence[Member]) -> Iterator[None]:
    """Keeps every other process from training the sweep, or one of its members.

    Raises:
        UserError: where another process does, or a folder may not be written.
    """
    with ExitStack() as stack:
        for folder in (path, *(member.run for member in members)):
            stack.enter_context(lock_run(folder))
        yield
