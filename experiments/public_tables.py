"""What solve_public.py found, as the tables of the README.

python experiments/public_tables.py [--data experiments/data]
"""

import argparse
import csv
from collections.abc import Callable
from pathlib import Path

from rows import RESULTS, read_rows

Rows = list[dict[str, str]]


def results(name: str) -> Rows:
    return read_rows(RESULTS / f"solve-{name}.csv")


def total(rows: Rows, column: str, keep: Callable[[dict[str, str]], bool] | None = None) -> int:
    return sum(int(row[column]) for row in rows if keep is None or keep(row))


def table(header: list[str], lines: list[list[object]]) -> None:
    print("| " + " | ".join(header) + " |")
    print("|" + "---|" * len(header))
    for line in lines:
        print("| " + " | ".join(map(str, line)) + " |")
    print()


def two_dimensional() -> None:
    with_support, without = results("2bp-support-0.5"), results("2bp-support-0")
    lines: list[list[object]] = []
    for cls in [*map(str, range(1, 11)), ""]:

        def here(row: dict[str, str], cls: str = cls) -> bool:
            return row["cls"] == cls or not cls

        lines.append([
            cls or "all",
            total(with_support, "bins", here),
            total(without, "bins", here),
            total(with_support, "best_known", here),
            total(with_support, "lower_bound", here),
        ])  # fmt: skip
    table(["class", "support 0.5", "support 0", "best known, free", "bound"], lines)
    print(f"{len(with_support)} and {len(without)} instances")


def three_dimensional(data: Path) -> None:
    with_support, without = results("mpv-support-0.5"), results("mpv-support-0")
    bounds = list(csv.DictReader((data / "3bp_mpv_lower_bounds.csv").read_text().splitlines()))
    lines: list[list[object]] = []
    for cls in ["1", "4", "5", "6", "7", "8", ""]:

        def here(row: dict[str, str], cls: str = cls) -> bool:
            known = row.get("cls", row.get("class"))
            return known == cls or (not cls and known in ("1", "4", "5", "6", "7", "8"))

        lines.append([
            cls or "all",
            total(with_support, "bins", here),
            total(without, "bins", here),
            total(bounds, "sum_mpv_l2", here),
        ])  # fmt: skip
    table(["class", "support 0.5", "support 0", "L2 bound"], lines)
    print(f"{len(with_support)} and {len(without)} instances")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path("experiments/data"))
    options = parser.parse_args()
    two_dimensional()
    three_dimensional(options.data)
    rows = results("ivancic-support-0.5")
    print(f"Ivancic: {total(rows, 'bins')} bins, bound {total(rows, 'lower_bound')}, {len(rows)}")


if __name__ == "__main__":
    main()
