"""Tables with named columns, from files or from a program's own columns."""

import csv
import difflib
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from jaxpack.errors import UserError
from jaxpack.io.texts import write_text
from jaxpack.model.numbers import as_number, as_size, as_weight, as_whole, fault, plain, show

MOST_COLUMNS = 1_000
MOST_ROWS = 250_000
FORMULA = ("=", "+", "-", "@", "\t", "\r", "＝", "＋", "－", "＠")
"""What a text in a cell begins with that a spreadsheet would run."""

_FLAGS = {"1": True, "0": False, "TRUE": True, "FALSE": False}


@dataclass(frozen=True, slots=True)
class Row:
    """One row; its methods raise a UserError that names the row and the column."""

    source: str  # the file or table
    row: int
    cells: Sequence[Any]
    places: Mapping[str, int]  # column -> which of the cells

    @property
    def where(self) -> str:
        """Which row it is, for messages."""
        return f"{self.source}: row {self.row}"

    def at(self, column: str) -> str:
        """Where a cell is, for messages."""
        return f"{self.where}, column {column}"

    def cell(self, column: str) -> Any:
        """What the cell holds; None if it is empty, or there is no such column."""
        place = self.places.get(column)
        value = None if place is None else self.cells[place]
        if isinstance(value, str):
            return value if value.strip() else None
        if isinstance(value, np.floating) and value.itemsize < 8 and np.isfinite(value):
            return str(value)  # its own few digits
        return None if _empty(value) else value

    def has(self, column: str) -> bool:
        """Whether there is anything in the cell."""
        return self.cell(column) is not None

    def number(self, column: str) -> float:
        """A finite number."""
        return as_number(self.cell(column), self.at(column))

    def size(self, column: str) -> float:
        """The length of a side."""
        return as_size(self.cell(column), self.at(column))

    def weight(self, column: str) -> float:
        """A weight; 0 if the cell is empty."""
        value = self.cell(column)
        return 0.0 if value is None else as_weight(value, self.at(column))

    def whole(self, column: str, low: int, high: int | None = None) -> int:
        """A whole number within limits."""
        return as_whole(self.cell(column), self.at(column), low, high)

    def flag(self, column: str, default: bool) -> bool:
        """0 or 1, TRUE or FALSE, or a bool; the default if the cell is empty."""
        value = self.cell(column)
        if isinstance(value, str):
            value = _FLAGS.get(value.strip().upper(), value)
        if value is None or isinstance(value, bool | np.bool_):
            return default if value is None else bool(value)
        try:
            return as_whole(value, self.at(column), 0, 1) == 1
        except UserError:
            what = f"{show(value)} says neither yes nor no"
            raise fault(self.at(column), what, "give 1 or 0") from None

    def unlimited(self, column: str) -> bool:
        """Whether the cell holds an infinite number."""
        value = self.cell(column)
        if isinstance(value, str):
            return value.strip().lower().removeprefix("+") in ("inf", "infinity", "∞")
        return isinstance(value, float | np.floating) and bool(value == math.inf)

    def text(self, *columns: str) -> str:
        """The first of the columns that holds a text or a number; "" if none does."""
        for column in columns:
            value = self.cell(column)
            if value is None:
                continue
            try:
                return str(plain(value) if isinstance(value, float) else value).strip()
            except ValueError as error:  # an integer of thousands of digits
                raise fault(
                    self.at(column), "a number of thousands of digits is no text"
                ) from error
        return ""


def _empty(value: object) -> bool:
    """Whether a cell holds nothing: NaN and NA are how data frames leave it so."""
    if value is None:
        return True
    if isinstance(value, Decimal):
        return value.is_nan()
    if isinstance(value, Real | np.generic):
        return bool(value != value)
    return type(value).__name__ in ("NAType", "NaTType")


