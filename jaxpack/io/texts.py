"""Text and JSON: read so that every error says where it is, and written.

Whatever is wrong comes out as a `UserError` of one line: where, what, and what to do.
"""

import codecs
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from jaxpack.io.atomic import replace_file
from jaxpack.io.notes import Say, note
from jaxpack.model.numbers import as_number, as_whole, fault, show

MOST_BYTES = 2**26  # of a file


def read_bytes(path: Path) -> bytes:
    """What a file holds.

    Raises:
        UserError: where it cannot be read or is too large.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a path with a NUL in it
        reason = getattr(error, "strerror", None) or error
        raise fault(path, f"cannot be read ({reason}); give a file that can") from error
    if len(data) > MOST_BYTES:
        raise fault(path, f"more than {MOST_BYTES >> 20} MiB: split it")
    return data


def read_text(path: Path, say: Say | None = None) -> str:
    """The text of a file: UTF-8, or UTF-16 with a byte order mark.

    Args:
        path: the file.
        say: takes a note if it is neither, but the Windows-1252 that old spreadsheets write;
            not given, that is an error.

    Raises:
        UserError: where it cannot be read, is too large, empty or no such text.
    """
    data = read_bytes(path)
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        row = data.count(b"\n", 0, error.start) + 1
        wrong = fault(path, f"row {row}", "not UTF-8 text; save it as UTF-8 text")
        if say is None or wide or b"\0" in data:
            raise wrong from error
        try:
            text = data.decode("cp1252")
        except UnicodeDecodeError:
            raise wrong from error
        (line,) = text.split("\n")[row - 1 : row]
        say(note(path, f"not UTF-8, read as Windows-1252: row {row} is {show(line.strip())}"))
    if "\0" in text:
        row = text.count("\n", 0, text.index("\0")) + 1
        raise fault(path, f"row {row}", "a NUL byte, not text; save it as UTF-8 text")
    if not text.strip():
        raise fault(path, "the file is empty: give a header and rows")
    return text


def write_text(path: Path, text: str) -> None:
    """Writes a UTF-8 file, whole or not at all.

    Raises:
        UserError: where it cannot be written.
    """
    if not path.name:
        raise fault(path, "names no file: give one")
    with replace_file(path, "wb") as file:
        # Half a character, which JSON can name but UTF-8 cannot, becomes its JSON escape.
        file.write(text.encode("utf-8", "backslashreplace"))


def read_json(path: Path) -> Any:
    """What a JSON file holds.

    Raises:
        UserError: where it cannot be read or is not JSON, a key that is there twice included.
    """
    return parse_json(read_text(path), path)


def parse_json(text: str, source: object, constant: Callable[[str], object] | None = None) -> Any:
    """What a text in JSON holds.

    Args:
        text: the text.
        source: what messages call it.
        constant: makes a value of NaN and Infinity, which JSON does not have, or raises a
            ValueError; not given, they are floats.

    Raises:
        UserError: where it is not JSON, a key that is there twice included.
    """
    try:
        return json.loads(text, object_pairs_hook=_each_once, parse_constant=constant)
    except json.JSONDecodeError as error:
        place = f"row {error.lineno}, column {error.colno}"
        raise fault(source, place, f"not JSON ({error.msg}); correct it") from error
    except (ValueError, RecursionError) as error:  # too long a number, too deep a nesting
        raise fault(source, f"cannot be read as JSON ({error}); correct it") from error


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    # `json` keeps the last of two equal keys: items would be lost without a word.
    table: dict[str, Any] = {}
    for key, value in pairs:
        if key in table:
            raise ValueError(f"key {show(key)} is there twice")
        table[key] = value
    return table


def member(data: Any, key: str, kind: type, where: str) -> Any:
    """`data[key]`, a value of that kind, from JSON.

    Raises:
        UserError: where `data` is no object, or its key is missing or of another kind.
    """
    if not isinstance(data, dict):
        raise fault(where, f"expected an object with key '{key}', found {show(data)}")
    if key not in data:
        raise fault(where, f"key '{key}' is missing: add it")
    if not isinstance(data[key], kind):
        name = {"dict": "an object", "list": "a list", "str": "a text"}[kind.__name__]
        raise fault(where, f"key '{key}'", f"expected {name}, found {show(data[key])}")
    return data[key]


def member_index(data: Any, key: str, count: int, where: str) -> int:
    """`data[key]`, a whole number from 0 and below `count`; UserError if not."""
    return as_whole(member(data, key, object, where), f"{where}, key '{key}'", 0, count - 1)


def member_vector(data: Any, key: str, where: str) -> tuple[float, float, float]:
    """`data[key]`, a list of three finite numbers; UserError if not."""
    values = member(data, key, list, where)
    if len(values) != 3:
        raise fault(where, f"key '{key}'", f"{len(values)} numbers: give one for x, y and z each")
    x, y, z = (as_number(value, f"{where}, key '{key}'") for value in values)
    return x, y, z


def json_line(value: object) -> str:
    """A value as JSON in one line."""
    return json.dumps(value, ensure_ascii=False)


def json_lines(values: Iterable[str], indent: str) -> str:
    """A JSON list with a line for each of its values, which are JSON already."""
    rows = [f"\n{indent}{value}" for value in values]
    return f"[{','.join(rows)}]"
