"""Tables in Apache Parquet, by pyarrow, which the extra `arrow` installs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxpack.errors import UserError
from jaxpack.io.atomic import replace_file
from jaxpack.io.tables import write_table
from jaxpack.model.numbers import fault


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


def read_columns(path: Path) -> dict[str, list[Any]]:
    """All columns of a Parquet file."""
    file = opened(path)
    try:
        columns: dict[str, list[Any]] = file.read().to_pydict()
    except (OSError, arrow().ArrowException) as error:
        raise fault(path, f"is damaged: {first_line(error)}") from error
    return columns


def first_line(error: BaseException) -> str:
    """Of what an exception says."""
    return (str(error).splitlines() or [type(error).__name__])[0]


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
