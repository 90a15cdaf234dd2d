"""Reads public benchmark instances from files of others; docs/data.md says where to get them.

2D: the 500 instances of Berkey and Wang (1987) and Martello and Vigo (1998). 3D: the 47 of
Ivancic, Mathur and Mohanty (1989), 35 of Bischoff and Ratcliff (1995), five orders of BED-BPP, and
2,144 mail orders of a bookshop.
"""

import argparse
import csv
import json
from pathlib import Path

from jaxpack.model.job import ORIENTATIONS, BinType, ItemType, Job

FOLDER = Path(__file__).parents[2] / "shared" / "data"
"""Where the files are looked for, beside the repository, unless --data names another folder."""

BERKEY_WANG = "2bp_berkey_wang_martello_vigo.json"
IVANCIC = "3bp_ivancic_thpack9.json"
BISCHOFF_RATCLIFF = "br_35.json"
BED_BPP = "bed_bpp_5_orders.json"
BOOKSHOP = "bookshop_orders.csv", "bookshop_cartons.csv"
MPV_BOUNDS = "3bp_mpv_lower_bounds.csv"


def add_data_option(parser: argparse.ArgumentParser) -> None:
    """Gives a script the option --data."""
    parser.add_argument("--data", type=Path, default=FOLDER, help="folder of the instances")


def data_file(folder: Path, name: str) -> Path:
    """The path of a file of instances; ends the script in one line where it is not there."""
    path = folder / name
    if not path.is_file():
        what = "docs/data.md says where it is published; name its folder with --data"
        raise SystemExit(f"error: {path}: no such file; {what}")
    return path


def read_2bp(path: str | Path) -> list[tuple[Job, dict[str, int]]]:
    """Every instance with what is known of it, no item may be turned.

    The keys are `cls`, `n` and `id`, the bounds `lb_area` and `lb_mv_l2`, and `bks`, the best
    known number of bins.
    """
    read = []
    for instance in json.loads(Path(path).read_text())["instances"]:
        sides = instance.pop("items")
        room = (instance.pop("W"), 1, instance.pop("H"))
        name = f"2bp-{instance['cls']}-{instance['n']}-{instance['id']}"
        items = tuple(ItemType((width, 1, height)) for width, height in sides)
        read.append((Job(items, (BinType(room),), dimension=2, name=name), instance))
    return read


def read_ivancic(path: str | Path) -> list[Job]:
    """Every instance, with the copies and the rotations that the file allows."""
    jobs = []
    for instance in json.loads(Path(path).read_text())["instances"]:
        items = []
        for values in instance["items"]:
            row = dict(zip(instance["cols"], values, strict=True))
            allowed = tuple(name for name in ORIENTATIONS if row[f"ROTATION_{name}"])
            size = (row["X"], row["Y"], row["Z"])
            items.append(ItemType(size, copies=row["COPIES"], orientations=allowed))
        jobs.append(Job(tuple(items), (BinType(tuple(instance["bin"])),), name=instance["name"]))
    return jobs


def read_bischoff_ratcliff(path: str | Path) -> list[Job]:
    """Every instance: one container, of which the greatest volume is to be filled."""
    jobs = []
    for instance in json.loads(Path(path).read_text()):
        items = tuple(
            ItemType(tuple(map(float, row["size"])), row["copies"], 0.0, tuple(row["rotations"]))
            for row in instance["items"]
        )
        room = BinType(tuple(map(float, instance["bin"])), copies=1)
        jobs.append(Job(items, (room,), objective="value", name=instance["name"]))
    return jobs


def read_bookshop(folder: Path) -> list[Job]:
    """The mail orders, turned in all ways, with their cartons, all at the same price."""

    def rows(name: str) -> list[dict[str, str]]:
        with data_file(folder, name).open(newline="") as file:
            return list(csv.DictReader(file))

    def sides(row: dict[str, str]) -> tuple[float, float, float]:
        return float(row["X"]), float(row["Y"]), float(row["Z"])

    of_orders, of_cartons = BOOKSHOP
    cartons = tuple(
        BinType(sides(row), cost=1.0, max_weight=float(row["MAXIMUM_WEIGHT"]))
        for row in rows(of_cartons)
    )
    orders: dict[str, list[ItemType]] = {}
    for row in rows(of_orders):
        item = ItemType(sides(row), int(row["COPIES"]), float(row["WEIGHT"]), tuple(ORIENTATIONS))
        orders.setdefault(row["ORDER"], []).append(item)
    return [Job(tuple(items), cartons, name=f"order {name}") for name, items in orders.items()]
