"""What solve_public.py found, as the tables of the README.

python experiments/public_tables.py [--support 0.5]
"""

import argparse
import csv
from pathlib import Path

from rows import RESULTS, read_rows

DATA = Path(__file__).parent / "data"
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
    parser.add_argument("--support", type=float, default=0.5)
    support = parser.parse_args().support
    flat, solid, ivancic = (
        read_rows(RESULTS / f"solve-{name}-support-{support:g}.csv")
        for name in ("2bp", "mpv", "ivancic")
    )
    by_class(flat, {
        "bins": (flat, "bins"),
        "best known, free": (flat, "best_known"),
        "lower bound": (flat, "lower_bound"),
    })  # fmt: skip
    known = csv.DictReader((DATA / "3bp_mpv_lower_bounds.csv").read_text().splitlines())
    bounds = [row | {"cls": row["class"]} for row in known]
    by_class(solid, {"bins": (solid, "bins"), "L2": (bounds, "sum_mpv_l2")})
    bins, bound = (sum(int(row[name]) for row in ivancic) for name in ("bins", "lower_bound"))
    print(f"Ivancic: {bins} bins, bound {bound}, {len(ivancic)} instances")


if __name__ == "__main__":
    main()
