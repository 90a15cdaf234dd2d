"""The README's tables: our rows beside Wang and Dong's Tables I and II, as CSV.

python experiments/tables.py [2d] [3d]     (3 and 20 minutes on two cores)
"""

import csv
import sys
from pathlib import Path

from rich.console import Console

from jaxpack import Cell, Comparison, MethodOptions, Row, compare, make_method, preset
from jaxpack.cli import use_compilation_cache
from jaxpack.files.atomic import replace_file
from jaxpack.tables import paper_row, print_table

METHODS = ("random", "volume", "footprint", "height", "best-of-1000", "brkga", "pointer")
METHODS += ("bin-aware", "bin-aware-best-of-64", "bin-aware-beam-8", "brkga-seeded")
METHODS += ("bin-aware-search",)
RESULTS = Path(__file__).parent / "results"
COLUMNS = ("method", "source", "compactness", "pyramid", "bins", "utilisation", "gap")
COLUMNS += ("ms_per_instance", "lower_bound", "instances", "seed")


def rows_of(dimension: str) -> list[Row]:
    recipe = preset(f"paper-{dimension}")
    options = MethodOptions(kinds=recipe.kinds)
    comparison = Comparison(recipe.problem, instances=1000, seed=0)
    cell = Cell(recipe.problem.bin, recipe.distribution)
    rows = []
    for name in METHODS:
        rows += compare(comparison, name, make_method(name, recipe.problem, options), [cell])
        write_csv(RESULTS / f"table-{dimension}.csv", rows)
    return rows


def write_csv(path: Path, rows: list[Row]) -> None:
    with replace_file(path) as file:
        table = csv.DictWriter(file, COLUMNS, extrasaction="ignore")
        table.writeheader()
        for row in rows:
            table.writerow(row.record() | {"source": "jaxpack"})
            if paper := paper_row(row):
                names = ("compactness", "pyramid", "bins", "ms_per_instance")
                figures = dict(zip(names, paper, strict=True))
                table.writerow({"method": row.method, "source": "Wang and Dong"} | figures)


def main() -> None:
    use_compilation_cache()
    RESULTS.mkdir(exist_ok=True)
    for dimension in sys.argv[1:] or ("2d", "3d"):
        print_table(Console(), rows_of(dimension))


if __name__ == "__main__":
    main()