@dataclass(frozen=True)
class Table:
    """Rows of cells under named columns."""

    source: str  # the file or table, for messages
    header: str  # where the columns' names are, for messages
    columns: tuple[str, ...]  # in capitals
    lines: Sequence[tuple[int, Sequence[Any]]]  # rows with their numbers, a cell per column
    local: bool = False  # numbers may be written as in some country: "1.200" may be 1200

    def rows(self) -> Iterator[Row]:
        """The rows; of columns of one name the last counts."""
        places = {name: place for place, name in enumerate(self.columns)}
        for row, cells in self.lines:
            yield Row(self.source, row, cells, places)

    def need(self, columns: Iterable[str], optional: Iterable[str] = ()) -> None:
        """Checks that the columns are there, and none of them twice.

        Raises:
            UserError: naming the column, and one that may be a misspelling of it.
        """
        columns = tuple(columns)
        for name in columns:
            if name not in self.columns:
                close = difflib.get_close_matches(name, self.columns, 1)
                found = ", ".join(self.columns)
                hint = f"is '{close[0]}' meant? rename it" if close else f"there are {found[:60]}"
                raise fault(self.header, f"column {name} is missing", hint)
        for name in (*columns, *optional):
            if self.columns.count(name) > 1:
                raise fault(self.header, f"column {name} is there twice", "remove one")


def checked_columns(where: str, names: Iterable[object]) -> tuple[str, ...]:
    """The names of columns in capitals; UserError if there are too many."""
    columns = tuple(" ".join(str(name).upper().split()) for name in names)
    if len(columns) > MOST_COLUMNS:
        raise fault(where, f"{len(columns):,} columns, more than {MOST_COLUMNS:,}: remove some")
    return columns


def write_table(path: Path, rows: Iterable[Sequence[object]]) -> None:
    """Writes a CSV file; the first row has the columns' names.

    A text that a spreadsheet would run as a formula gets an apostrophe before it, which says that
    it is a text.

    Raises:
        UserError: where it cannot be written.
    """
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([_inert(cell) for cell in row] for row in rows)
    write_text(path, text.getvalue())


def _inert(cell: object) -> object:
    if not isinstance(cell, str):
        return cell
    run = cell.startswith(FORMULA) or cell.lstrip().startswith(FORMULA)
    text = cell.replace("\r", " ")  # which readers take for the end of a row, in quotes or not
    return f"'{text}" if run else text


def table_from_columns(data: Any, source: str, first: int = 0) -> Table:
    """A table from a program.

    Args:
        data: a data frame (anything whose `to_dict("list")` gives columns), an Arrow table, a
            mapping of columns, a structured NumPy array or a list of mappings.
        source: what to call it in messages.
        first: the number of its first row.

    Raises:
        UserError: where it is none of them, or its columns are not equally long.
    """
    named = _named_columns(data, source)
    lists = {}
    for name, values in named.items():
        if isinstance(values, str | bytes | Mapping) or not hasattr(values, "__iter__"):
            raise fault(source, f"column {name}", f"{show(values)} is not a list of values")
        try:
            lists[name] = list(values)
        except TypeError as error:  # an array without an axis
            raise fault(source, f"column {name}", "not a list of values") from error
    lengths = {name: len(values) for name, values in lists.items()}
    if len(set(lengths.values())) > 1:
        found = ", ".join(f"{name} has {length}" for name, length in lengths.items())
        raise fault(source, f"columns of different lengths ({found[:60]})")
    columns = checked_columns(source, lists)
    return Table(
        source, source, columns, tuple(enumerate(zip(*lists.values(), strict=True), first))
    )


def _cells(column: Any) -> Any:
    """Of an Arrow column. Python's floats would show more digits than short ones have."""
    short = str(column.type) in ("halffloat", "float")
    return column.to_numpy(zero_copy_only=False) if short else column.to_pylist()


def _named_columns(data: Any, source: str) -> Mapping[Any, Any]:
    if isinstance(data, Mapping):
        return data
    try:
        if hasattr(data, "to_pydict"):  # Arrow's
            return {name: _cells(data[name]) for name in data.column_names}
        if hasattr(data, "to_dict"):
            columns = data.to_dict("list")
            if isinstance(columns, Mapping):
                return columns
    except TypeError:  # some other `to_dict`
        pass
    if isinstance(data, np.ndarray) and data.dtype.names:
        return {name: data[name] for name in data.dtype.names}
    if isinstance(data, Sequence) and all(isinstance(row, Mapping) for row in data):
        names = dict.fromkeys(name for row in data for name in row)
        return {name: [row.get(name) for row in data] for name in names}
    forms = "a data frame, a dict of columns, a structured array or a list of dicts"
    raise fault(source, f"{show(data)} is not a table", f"give {forms}")
