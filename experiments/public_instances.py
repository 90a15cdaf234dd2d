"""Reads the public benchmark instances that PackingSolver's data folder holds, as JSON.

2D: the 500 instances of Berkey and Wang (1987) and Martello and Vigo (1998). 3D: the 47 of
Ivancic, Mathur and Mohanty (1989).
"""

import json
from pathlib import Path

from jaxpack.loading.job import ORIENTATIONS, BinType, ItemType, Job


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
