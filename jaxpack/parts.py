"""A folder of results that come in parts, and a manifest that says what is in it.

A part is two files, and a record in the manifest once both are there. Whatever ends the program,
what the manifest names is whole, and goes on from there to the same bytes.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from jaxpack.errors import UserError
from jaxpack.io.arrow import arrow, typed
from jaxpack.io.atomic import replace_file
from jaxpack.io.texts import read_text
from jaxpack.many import tables_of
from jaxpack.model.numbers import fault, show
from jaxpack.solution import Solution, Status

TABLES = ("placements", "figures")
COUNTED = ("orders", "items", "bins", "bound", "errors", "infeasible")
"""What the manifest has of every part, and of all of them."""


class Parts:
    """The parts in a folder: made, or found there."""

    def __init__(self, folder: Path, source: Mapping[str, Any]) -> None:
        """Finds those that are whole, or makes the manifest.

        Args:
            folder: exists, and no other process writes to it.
            source: what the results are of, in JSON's types.

        Raises:
            UserError: where there are results of something else, or other files.
        """
        self.folder, self.source = folder, dict(source)
        self.manifest = folder / "manifest.json"
        self.done: dict[int, dict[str, Any]] = {}
        self.complete = False
        for left in folder.glob(".*.tmp"):  # by a process that was killed
            left.unlink()
        if self.manifest.exists():
            self._read()
        elif others := sorted(p.name for p in folder.iterdir() if not p.name.startswith(".")):
            what = f"has other files ({show(others[0])}) and no manifest.json"
            raise fault(folder, what, "name a new folder")
        else:
            self._write()

    @property
    def totals(self) -> dict[str, int]:
        """The counts of all parts together."""
        sums = Counter[str]()
        for part in self.done.values():
            sums.update({name: part[name] for name in COUNTED})
        return {name: sums[name] for name in COUNTED}

    def add(self, number: int, results: Sequence[tuple[str, Solution | str | None]]) -> None:
        """Writes a part: the tables of its orders."""
        hashes = {}
        for table, columns in zip(TABLES, tables_of(results), strict=True):
            data = _parquet(columns)
            with replace_file(self._path(table, number), "wb") as file:
                file.write(data)
            hashes[table] = sha256(data).hexdigest()
        solutions = [one for _, one in results if isinstance(one, Solution)]
        self.done[number] = {
            "part": number,
            "first": results[0][0],
            "last": results[-1][0],
            "orders": len(results),
            "items": sum(one.job.count for one in solutions),
            "bins": sum(one.figures.bins for one in solutions),
            "bound": sum(one.bound for one in solutions),
            "errors": len(results) - len(solutions),
            "infeasible": sum(one.status is Status.INFEASIBLE for one in solutions),
            "sha256": hashes,
        }
        self._write()

    def close(self) -> None:
        """Says that these are all."""
        self.complete = True
        self._write()

    def _path(self, table: str, number: int) -> Path:
        return self.folder / f"{table}-{number:05}.parquet"

    def _read(self) -> None:
        try:
            found = json.loads(read_text(self.manifest))
            known = {name: found[name] for name in self.source}
            parts = {part["part"]: part for part in found["parts"] if self._whole(part)}
            complete = found["complete"] and len(parts) == len(found["parts"])
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            if isinstance(error, UserError):
                raise
            raise fault(self.manifest, "is no manifest of parts", "name a new folder") from None
        for name, value in self.source.items():
            if known[name] != value:
                what = _difference(name, known[name], value)
                raise fault(self.manifest, what, "name another folder, or give the same")
        self.done, self.complete = parts, complete

    def _whole(self, part: Mapping[str, Any]) -> bool:
        """Whether its files are as they were written."""
        paths = {table: self._path(table, part["part"]) for table in TABLES}
        return all(
            path.is_file() and sha256(path.read_bytes()).hexdigest() == part["sha256"][table]
            for table, path in paths.items()
        )

    def _write(self) -> None:
        parts = [self.done[number] for number in sorted(self.done)]
        ends = {"totals": self.totals, "complete": self.complete}
        with replace_file(self.manifest) as file:
            json.dump({**self.source, "parts": parts, **ends}, file, indent=1, ensure_ascii=False)


def _parquet(columns: Mapping[str, Sequence[Any]]) -> bytes:
    pa = arrow()
    sink = pa.BufferOutputStream()
    pa.parquet.write_table(typed(columns), sink)
    return sink.getvalue().to_pybytes()


def _difference(name: str, there: Any, here: Any) -> str:
    """What is not the same, in words."""
    if isinstance(there, Mapping) and isinstance(here, Mapping):
        for key, value in here.items():
            if there.get(key) != value:
                return _difference(f"{name}: {key}", there.get(key), value)
    return f"is of another {name}, {show(there)} instead of {show(here)}"
