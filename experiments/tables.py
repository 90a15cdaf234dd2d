"""The tables of docs/benchmarks.md: our rows beside Wang and Dong's Tables I and II, as CSV.

python experiments/tables.py 2d|3d [METHOD ...]     (4 and 15 minutes on two cores)

Given methods, runs those and keeps the other rows of the file.
"""

import sys
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rows import RESULTS, read_rows, write_rows

from jaxpack import Cell, Comparison, MethodOptions, compare, make_method, preset
from jaxpack.cli import prepare_jax
from jaxpack.comparison import Row
from jaxpack.tables import paper_row, print_table

METHODS = ("random", "volume", "footprint", "height", "best-of-1000", "brkga", "pointer")
METHODS += ("bin-aware", "bin-aware-best-of-64", "bin-aware-beam-8", "brkga-seeded")
METHODS += ("bin-aware-search", "bin-aware-search-larger")
LARGER = MethodOptions(draws=16, breeding=40)  # of its search: up to a second an instance in 3D
COLUMNS = ("method", "source", "compactness", "pyramid", "bins", "utilisation", "gap")
COLUMNS += ("ms_per_instance", "lower_bound", "instances", "seed")


def rows_of(dimension: str, methods: tuple[str, ...]) -> list[Row]:
    recipe = preset(f"paper-{dimension}")
    comparison = Comparison(recipe.problem, instances=1000, seed=0)
    cell = Cell(recipe.problem.bin, recipe.distribution)
    path = RESULTS / f"table-{dimension}.csv"
    rows = {row.method: row for row in read_csv(path, cell) if row.method not in methods}
    for name in methods:
        chosen = LARGER if name.endswith("-larger") else MethodOptions()
        options = replace(chosen, kinds=recipe.kinds)
        method = make_method(name.removesuffix("-larger"), recipe.problem, options)
        (rows[name],) = compare(comparison, name, method, [cell])
        write_csv(path, [rows[name] for name in METHODS if name in rows])
    return [rows[name] for name in METHODS if name in rows]


def read_csv(path: Path, cell: Cell) -> list[Row]:
    """Our rows of an earlier run."""
    d, rows = cell.distribution, []
    for line in read_rows(path):
        if line.pop("source") == "jaxpack":
            name = line.pop("method")
            values = {key: float(value) for key, value in line.items()}
            values |= {key: int(values[key]) for key in ("instances", "seed")}
            place = {"items": d.items, "bin": cell.bin, "sides": (d.low, d.high)}
            rows.append(Row(method=name, batch=100, seeds=1, **place, **values))
    return rows


def write_csv(path: Path, rows: list[Row]) -> None:
    lines = []
    for row in rows:
        lines.append(row.record() | {"source": "jaxpack"})
        if paper := paper_row(row):
            names = ("compactness", "pyramid", "bins", "ms_per_instance")
            figures = dict(zip(names, paper, strict=True))
            lines.append({"method": row.method, "source": "Wang and Dong"} | figures)
    write_rows(path, lines, COLUMNS)


def main() -> None:
    prepare_jax()
    RESULTS.mkdir(exist_ok=True)
    dimension, *names = sys.argv[1:]
    print_table(Console(), rows_of(dimension, tuple(names) or METHODS))


if __name__ == "__main__":
    main()
