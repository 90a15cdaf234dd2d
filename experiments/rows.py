"""Tables of results as CSV files, written whole after every row: a killed run keeps its rows."""

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from jaxpack.io.atomic import replace_file

RESULTS = Path(__file__).parent / "results"


def read_rows(path: Path) -> list[dict[str, str]]:
    """The rows of an earlier run, none if there was none."""
    return list(csv.DictReader(path.read_text().splitlines())) if path.exists() else []


def write_rows(path: Path, rows: Iterable[dict[str, Any]], columns: Iterable[str] = ()) -> None:
    """Replaces the file; the columns are those of the first row if not given."""
    rows = list(rows)
    with replace_file(path) as file:
        table = csv.DictWriter(file, list(columns) or list(rows[0]), extrasaction="ignore")
        table.writeheader()
        table.writerows(rows)


def rounded(row: dict[str, Any]) -> dict[str, Any]:
    """The same for a reader."""
    return {k: round(v, 4) if isinstance(v, float) else v for k, v in row.items()}
