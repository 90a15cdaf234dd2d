"""jaxpack beside packvium 1.8.0 on rules of loads that both have, through both validators.

pip install 'jaxpack[peers]'
python experiments/rules_peers.py [--seconds 3] [--orders 12] [--only RULE ...]

Random orders of 20 to 60 items of 6 to 12 kinds, in millimetres and grams, for two to eight bins.
Each is solved by both in the same time, with three quarters of every base supported. packvium has
its profile `quality`, and once more its default where time ends before all is packed. Every plan is
checked by `jaxpack.check_plan` and by packvium: given as placements that are fixed, it is admitted
by the rules of its packer, and the result goes through `packvium.validate`. `docs/rules.md` says
how the rules of the two differ; the orders are such that they mean the same.

Adds a row per order to results/rules-peers.csv, leaving out those that are there, so that it goes
on where it was stopped, and writes the summary to results/rules-peers.md. On one core:
`taskset -c 0`.
"""

import argparse
import math
import random
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import packvium
from rows import RESULTS, read_rows, write_rows

import jaxpack
from jaxpack import (
    BinLimits,
    BinType,
    ItemLimits,
    ItemType,
    Job,
    Obstacle,
    PackedBin,
    Placement,
    Plan,
    Rules,
)
from jaxpack.io.atomic import replace_file
from jaxpack.model.figures import plan_figures
from jaxpack.model.job import ORIENTATIONS, UPRIGHT
from jaxpack.model.plan_check import plan_violations
from jaxpack.model.shelves import fits_one_bin

TABLE, SUMMARY = RESULTS / "rules-peers.csv", RESULTS / "rules-peers.md"
RULES = Rules(support=0.75, inclusive=True, stability="share")
GAP = 20.0  # mm, in the orders that have one
TICKS = 16_000  # of packvium, in a millimetre
LETTERS = str.maketrans("XYZ", "LWH"), str.maketrans("LWH", "XYZ")

Random = random.Random
Json = dict[str, Any]


# Orders.


def drawn(random: Random, ways: tuple[str, ...] = tuple(ORIENTATIONS)) -> list[ItemType]:
    """Kinds of items, with their copies."""
    kinds, count = random.randint(6, 12), random.randint(20, 60)
    copies = [1] * kinds
    for _ in range(count - kinds):
        copies[random.randrange(kinds)] += 1
    return [
        ItemType(
            tuple(10.0 * random.randint(10, 40) for _ in range(3)),
            number,
            100.0 * random.randint(5, 200),
            ways if random.random() < 0.7 else UPRIGHT,
        )
        for number in copies
    ]


def bin_for(random: Random, items: list[ItemType], flat: bool = False) -> BinType:
    """One of which they need two to six, by volume; by their footprints if they are `flat`."""
    volume = sum(math.prod(item.size) * item.copies for item in items)
    if flat:
        volume = sum(math.prod(item.size[:2]) * item.copies for item in items)
    share = volume / random.uniform(1.6, 4.2)
    side = math.sqrt(share) if flat else share ** (1 / 3)
    longest = max(max(item.size) for item in items)
    sides = [10.0 * math.ceil(max(side * part, longest) / 10) for part in (1.2, 0.9, 0.95)]
    return BinType((sides[0], sides[1], 400.0 if flat else sides[2]))


def limited(items: Iterable[ItemType], **limits: Callable[[ItemType], Any]) -> tuple[ItemType, ...]:
    """The same with these limits, each by a function of the item."""
    return tuple(
        replace(item, limits=ItemLimits(**{name: of(item) for name, of in limits.items()}))
        for item in items
    )


def plain(random: Random) -> Job:
    items = drawn(random)
    return Job(tuple(items), (bin_for(random, items),))


def with_limits(**limits: Callable[[Random, ItemType], Any]) -> Callable[[Random], Job]:
    def make(random: Random) -> Job:
        job = plain(random)
        bound = {name: lambda item, of=of: of(random, item) for name, of in limits.items()}
        return replace(job, items=limited(job.items, **bound))

    return make


