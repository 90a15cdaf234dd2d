"""Comparison tables for the terminal and for files."""

import io
from collections.abc import Sequence
from pathlib import Path

from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from jaxpack.comparison import Row
from jaxpack.io.atomic import replace_file

# Wang and Dong, Tables I and II: C, P, bins, ms per instance.
PaperRow = tuple[float, float, float, float]
PAPER: dict[tuple[tuple[int, int, int], int, tuple[int, int]], dict[str, PaperRow]] = {
    ((10, 1, 10), 40, (1, 5)): {
        "random": (0.832, 0.949, 4.646, 0.672),
        "volume": (0.894, 0.964, 4.307, 0.927),
        "brkga": (0.910, 0.990, 4.212, 832.715),
        "pointer": (0.929, 0.985, 4.203, 0.764),
    },
    ((10, 10, 10), 70, (2, 5)): {
        "random": (0.677, 0.929, 4.683, 37.075),
        "volume": (0.747, 0.964, 4.253, 44.323),
        "brkga": (0.769, 0.958, 4.088, 48463.754),
        "pointer": (0.791, 0.961, 4.078, 39.583),
    },
}


def paper_row(row: Row) -> PaperRow | None:
    """The paper's (C, P, bins, ms) for the row's method and cell, where the paper has one."""
    return PAPER.get((row.bin, row.items, row.sides), {}).get(row.method)


def comparison_table(rows: Sequence[Row]) -> Table:
    """Methods against metrics, one row each; the paper's figures to the right where it has some."""
    first = rows[0]
    grid = len({(row.items, row.bin, row.sides) for row in rows}) > 1
    with_errors = grid or first.seeds > 1
    with_paper = any(paper_row(row) for row in rows)
    count = f"{first.instances} instances" + (f" x {first.seeds} seeds" if first.seeds > 1 else "")
    table = Table(
        title=f"{count}, seed {first.seed}, timed in batches of {first.batch}",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        padding=(0, 1, 0, 0),
    )
    for name in (*(("items", "bin", "sides") if grid else ()), "method"):
        table.add_column(name, no_wrap=True)
    for name in ("C", "P", "bins", "gap %", "fill", "ms"):
        table.add_column(name, justify="right", no_wrap=True)
    for name in ("paper C/P/bins", "ms") if with_paper else ():
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*_cells(row, grid, with_errors, with_paper))
    if not grid:
        bound = f"{first.lower_bound:.3f}"
        table.caption = f"lower bound (volume): {bound} bins; fill: volume / used bins"
    return table


def _cells(row: Row, grid: bool, with_errors: bool, with_paper: bool) -> list[str]:
    def number(name: str) -> str:
        value = f"{getattr(row, name):.3f}"
        return f"{value} ±{row.standard_error[name]:.3f}" if with_errors else value

    place = [str(row.items), "x".join(map(str, row.bin)), f"{row.sides[0]}-{row.sides[1]}"]
    ours = [number(name) for name in ("compactness", "pyramid", "bins")]
    ours += [f"{row.gap * 100:.1f}", f"{row.utilisation:.3f}", _milliseconds(row.ms_per_instance)]
    paper = paper_row(row)
    theirs = ["/".join(f"{x:.3f}" for x in paper[:3]), _milliseconds(paper[3])] if paper else []
    return [*(place if grid else []), row.method, *ours, *(theirs if with_paper else [])]


def _milliseconds(value: float) -> str:
    return f"{value:.3f}" if value < 100 else f"{value:.0f}"


def print_table(console: Console, rows: Sequence[Row]) -> None:
    """Prints the comparison."""
    print_wide(console, comparison_table(rows))


def print_wide(console: Console, table: Table) -> None:
    """Prints a table, wider than the terminal rather than with figures cut off."""
    wide = Measurement.get(console, console.options.update(max_width=200), table).maximum
    console.width = max(console.width, wide)
    console.print(table)


def write_table(path: Path, rows: Sequence[Row]) -> None:
    """The table as plain text."""
    text = io.StringIO()
    print_table(Console(file=text, width=80), rows)
    with replace_file(path) as file:
        file.write(text.getvalue())
