"""A sweep's file: a line that says of what, then a line of sums per chunk of instances.

    {"preset": "bin-aware-2d", "methods": "height", "instances": 1000000, ...}
    {"method": "height", "cell": 0, "count": 10000, "seconds": 1.2, "sums": {"bins": [..], ..}}

Chunks follow each other, so what is done is a count. Killed at any moment, a sweep loses the
chunk it was at.
"""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import IO, Any

import numpy as np

from jaxpack.errors import UserError
from jaxpack.io.locks import held

UNIT = 2**40  # sums are whole numbers of 1 / UNIT: exact, and so the same in any order


@dataclass(frozen=True)
class Tally:
    """Sums over some instances."""

    count: int
    seconds: float
    sums: dict[str, tuple[int, int]]  # by measure: of the values and of their squares

    def plus(self, other: "Tally") -> "Tally":
        """Both together."""
        sums = {
            name: (first + self.sums.get(name, (0, 0))[0], second + self.sums.get(name, (0, 0))[1])
            for name, (first, second) in other.sums.items()
        }
        return Tally(self.count + other.count, self.seconds + other.seconds, sums)

    def mean(self, name: str) -> float:
        """Of a measure over the instances."""
        return self.sums[name][0] / (self.count * UNIT)

    def standard_error(self, name: str) -> float:
        """Of that mean; 0 of a single instance."""
        first, second = self.sums[name]
        spread = max(0, second * UNIT * self.count - first * first)
        return float((spread / (UNIT**2 * self.count**2 * max(1, self.count - 1))) ** 0.5)


EMPTY = Tally(0, 0.0, {})


def tally(values: Mapping[str, np.ndarray], seconds: float) -> Tally:
    """The sums of some instances' measures (float [B] each, rounded to 1 / UNIT)."""

    def total(value: np.ndarray) -> int:
        return sum(map(int, np.rint(value * UNIT).tolist()))

    counts = {len(value) for value in values.values()}
    return Tally(counts.pop(), seconds, {k: (total(v), total(v * v)) for k, v in values.items()})


class Sweep:
    """What is done of a sweep, by method and number of the cell; kept in a file if there is one."""

    def __init__(self, file: IO[str] | None = None) -> None:
        self._file = file
        self._done: dict[tuple[str, int], Tally] = {}

    def done(self, method: str, cell: int) -> Tally:
        """The sums over the first instances."""
        return self._done.get((method, cell), EMPTY)

    def add(self, method: str, cell: int, part: Tally) -> None:
        """The sums over the instances that follow. Raises UserError where they cannot be kept."""
        if self._file is not None:
            write_line(self._file, {"method": method, "cell": cell} | asdict(part))
        self._done[method, cell] = self.done(method, cell).plus(part)

    def recall(self, record: dict[str, Any]) -> None:
        """A line of the file, put where `add` put it.

        Raises:
            ValueError, KeyError, TypeError, AttributeError: where it is none.
        """
        sums = {name: (first, second) for name, (first, second) in record["sums"].items()}
        part = Tally(record["count"], record["seconds"], sums)
        at = record["method"], record["cell"]
        numbers = [part.count, at[1], *chain(*sums.values())]
        if any(type(number) is not int for number in numbers) or part.count < 1:
            raise ValueError("sums and counts are whole numbers")
        if not isinstance(part.seconds, float | int) or not 0 <= part.seconds < float("inf"):
            raise ValueError("seconds are a number")
        self._done[at] = self.done(*at).plus(part)


def write_line(file: IO[str], record: dict[str, Any]) -> None:
    """Appends a line, on the disk before this returns. Raises UserError where it cannot be."""
    try:
        file.write(json.dumps(record) + "\n")
        file.flush()
        os.fsync(file.fileno())
    except OSError as error:
        raise UserError(
            f"{file.name}: cannot be written ({error.strerror}); make room and give the same "
            "command again: it goes on from here"
        ) from error


@contextmanager
def open_sweep(path: Path, options: dict[str, Any]) -> Iterator[Sweep]:
    """The sweep in a file, begun or gone on with; no other process may do so meanwhile.

    Args:
        options: what its figures depend on, plain data.

    Raises:
        UserError: where the file is of other options, damaged, in use, or cannot be opened.
    """
    in_use = f"--sweep {path}: another process is at it; wait for its end"
    with ExitStack() as stack:
        try:
            file = stack.enter_context(open(path, "a+", encoding="utf-8", newline="\n"))
            stack.enter_context(held(path.with_name(f".{path.name}.lock"), in_use))
        except OSError as error:
            raise UserError(f"--sweep {path}: {error.strerror}; name another file") from error
        header, end = _recalled(sweep := Sweep(file), file, path, options)
        if header is not None and header != options:
            name = next(k for k in header | options if header.get(k) != options.get(k))
            raise UserError(
                f"--sweep {path}: was begun with {name} {header.get(name)}, not "
                f"{options.get(name)}; give the same options or name another file"
            )
        file.truncate(end)
        if header is None:
            write_line(file, options)
        yield sweep


def _recalled(
    sweep: Sweep, file: IO[str], path: Path, options: dict[str, Any]
) -> tuple[dict[str, Any] | None, int]:
    """(the file's first line, bytes up to the end of its last whole one); the others are recalled.

    A last line without its end is one that a kill cut short.
    """
    file.seek(0)
    try:
        whole, _, torn = file.read().rpartition("\n")
        lines = whole.split("\n") if whole else []
        records = [json.loads(line) for line in lines]
        header = dict(records[0]) if records else None
        for record in records[1:]:
            sweep.recall(record)
        if not records and not json.dumps(options).startswith(torn):
            raise ValueError
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise UserError(f"--sweep {path}: not a sweep's file; name another") from error
    return header, len(whole.encode()) + 1 if whole else 0