def with_weights(random: Random) -> Job:
    job = plain(random)
    weight = sum(item.weight * item.copies for item in job.items)
    return replace(job, bins=(replace(job.bins[0], max_weight=100.0 * (weight // 280)),))


def with_few_items(random: Random) -> Job:
    job = plain(random)
    limits = BinLimits(most_items=-(-job.count // random.randint(3, 5)))
    return replace(job, bins=(replace(job.bins[0], limits=limits),))


def with_apart(random: Random) -> Job:
    """Some kinds of few copies, of which no two may be in one bin, for two reasons."""
    job = plain(random)
    few = sorted(range(len(job.items)), key=lambda n: job.items[n].copies)[:4]
    names = {n: "acid" if place % 2 else "alkali" for place, n in enumerate(few)}
    items = tuple(
        replace(item, copies=min(item.copies, 2), limits=ItemLimits(apart=names[n]))
        if n in names
        else item
        for n, item in enumerate(job.items)
    )
    return replace(job, items=items)


def with_groups(random: Random) -> Job:
    """Groups of two kinds that fit one bin by the rule of `fits_one_bin`."""
    while True:
        job = plain(random)
        pairs = [(0, 1), (2, 3), (4, 5)]
        names = {n: f"shop {number}" for number, pair in enumerate(pairs) for n in pair}
        items = tuple(
            replace(item, copies=min(item.copies, 4), limits=ItemLimits(group=names.get(n, "")))
            if n in names
            else item
            for n, item in enumerate(job.items)
        )
        job = replace(job, items=items)
        if all(fits_one_bin(job, pair, job.bins[0], RULES) for pair in pairs):
            return job


def with_gap(random: Random) -> Job:
    """Items so high that none fits on another one: upwards a clearance is something else."""
    items = [
        replace(item, size=(*item.size[:2], 10.0 * random.randint(21, 40)))
        for item in drawn(random, UPRIGHT)
    ]
    return Job(tuple(items), (bin_for(random, items, flat=True),))


def with_pillar(random: Random) -> Job:
    """From the floor to the ceiling: what lies on an obstacle is carried here, but not there."""
    job = plain(random)
    x, y, z = job.bins[0].size
    length, width = 80.0, 120.0
    corner = 10.0 * random.randint(0, int(x - length) // 10), random.choice((0.0, y)), 0.0
    limits = BinLimits(obstacles=(Obstacle(corner, (length, width, z)),))
    return replace(job, bins=(BinType((x, y + width, z), limits=limits),))


def with_prices(random: Random) -> Job:
    job = plain(random)
    x, y, z = job.bins[0].size
    small = tuple(10.0 * (side * 0.8 // 10) for side in (x, y, z))
    small = tuple(max(a, max(max(item.size) for item in job.items)) for a in small)
    sizes = (x, y, z), small
    bins = tuple(BinType(size, round(math.prod(size) / 1e5 + 300)) for size in sizes)
    return replace(job, bins=bins)


@dataclass(frozen=True)
class Case:
    """Orders with a rule."""

    make: Callable[[Random], Job]
    rules: Rules = RULES
    access: tuple[str, ...] = ()  # of packvium's containers


CASES = {
    "weight": Case(with_weights),
    "whole base": Case(plain, replace(RULES, support=1.0)),
    "stackable": Case(with_limits(stackable=lambda random, item: random.random() < 0.6)),
    "weight above": Case(
        with_limits(weight_above=lambda random, item: item.weight * random.choice((0.5, 1, 2, 4)))
    ),
    "floor": Case(with_limits(floor=lambda random, item: random.random() < 0.3)),
    "stack id": Case(with_limits(stack_id=lambda random, item: random.randint(1, 3))),
    "apart": Case(with_apart),
    "group": Case(with_groups),
    "most items": Case(with_few_items),
    "gap": Case(with_gap, replace(RULES, gap=GAP)),
    "obstacle": Case(with_pillar),
    "stops, from above": Case(
        with_limits(stop=lambda random, item: random.randint(1, 3)), access=("+z",)
    ),
    "stops, door x": Case(
        with_limits(stop=lambda random, item: random.randint(1, 3)),
        replace(RULES, door="x"),
        ("+x",),
    ),
    "price": Case(with_prices),
}


# The same for packvium. There a clearance surrounds every item, also at the walls, the floor and
# what it lies on: bins are larger by it at all ends.


def request_of(job: Job, case: Case, seconds: float) -> Json:
    clearance = case.rules.gap / 2
    configuration = {
        "alternatives": 1,
        "time_limit_ms": round(seconds * 1000),
        "minimum_support_ratio": case.rules.support,
        "clearance": f"{clearance:g}",
        "objective": "lowest_cost" if job.priced else "default",
    }
    return {
        "items": [item_of(number, item) for number, item in enumerate(job.items)],
        "containers": [bin_of(number, bin, case) for number, bin in enumerate(job.bins)],
        "configuration": configuration,
    }


def sides_of(size: Iterable[float], more: float = 0) -> Json:
    names = ("length", "width", "height")
    return {name: f"{side + more:g}" for name, side in zip(names, size, strict=True)}


def item_of(number: int, item: ItemType) -> Json:
    limits, stack = item.limits, f"stack {item.limits.stack_id}"
    asked = {
        "max_top_load": None if limits.weight_above == math.inf else round(limits.weight_above),
        "must_be_on_floor": limits.floor or None,
        "stackable": None if limits.stackable else False,
        "stop_index": None if limits.stop is None else limits.stop - 1,
        "group": limits.group or None,
        "tags": [limits.apart] if limits.apart else None,
        "incompatible_tags": [limits.apart] if limits.apart else None,
        "stacking_group": stack if limits.stack_id else None,
        "accepts_stacking_groups": [stack] if limits.stack_id else None,
    }
    return {
        "id": str(number),
        "quantity": item.copies,
        "weight": round(item.weight),
        "dimensions": sides_of(item.size),
        "allowed_rotations": [way.translate(LETTERS[0]) for way in item.orientations],
        **{name: value for name, value in asked.items() if value is not None},
    }


def bin_of(number: int, bin: BinType, case: Case) -> Json:
    asked = {
        "max_payload": None if bin.max_weight == math.inf else round(bin.max_weight),
        "max_items": bin.limits.most_items,
        "cost_minor": None if bin.cost is None else round(bin.cost),
        "access_directions": list(case.access) or None,
        "obstacles": [
            {"id": str(n), "origin": point(one.corner), "dimensions": sides_of(one.size)}
            for n, one in enumerate(bin.limits.obstacles)
        ]
        or None,
    }
    return {
        "id": str(number),
        "inner_dimensions": sides_of(bin.size, case.rules.gap),
        **{name: value for name, value in asked.items() if value is not None},
    }


def point(corner: Iterable[float], more: float = 0) -> Json:
    return {axis: f"{side + more:g}" for axis, side in zip("xyz", corner, strict=True)}


def request_with(request: Json, plan: Plan, case: Case) -> Json:
    """The same with a plan for it, every item of which is fixed."""
    fixed, instances = [], defaultdict[int, int](int)
    for packed in plan.bins:
        instances[packed.bin] += 1
        fixed += [
            {
                "item_type": str(put.item),
                "container_type": str(packed.bin),
                "container_instance": instances[packed.bin],
                "orientation": put.orientation.translate(LETTERS[0]),
                "position": point(put.corner, case.rules.gap / 2),
            }
            for put in packed.placements
        ]
    return request | {"fixed_placements": fixed}


def plan_of(job: Job, result: Json, case: Case) -> Plan:
    bins = []
    for container in result["containers"]:
        puts = []
        for put in container["placements"]:
            corner = [put["position"][axis]["ticks"] / TICKS - case.rules.gap / 2 for axis in "xyz"]
            way = put["orientation"].translate(LETTERS[1])
            puts.append(Placement(int(put["item_type"]), way, tuple(corner)))
        bins.append(PackedBin(int(container["container_type"]), loaded(job, puts, case)))
    left = tuple(int(one["item_type"]) for one in result["unpacked_items"])
    return Plan(tuple(bins), left)


def loaded(job: Job, puts: list[Placement], case: Case) -> tuple[Placement, ...]:
    """In an order of loading: what can be taken out first is the last one."""
    if not case.rules.door:
        return tuple(sorted(puts, key=lambda put: put.corner[2]))
    boxes = [(put, put.corner, tuple(np.add(put.corner, size(job, put)))) for put in puts]
    last = []
    while boxes:
        free = [one for one in boxes if not any(in_its_way(one, other) for other in boxes)]
        last.append((free or boxes)[0])
        boxes.remove(last[-1])
    return tuple(put for put, _, _ in reversed(last))


def size(job: Job, put: Placement) -> tuple[float, float, float]:
    return job.items[put.item].turned(put.orientation)


def in_its_way(one: tuple, other: tuple) -> bool:
    """Whether the other lies on it, or stands between it and the door."""
    (_, low, high), (_, begin, end) = one, other
    x, y, z = (a < d and c < b for a, b, c, d in zip(low, high, begin, end, strict=True))
    return (x and y and begin[2] == high[2]) or (y and z and begin[0] >= high[0])


# Verdicts and rows.


def our_verdict(job: Job, plan: Plan, case: Case) -> str:
    return " ".join(sorted({one.rule.value for one in plan_violations(job, plan, case.rules)}))


def packed_there(request: Json) -> Json:
    """By the profile that searches most; if its time ends before all is packed, by the default."""
    for profile in ("quality", "balanced"):
        configuration = request["configuration"] | {"solver_profile": profile}
        result = packvium.pack_from_dict(request | {"configuration": configuration})
        if result["complete"]:
            break
    return result


def their_verdict(request: Json, plan: Plan, case: Case) -> str:
    """By the rules of its packer, and by its validator."""
    fixed = request_with(request, plan, case)
    try:
        result = packvium.pack_from_dict(fixed)
    except packvium.InvalidRequestError as error:
        return f"packer: {error.detail}"
    return codes(packvium.validate(fixed, result))


def codes(issues: Iterable[packvium.Issue]) -> str:
    return " ".join(sorted({issue.code for issue in issues}))


def row_of(name: str, number: int, seconds: float) -> Json:
    case = CASES[name]
    job = case.make(Random(f"{name} {number}"))
    request = request_of(job, case, seconds)
    began = time.perf_counter()
    ours = jaxpack.solve(job, time_limit=seconds, **vars(case.rules))
    between = time.perf_counter()
    result = packed_there(request)
    ended = time.perf_counter()
    theirs = plan_of(job, result, case)
    figures = ours.figures, plan_figures(job, theirs)
    return {
        "rule": name,
        "order": number,
        "items": job.count,
        "bound": ours.bound,
        "bins": figures[0].bins,
        "bins_packvium": figures[1].bins,
        "cost": round(figures[0].cost) if job.priced else "",
        "cost_packvium": round(figures[1].cost) if job.priced else "",
        "left_out_packvium": len(theirs.left_out),
        "seconds": round(between - began, 2),
        "seconds_packvium": round(ended - between, 2),
        "ours_here": our_verdict(job, ours.plan, case),
        "ours_there": their_verdict(request, ours.plan, case),
        "theirs_here": our_verdict(job, theirs, case),
        "theirs_there": codes(packvium.validate(request, result)),
    }


COLUMNS = ("rule", "orders", "bins", "packvium", "better, worse", "bound", "left out by packvium")
COLUMNS += ("refused: ours there", "theirs here", "theirs there", "s", "packvium's")
REFUSED = "ours_there", "theirs_here", "theirs_there"
SECONDS = "seconds", "seconds_packvium"


def summary(rows: list[dict]) -> Iterator[str]:
    """A line of markdown per rule."""
    yield f"| {' | '.join(COLUMNS)} |"
    yield f"|{'---|' * len(COLUMNS)}"
    for name in CASES:
        own = [row for row in rows if row["rule"] == name]
        if not own:
            continue
        key = "cost" if name == "price" else "bins"
        pairs = [(float(row[key]), float(row[f"{key}_packvium"])) for row in own if packed(row)]
        ours, theirs = map(sum, zip(*pairs, strict=True))
        fields = [
            name if key == "bins" else f"{name}: cost",
            len(own),
            f"{ours:.0f}",
            f"{theirs:.0f}",
            f"{sum(a < b for a, b in pairs)}, {sum(a > b for a, b in pairs)}",
            sum(int(row["bound"]) for row in own if packed(row)) if key == "bins" else "",
            left_out(own),
            *(sum(row[column] != "" for row in own) for column in REFUSED),
            *(f"{sum(float(row[column]) for row in own) / len(own):.1f}" for column in SECONDS),
        ]
        yield f"| {' | '.join(map(str, fields))} |"


def packed(row: dict) -> bool:
    """Whether packvium packed all: bins are compared then."""
    return int(row["left_out_packvium"]) == 0


def left_out(rows: list[dict]) -> str:
    some = [int(row["left_out_packvium"]) for row in rows if not packed(row)]
    return f"{sum(some)} of {len(some)} orders" if some else ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--orders", type=int, default=12)
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES))
    options = parser.parse_args()
    rows: list[dict] = list(read_rows(TABLE))
    done = {(row["rule"], int(row["order"])) for row in rows}
    for name in options.only:
        for number in range(options.orders):
            if (name, number) not in done:
                rows.append(row_of(name, number, options.seconds))
                print(rows[-1], flush=True)
                write_rows(TABLE, rows)
    with replace_file(SUMMARY) as file:
        file.write("\n".join(summary(rows)) + "\n")
    print("\n".join(summary(rows)))


if __name__ == "__main__":
    main()
