"""What solve_public.py found, as the tables of docs/benchmarks.md.

python experiments/public_tables.py [--data FOLDER]
"""

import argparse
import csv

from public_instances import MPV_BOUNDS, add_data_option, data_file
from rows import RESULTS, read_rows

SUPPORTS = {"more than half": "0.5", "any support": "0"}
Rows = list[dict[str, str]]


def by_class(found: Rows, columns: dict[str, tuple[Rows, str]]) -> None:
    """A line per class and one for all; `columns`: heading -> rows and what of them to add up."""
    header = ["class", "instances", *columns]
    print("| " + " | ".join(header) + " |\n" + "|" + "---|" * len(header))
    classes = sorted({row["cls"] for row in found}, key=int)
    for name, wanted in [*((cls, {cls}) for cls in classes), ("all", set(classes))]:
        count = sum(row["cls"] in wanted for row in found)
        sums = [
            sum(int(row[column]) for row in rows if row["cls"] in wanted)
            for rows, column in columns.values()
        ]
        print(f"| {name} | {count} | " + " | ".join(map(str, sums)) + " |")
    print()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_data_option(parser)
    bounds_file = data_file(parser.parse_args().data, MPV_BOUNDS)
    flat, solid = (
        {
            rule: read_rows(RESULTS / f"solve-{name}-support-{support}.csv")
            for rule, support in SUPPORTS.items()
        }
        for name in ("2bp", "mpv")
    )
    half = flat["more than half"]
    by_class(half, {
        **{f"bins, {rule}": (rows, "bins") for rule, rows in flat.items()},
        "best known, free": (half, "best_known"),
        "lower bound": (half, "lower_bound"),
    })  # fmt: skip
    known = csv.DictReader(bounds_file.read_text().splitlines())
    bounds = [row | {"cls": row["class"]} for row in known]
    by_class(solid["more than half"], {
        **{f"bins, {rule}": (rows, "bins") for rule, rows in solid.items()},
        "L2": (bounds, "sum_mpv_l2"),
    })  # fmt: skip
    for what in ("support-0.5", "support-0.5-1s", "support-1"):
        rows = read_rows(RESULTS / f"solve-ivancic-{what}.csv")
        bins, bound = (sum(int(row[name]) for row in rows) for name in ("bins", "lower_bound"))
        print(f"Ivancic, {what}: {bins} bins, bound {bound}, {len(rows)} instances")


if __name__ == "__main__":
    main()
