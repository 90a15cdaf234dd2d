"""Small orders that people asked packers about, whose right answers are known: which come out.

python experiments/small_orders.py [--seconds 5] [--cold] [--only TEXT]

Prints a line per order, what was wanted and what came out, and ends with exit code 1 if any is
wrong. Cold: each in a process of its own with an empty compilation cache, as after an install; the
seconds count from its start. Sides are x, y, z; *all*: six orientations, *up*: two.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from jaxpack.model.job import ORIENTATIONS, BinType, ItemType, Job
from jaxpack.search.portfolio import SolveOptions, solve_job
from jaxpack.search.record import Progress

ALL, UP, FLAT = tuple(ORIENTATIONS), ("XYZ", "YXZ"), ("XYZ", "ZYX")


@dataclass(frozen=True)
class Order:
    """A job and what has to be true of its plan."""

    job: Job
    wanted: str
    right: Callable[[Progress], bool]
    got: Callable[[Progress], object]
    seeds: tuple[int, ...] = (0,)


def things(*rows: tuple[float, ...], ways: tuple[str, ...] = ALL) -> tuple[ItemType, ...]:
    """Items of (x, y, z, copies) or (x, y, z, copies, weight)."""
    return tuple(
        ItemType((x, y, z), int(copies), float(*weight), ways) for x, y, z, copies, *weight in rows
    )


def rooms(*rows: tuple[float, ...]) -> tuple[BinType, ...]:
    """Bins of (x, y, z)."""
    return tuple(BinType((x, y, z)) for x, y, z in rows)


def sizes(found: Progress) -> list[tuple[float, ...]]:
    """Of the bins that are used, from small to large."""
    return sorted(found.job.bins[packed.bin].size for packed in found.plan.bins)


def packed(found: Progress) -> int:
    """How many items are."""
    return sum(len(one.placements) for one in found.plan.bins)


def in_bins(job: Job, *wanted: tuple[float, ...], seeds: tuple[int, ...] = (0,)) -> Order:
    """Into just these bins."""
    expected = sorted(tuple(map(float, size)) for size in wanted)
    return Order(job, f"{len(wanted)} of {wanted[0]}", lambda f: sizes(f) == expected, sizes, seeds)


def one_by_weight(weights: tuple[int, ...], limit: int, bins: int) -> Order:
    """As many bins as a one-dimensional packing by weight needs."""
    items = things(*((1, 1, 1, 1, weight) for weight in weights))
    job = Job(items, (BinType((1000, 1000, 1000), max_weight=limit),))
    return Order(job, f"{bins} bins", lambda f: f.bins == bins, lambda f: f.bins)


def orders() -> dict[str, Order]:
    """By name."""
    sheets, pieces = (BinType((889, 1, 1194)),), ((95, 1, 412, 9), (136, 1, 262, 18))
    container, pallet = (589, 233, 240), (1200, 800, 1300)
    cartons = ((410, 310, 310), (410, 310, 260), (410, 310, 205), (310, 310, 210),
               (310, 210, 210), (310, 210, 155), (210, 160, 105))  # fmt: skip
    small = (18, 7, 7), (24, 9, 9), (18, 14, 8), (36, 24, 12), (36, 24, 6), (8, 8, 4)
    two = (425, 250, 150), (415, 260, 285)
    larger = (240, 75, 160), (340, 180, 260)
    limits = (BinType((1000,) * 3, max_weight=5), BinType((1500,) * 3, max_weight=10))
    priced = (BinType((1200, 800, 1600), 10.0, 1), BinType((600, 400, 1600), 4.0, 3))
    panels = things((163, 62.5, 12.5, 222, 35), (148, 56, 13, 383, 30.6))
    labels = Job(things((150, 110, 5, 8928, 0.056)),
                 (BinType(pallet, copies=1, max_weight=500),), objective="value")  # fmt: skip
    value = Job(things((60, 40, 40, 400)), (BinType(container, copies=1),), objective="value")
    plain = {
        "three bars": (things((40, 30, 30, 3)), (90, 40, 30)),
        "slabs": (things((210, 80, 46, 2), (210, 80, 8, 1), (220, 110, 20, 1)), (292, 220, 46)),
        "boards": (things((90, 200, 200, 14), ways=UP), (250, 1360, 260)),
        "five bricks": (things((3, 1, 2, 5)), (6, 1, 5)),
        "tiles": (things((35, 35, 5, 10)), (40, 40, 40)),
        "beams": (things((200, 60, 50, 20)), (250, 250, 200)),
        "a pinwheel": (things((80, 120, 140, 4), ways=UP), (220, 210, 230)),
        "a full pallet": (things((40, 24, 60, 24)), (120, 80, 160)),
    }
    found = {name: in_bins(Job(goods, rooms(room)), room) for name, (goods, room) in plain.items()}
    found |= {
        "two of two": in_bins(
            Job(things((260, 198, 65, 2), (175, 122, 45, 2)), rooms(*two)), two[0]
        ),
        "long and small": in_bins(
            Job(things((4.5, 2, 3.5, 2), (17.5, 7, 7, 1), (15.5, 7, 7, 1)), rooms(*small)), small[2]
        ),
        "the larger one": in_bins(
            Job(things((70, 70, 95, 6), (95, 95, 75, 2)), rooms(*larger)), larger[1]
        ),
        "two limits of weight": in_bins(
            Job(things((1, 1, 1, 4, 3)), limits), limits[0].size, limits[1].size
        ),
        "small pieces on a sheet": in_bins(
            Job(things((24, 1, 18, 31), ways=FLAT), (BinType((114, 1, 120)),), 2), (114, 1, 120)
        ),
        "two kinds of pieces on a sheet": in_bins(
            Job(things(*pieces, ways=FLAT), sheets, 2), (889, 1, 1194), seeds=tuple(range(10))
        ),
        "a container's worth": Order(value, "318 or more", lambda f: packed(f) >= 318, packed),
        "least volume": Order(
            Job(things((150, 100, 100, 200)),
                tuple(BinType(size, size[0] * size[1] * size[2]) for size in cartons)),
            "330 million or less", lambda f: f.cost <= 330e6, lambda f: f.cost,
        ),
        "panels": in_bins(
            Job(panels, (BinType((1203, 235, 269), max_weight=19500),)), (1203, 235, 269)
        ),
        "cards": Order(labels, "all 8,928", lambda f: packed(f) == 8928, packed),
        "two prices": Order(
            Job(things((400, 300, 200, 30), (600, 400, 300, 10), ways=UP), priced),
            "a cost of 10", lambda f: f.cost == 10, lambda f: f.cost,
        ),
        # The weights are those of eight full bins.
        "weights alone": one_by_weight(
            (48, 30, 19, 36, 36, 27, 42, 42, 36, 24, 40, 28, 25, 33, 31, 46, 22, 14, 39, 41, 20,
             23, 49, 49), 100, 8,
        ),
        "weights alone, threes": one_by_weight(
            tuple(w for a, b in ((48, 30), (19, 36), (36, 27), (42, 24), (40, 28), (25, 33),
                                 (31, 46), (22, 41)) for w in (a, b, 100 - a - b)), 100, 8,
        ),
    }  # fmt: skip
    return {name: replace(one, job=replace(one.job, name=name)) for name, one in found.items()}


def line(name: str, order: Order, seed: int, seconds: float) -> bool:
    """Packs it, prints what came out, and says whether it is right."""
    began = time.perf_counter()
    found = solve_job(order.job, SolveOptions(seconds, seed))
    passed, right = time.perf_counter() - began, order.right(found)
    judged = "right" if right else f"WRONG: {order.got(found)}"
    seeded = f", seed {seed}" if len(order.seeds) > 1 else ""
    print(f"{name}{seeded}: {order.wanted} wanted, {judged}, {passed:.1f} s", flush=True)
    return right


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--cold", action="store_true")
    parser.add_argument("--only", default="", help="orders with this in their names")
    options = parser.parse_args()
    wrong = 0
    for name, order in orders().items():
        if options.only not in name:
            continue
        if not options.cold:
            wrong += sum(not line(name, order, seed, options.seconds) for seed in order.seeds)
            continue
        with tempfile.TemporaryDirectory() as cache:
            command = [sys.executable, __file__, "--only", name, "--seconds", str(options.seconds)]
            alone = os.environ | {"JAX_COMPILATION_CACHE_DIR": cache}
            wrong += subprocess.run(command, env=alone).returncode != 0
    raise SystemExit(int(wrong > 0))


if __name__ == "__main__":
    main()
