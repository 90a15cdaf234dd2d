"""Tables in Apache Parquet, by pyarrow, which the extra `arrow` installs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxpack.errors import UserError
from jaxpack.io.atomic import replace_file
from jaxpack.io.tables import write_table
from jaxpack.model.numbers import fault

WHOLE = ("BIN", "STEP", "ITEM", "BINS", "BOUND", "ITEMS", "LEFT_OUT", "PACKINGS")
REAL = ("X", "Y", "Z", "LX", "LY", "LZ", "COST", "GAP", "FILL")
"""Columns of results that are numbers; the others are texts."""


def arrow() -> Any:
    """The module pyarrow, with its Parquet.

    Raises:
        UserError: where it is not installed.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise UserError("Parquet: install pyarrow, pip install 'jaxpack[arrow]'") from None
    return pyarrow


def opened(path: Path) -> Any:
    """A Parquet file, of which only what it says of itself is read.

    Raises:
        UserError: where it cannot be read.
    """
    pa = arrow()
    try:
        return pa.parquet.ParquetFile(path)
    except (OSError, pa.ArrowException) as error:
        raise fault(path, f"is no Parquet file that can be read: {first_line(error)}") from error


def read_columns(path: Path) -> Any:
    """All columns of a Parquet file, as an Arrow table."""
    file = opened(path)
    try:
        return file.read()
    except (OSError, arrow().ArrowException) as error:
        raise fault(path, f"is damaged: {first_line(error)}") from error


def first_line(error: BaseException) -> str:
    """Of what an exception says."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def typed(columns: Mapping[str, Sequence[Any]]) -> Any:
    """Columns of results as an Arrow table, of the same types whatever is in them."""
    pa = arrow()
    types = {**dict.fromkeys(WHOLE, pa.int64()), **dict.fromkeys(REAL, pa.float64())}
    schema = pa.schema([(name, types.get(name, pa.string())) for name in columns])
    return pa.table(dict(columns), schema)


def write_columns(path: Path, columns: Mapping[str, Sequence[Any]]) -> None:
    """Writes a table: .parquet, or else CSV.

    Raises:
        UserError: where it cannot be written.
    """
    if path.suffix.lower() != ".parquet":
        write_table(path, [tuple(columns), *zip(*columns.values(), strict=True)])
        return
    pa = arrow()
    with replace_file(path, "wb") as file:
        pa.parquet.write_table(pa.table(dict(columns)), file)
