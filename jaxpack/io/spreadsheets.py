"""Tables from files as spreadsheets and programs write them: CSV of several countries, and .xlsx.

Where such a file has one meaning it is read, and what was assumed is said; where it has two, such
as "1.200" with semicolons between the fields, it is refused with both.
"""

import csv
import io
import re
import warnings
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from jaxpack.errors import UserError
from jaxpack.io.arrow import read_columns
from jaxpack.io.notes import Say, note, silent
from jaxpack.io.tables import MOST_ROWS, Table, checked_columns, table_from_columns
from jaxpack.io.texts import MOST_BYTES, read_bytes, read_text
from jaxpack.model.numbers import fault, show

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}
WORKBOOKS = (".xlsx", ".xlsm")
PARQUET = ".parquet"

_DIGITS = {  # what marks the decimals -> how a number is written then
    ".": re.compile(r"[+-]?(?:[1-9]\d{0,2}(?:,\d{3})+|\d+)?(?:\.\d*)?", re.ASCII),
    ",": re.compile(r"[+-]?(?:[1-9]\d{0,2}(?:\.\d{3})+|\d+)?(?:,\d*)?", re.ASCII),
}


def read_table(path: Path, say: Say = silent) -> Table:
    """A table whose first row names the columns; blank rows are skipped.

    Args:
        path: .xlsx, .parquet, or text with commas, semicolons or tabs between its fields. A row may
            end early, its last cells are empty then.
        say: takes a line for everything that was assumed.

    Raises:
        UserError: where it cannot be read or is not of that form. Rows count from 1, the header
            included, as in an editor.
    """
    if path.suffix.lower() == PARQUET:
        return table_from_columns(read_columns(path), str(path))
    if path.suffix.lower() in WORKBOOKS:
        separator, rows = "", _workbook_rows(path, say)
    else:
        separator, rows = _text_rows(path, read_text(path, say))
    columns: tuple[str, ...] = ()
    header = ""
    lines: list[tuple[int, Sequence[Any]]] = []
    for number, cells in _bounded(path, rows):
        if not any(map(_filled, cells)):
            continue
        if not header:
            header = f"{path}: row {number}"
            columns = checked_columns(header, ["" if cell is None else cell for cell in cells])
            continue
        if len(cells) != len(columns):
            cells = _fitted(path, number, cells, len(columns))
        lines.append((number, cells))
    if not header:
        raise fault(path, "no header: name the columns in the first row")
    if separator not in ("", ","):
        say(note(path, f"read with {SEPARATORS[separator]} between the fields"))
    return Table(str(path), header, columns, lines, local=separator != ",")


def _bounded(
    path: Path, rows: Iterable[tuple[int, Sequence[Any]]]
) -> Iterator[tuple[int, Sequence[Any]]]:
    """The rows; UserError if there are too many, blank ones included."""
    for number, cells in rows:
        if number > MOST_ROWS:
            raise fault(path, f"more than {MOST_ROWS:,} rows: split it")
        yield number, cells


def _filled(cell: object) -> bool:
    return bool(cell.strip()) if isinstance(cell, str) else cell is not None


def _fitted(path: Path, row: int, cells: Sequence[Any], count: int) -> Sequence[Any]:
    """The cells of a row, one for every column."""
    if any(map(_filled, cells[count:])):
        much = f"{len(cells)} fields, the header has {count}"
        raise fault(
            path,
            f"row {row}",
            much,
            "give every row as many, and quote fields that hold a separator",
        )
    return [*cells[:count], *[None] * (count - len(cells))]


def _text_rows(path: Path, text: str) -> tuple[str, Iterator[tuple[int, Sequence[Any]]]]:
    """What separates the fields, and every row with its number."""
    if match := re.match(r"sep=([,;\t])\r?\n", text):  # how some ask a spreadsheet to read it
        return match[1], _numbered(path, text[match.end() :], match[1], 2)
    separator = _separator(text)
    return separator, _numbered(path, text, separator, 1)


def _numbered(
    path: Path, text: str, separator: str, first: int
) -> Iterator[tuple[int, Sequence[Any]]]:
    lines = _fields(text, separator)
    row = first
    try:
        for cells in lines:
            # A quoted cell may go over several lines: a row is where it starts.
            yield row, cells
            row = first + lines.line_num
    except csv.Error as error:
        raise fault(path, f"row {row}", f"not CSV ({error}); check its quotes") from error


