"""Tables with named columns, from CSV files or from a program's own columns."""

import csv
import difflib
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxpack.files.texts import read_text, write_text
from jaxpack.loading.numbers import as_number, as_size, as_weight, as_whole, fault, plain, show


class Row(NamedTuple):
    """One row; its methods raise a UserError that names the row and the column."""

    where: str  # the table and the row's number, for messages
    cells: dict[str, Any]  # by column

    def at(self, column: str) -> str:
        """Where a cell is, for messages."""
        return f"{self.where}, column {column}"

    def number(self, column: str) -> float:
        """A finite number."""
        return as_number(self.cells[column], self.at(column))

    def size(self, column: str) -> float:
        """The length of a side."""
        return as_size(self.cells[column], self.at(column))

    def weight(self, column: str) -> float:
        """A weight; 0 without that column."""
        return as_weight(self.cells[column], self.at(column)) if column in self.cells else 0.0

    def whole(self, column: str, low: int, high: int | None = None) -> int:
        """A whole number within limits."""
        return as_whole(self.cells[column], self.at(column), low, high)

    def flag(self, column: str) -> bool:
        """0 or 1, or a bool."""
        value = self.cells[column]
        if isinstance(value, bool | np.bool_):
            return bool(value)
        return as_whole(value, self.at(column), 0, 1) == 1

    def given(self, column: str) -> bool:
        """Whether the column is there and the cell is not -1, which stands for no limit."""
        return column in self.cells and self.number(column) != -1

    def text(self, *columns: str) -> str:
        """The first of the columns that holds a text or a number; "" if none does."""
        for column in columns:
            value = self.cells.get(column)
            if value is None or (isinstance(value, float) and math.isnan(value)):
                continue  # NaN: how data frames leave a cell empty
            text = str(plain(value) if isinstance(value, float) else value).strip()
            if text:
                return text
        return ""


@dataclass(frozen=True)
class Table:
    """Rows of cells under named columns."""

    header: str  # where the columns' names are, for messages
    columns: tuple[str, ...]  # in capitals
    rows: tuple[Row, ...]

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


def read_table(path: Path) -> Table:
    """A CSV file: commas, the first row has the columns' names, blank rows are skipped.

    Raises:
        UserError: where it cannot be read or is not of that form. Rows count from 1, the header
            included, as in an editor.
    """
    lines = csv.reader(io.StringIO(read_text(path), newline=""), strict=True, skipinitialspace=True)
    header: list[str] = []
    place = ""
    rows = []
    start = 1
    try:
        for cells in lines:
            # A quoted cell may go over several lines: a row is where it starts.
            where, start = f"{path}: row {start}", lines.line_num + 1
            if not any(cell.strip() for cell in cells):
                continue
            if not header:
                place, header = where, [cell.strip().upper() for cell in cells]
                if wrong := [c for name in header for c in name if c in ";\t"]:
                    raise fault(where, f"wrong delimiter: use commas, not {wrong[0]!r}")
                continue
            if len(cells) != len(header):
                much = f"{len(cells)} fields, the header has {len(header)}"
                raise fault(
                    where, f"{much}: give every row as many, and quote fields that hold a comma"
                )
            rows.append(Row(where, dict(zip(header, cells, strict=True))))
    except csv.Error as error:
        raise fault(path, f"row {start}", f"not CSV ({error}); check its quotes") from error
    if not header:
        raise fault(path, "no header: name the columns in the first row")
    return Table(place, tuple(header), tuple(rows))


def write_table(path: Path, rows: Iterable[Sequence[object]]) -> None:
    """Writes a CSV file; the first row has the columns' names.

    Raises:
        UserError: where it cannot be written.
    """
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(rows)
    write_text(path, text.getvalue())


def table_from_columns(data: Any, source: str) -> Table:
    """A table from a program.

    Args:
        data: a data frame (anything whose `to_dict("list")` gives columns), a mapping of columns,
            a structured NumPy array or a list of mappings.
        source: what to call it in messages; its rows count from 0.

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
    columns = tuple(str(name).strip().upper() for name in lists)
    rows = zip(*lists.values(), strict=True)
    return Table(
        source,
        columns,
        tuple(
            Row(f"{source}: row {number}", dict(zip(columns, cells, strict=True)))
            for number, cells in enumerate(rows)
        ),
    )


def _named_columns(data: Any, source: str) -> Mapping[Any, Any]:
    if isinstance(data, Mapping):
        return data
    try:
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