def _separator(text: str) -> str:
    """The one that cuts the first row into the most fields."""

    def count(separator: str) -> int:
        try:
            return max(len(next((row for row in _fields(text, separator) if any(row)), ())), 1)
        except csv.Error:
            return 0

    return max(SEPARATORS, key=count)


def _fields(text: str, separator: str) -> Any:
    lines = io.StringIO(text, newline="")
    return csv.reader(lines, delimiter=separator, strict=True, skipinitialspace=separator != "\t")


def _workbook_rows(path: Path, say: Say) -> Iterator[tuple[int, Sequence[Any]]]:
    """The rows of the first sheet that has any, with their numbers."""
    try:
        import openpyxl
    except ImportError as error:
        advice = "install it with pip install 'jaxpack[xlsx]', or save the file as CSV"
        raise fault(path, f"reading it takes openpyxl: {advice}") from error
    data = io.BytesIO(read_bytes(path))
    try:
        with zipfile.ZipFile(data) as parts:
            if sum(part.file_size for part in parts.infolist()) > 4 * MOST_BYTES:
                raise fault(path, "too large when it is unpacked: split it")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of charts and styles, which say nothing here
            book = openpyxl.load_workbook(data, read_only=True, data_only=True, keep_links=False)
            for sheet in book.worksheets:
                sheet.reset_dimensions()  # what it says of its size may be wrong
                # A row may say that it is the last of billions, the others are empty then.
                rows = _bounded(path, enumerate(sheet.iter_rows(values_only=True), 1))
                for first in rows:
                    if any(_filled(cell) for cell in first[1]):
                        if len(book.worksheets) > 1:
                            say(note(path, f"read from sheet {show(sheet.title)}"))
                        yield first
                        yield from rows
                        return
    except UserError:
        raise
    except Exception as error:  # of a damaged file openpyxl raises whatever it stumbles over
        reason = " ".join(str(error).split())[:80] or type(error).__name__
        raise fault(path, f"not a workbook ({reason}); save it anew, or as CSV") from error
    raise fault(path, "the file is empty: give a header and rows")


def plain_numbers(table: Table, columns: Iterable[str], say: Say = silent) -> Table:
    """The table with the numbers in those columns as programs write them.

    A cell has one meaning if another cannot be, or if the other cells of the file show what it
    marks decimals with.

    Raises:
        UserError: naming the cell that has two, and both.
    """
    places = [place for place, name in enumerate(table.columns) if name in set(columns)]
    known: dict[object, dict[str, str]] = {}  # what each text means: many are there often
    found = []
    for line, (_, cells) in enumerate(table.lines):
        for place in places:
            cell = cells[place]
            if isinstance(cell, str) and ("," in cell or "." in cell):
                if (meanings := known.get(cell)) is None:
                    meanings = known[cell] = _meanings(cell.strip())
                if meanings:
                    found.append((line, place, meanings))
    marks = {mark for meanings in known.values() if len(meanings) == 1 for mark in meanings}
    points = any(len(meanings) == 2 and "." in meanings["."] for meanings in known.values())
    if points and not table.local and "," not in marks:
        marks.add(".")  # as everywhere in files with commas between the fields
    lines = list(table.lines)
    for line, place, meanings in found:
        row, cells = lines[line]
        where = f"{table.source}: row {row}, column {table.columns[place]}"
        plain = _chosen(where, cells[place], meanings, marks)
        if plain != cells[place]:
            lines[line] = row, [*cells[:place], plain, *cells[place + 1 :]]
    if "," in marks:
        say(note(table.source, "read with decimal commas"))
    return replace(table, lines=lines)


def _chosen(where: str, text: str, found: dict[str, str], marks: set[str]) -> str:
    if len(found) == 1:
        return next(iter(found.values()))
    if len(marks) == 1:
        return found[next(iter(marks))]
    first, second = sorted(found.values(), key=len)
    raise fault(where, f"{show(text)} may be {first} or {second}", "write the one that is meant")


def _meanings(text: str) -> dict[str, str]:
    """What marks the decimals -> the number, of a text with a comma or a point in it."""
    if len(text) > 40 or not any(c.isdigit() for c in text):
        return {}
    found = {}
    for mark, written in _DIGITS.items():
        if written.fullmatch(text):
            found[mark] = text.replace("." if mark == "," else ",", "").replace(",", ".")
    if len(found) == 2 and float(found["."]) == float(found[","]):
        return {}
    return found
