"""Other packers beside jaxpack on the same public instances, through one check and one audit.

pip install 'jaxpack[peers]'
python experiments/peers.py [--data FOLDER] [--seconds 5] [--only TEXT] [--methods NAME ...]

Adds a row per method and instance to results/peers.csv, leaving out those that have one, so that
it goes on where it was stopped, and prints the summary as markdown. Best on a quiet machine.

Instances: of each 2D class 1-10 the first of 20 and of 60 items, Ivancic's 1 to 8 and the five
orders of BED-BPP. A peer that is not installed is left out. No peer knows of support: its plan is
checked for geometry, copies, weight and orientations, and its items that hang in the air and
those with half of their base carried are counted, as returned and once everything fell straight
down (`settled`).
"""

import argparse
import os
import random
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from itertools import combinations, pairwise, product
from pathlib import Path
from typing import Any

import jax
from public_instances import (
    BED_BPP,
    BERKEY_WANG,
    IVANCIC,
    add_data_option,
    data_file,
    read_2bp,
    read_ivancic,
)
from rows import RESULTS, read_rows, write_rows

import jaxpack
from jaxpack import Job, PackedBin, Placement, Plan, read_job
from jaxpack.cli import prepare_jax
from jaxpack.model.box_check import Rule
from jaxpack.model.encoding import load_job
from jaxpack.model.exact import common_scale, exact
from jaxpack.model.job import ORIENTATIONS, ItemType, Sides
from jaxpack.model.objectives import bounds
from jaxpack.model.plan_check import plan_violations
from jaxpack.model.rules import Rules
from jaxpack.search.packer import encode

PATH = RESULTS / "peers.csv"
SETS = ("2bp", "ivancic", "bed-bpp")
SMALL = 60  # items: the pairwise CP-SAT model has 3n(n - 1) disjunctions
GRAVITY = {Rule.BLOCKED, Rule.FLOATING}  # rules that peers do not claim to keep
NAMES = {Rule.BLOCKED: "unreachable", Rule.FLOATING: "floats"}  # in the table; others as they are

Whole = tuple[int, int, int]


@dataclass(frozen=True)
class Box:
    """One item where a peer put it."""

    item: int  # index in Job.items
    corner: Whole
    extent: Whole

    @property
    def top(self) -> int:
        """Height of its upper face."""
        return self.corner[2] + self.extent[2]

    def shares_floor(self, other: "Box") -> int:
        """Area of the floor that both stand over."""
        (x, y, _), (other_x, other_y, _) = self.corner, other.corner
        (dx, dy, _), (other_dx, other_dy, _) = self.extent, other.extent
        length = min(x + dx, other_x + other_dx) - max(x, other_x)
        width = min(y + dy, other_y + other_dy) - max(y, other_y)
        return max(length, 0) * max(width, 0)


Bins = list[list[Box]]
Peer = Callable[[Job, float, int], Bins]  # job, seconds, seed


def whole(lengths: Iterable[Any]) -> Whole:
    x, y, z = map(int, lengths)
    return x, y, z


# Instances: their sides and bins in whole numbers, one type of bin.


def instances(name: str, data: Path) -> list[Job]:
    if name == "2bp":
        known = read_2bp(data_file(data, BERKEY_WANG))
        first = {}
        for job, about in known:
            if about["n"] in (20, 60):
                first.setdefault((about["cls"], about["n"]), job)
        return list(first.values())
    if name == "ivancic":
        jobs = read_ivancic(data_file(data, IVANCIC))
        by_number = {int(job.name.rsplit("_", 1)[1]): job for job in jobs}
        return [replace(by_number[n], name=f"ivancic-{n}") for n in range(1, 9)]
    orders = read_job(data_file(data, BED_BPP))
    return [in_whole_numbers(replace(job, name=f"bed-bpp-{job.name}")) for job in orders]


def in_whole_numbers(job: Job) -> Job:
    """The same in the finest decimal that occurs: most peers take whole numbers only."""
    scale = common_scale([side for one in (*job.bins, *job.items) for side in one.size])

    def scaled(size: Sides) -> Whole:
        return whole(exact(side) * scale for side in size)

    items = tuple(replace(item, size=scaled(item.size)) for item in job.items)
    bins = tuple(replace(room, size=scaled(room.size)) for room in job.bins)
    return replace(job, items=items, bins=bins)


def copies(job: Job) -> list[int]:
    """Index in Job.items of every item."""
    return [index for index, item in enumerate(job.items) for _ in range(item.copies)]


# Peers.


def rectpack_once(job: Job, mode: Any, algorithm: Any, order: Any) -> Bins:
    import rectpack

    packer = rectpack.newPacker(bin_algo=mode, pack_algo=algorithm, sort_algo=order, rotation=False)
    for index in copies(job):
        packer.add_rect(job.items[index].size[0], job.items[index].size[2], rid=index)
    packer.add_bin(job.bins[0].size[0], job.bins[0].size[2], count=float("inf"))
    packer.pack()
    bins: dict[int, list[Box]] = {}
    for number, x, z, width, height, index in packer.rect_list():
        bins.setdefault(number, []).append(Box(index, (x, 0, z), (width, 1, height)))
    return list(bins.values())


def rectpack_default(job: Job, seconds: float, seed: int) -> Bins:
    """Its own choice: every rectangle where it fits best, by area, maximal rectangles."""
    import rectpack

    return rectpack_once(job, rectpack.PackingBin.BBF, rectpack.MaxRectsBssf, rectpack.SORT_AREA)


def rectpack_best(job: Job, seconds: float, seed: int) -> Bins:
    """The fewest bins of everything that it offers, in random order until the time is up."""
    import rectpack

    names = [name for name in vars(rectpack) if name.startswith(("MaxRects", "Skyline", "Guillo"))]
    sorts = [name for name in vars(rectpack) if name.startswith("SORT_")]
    modes = [rectpack.PackingBin.BFF, rectpack.PackingBin.BBF, rectpack.PackingBin.Global]
    ways = list(product(modes, names, sorts))
    random.Random(seed).shuffle(ways)
    best, until = rectpack_default(job, seconds, seed), time.perf_counter() + seconds
    for mode, algorithm, order in ways:
        if time.perf_counter() > until:
            break
        found = rectpack_once(job, mode, getattr(rectpack, algorithm), getattr(rectpack, order))
        best = min(best, found, key=len)
    return best


def py3dbp(job: Job, seconds: float, seed: int) -> Bins:
    """Largest first, bins one after the other; it turns every item as it likes."""
    from py3dbp import Bin, Item, Packer

    packer, room = Packer(), job.bins[0]
    heaviest = min(room.max_weight, 1 + sum(item.weight * item.copies for item in job.items))
    for index in copies(job):
        packer.add_item(Item(index, *job.items[index].size, job.items[index].weight))
    for number in range(job.count):
        packer.add_bin(Bin(number, *room.size, heaviest))
    packer.pack(bigger_first=True, distribute_items=True)
    return [
        [Box(item.name, whole(item.position), whole(item.get_dimension())) for item in bin.items]
        for bin in packer.bins
        if bin.items
    ]


def packingsolver(job: Job, seconds: float, seed: int) -> Bins:
    """PackingSolver's box solver: tree search, column generation and the rest of its portfolio.

    The package has the 3D solvers only: a flat job is thin boxes to it.
    """
    from packingsolver3d import Instance, Objective, box

    depth = 2 if job.dimension == 2 else 1  # of boxes 1 deep it dies with a division by zero
    instance = Instance([room_for(job, depth)], kinds_for(job, depth), Objective.BIN_PACKING)
    result = box.solve(instance, time_limit=seconds)
    return [
        [
            Box(put.item_type_id, (put.x, put.y, put.z), (put.lx, put.ly // depth, put.lz))
            for put in packed.placements
        ]
        for packed in result.bins
        for _ in range(packed.copies)
    ]


def room_for(job: Job, depth: int) -> Any:
    from packingsolver3d import BinType

    (room,) = job.bins
    x, y, z = whole(room.size)
    limit = room.max_weight if room.max_weight < float("inf") else None
    return BinType(x, depth * y, z, copies=job.count, maximum_weight=limit)


def kinds_for(job: Job, depth: int) -> list[Any]:
    from packingsolver3d import ItemType, Rotation

    kinds = []
    for item in job.items:
        (x, y, z), ways = whole(item.size), [Rotation(name) for name in item.orientations]
        about = {"weight": item.weight, "copies": item.copies, "rotations": ways}
        kinds.append(ItemType(x, depth * y, z, **about))
    return kinds


def shelves(job: Job, sizes: list[Whole]) -> list[tuple[int, Whole]]:
    """(bin, corner) of sizes by falling height: rows, layers and bins, one after the other.

    A bin's first item is no earlier than its number, and bins are used in order.
    """
    room, places = whole(job.bins[0].size), []
    bin, x, y, z, depth, height = 0, 0, 0, 0, 0, 0
    for dx, dy, dz in sizes:
        if x + dx > room[0]:
            x, y, depth = 0, y + depth, 0
        if y + dy > room[1]:
            x, y, z, depth, height = 0, 0, z + height, 0, 0
        if z + dz > room[2]:
            bin, x, y, z, depth, height = bin + 1, 0, 0, 0, 0, 0
        places.append((bin, (x, y, z)))
        x, depth, height = x + dx, max(depth, dy), max(height, dz)
    return places


def tallest_first(job: Job) -> tuple[list[int], list[Whole]]:
    """Index in Job.items of every item, and its size as first allowed."""
    first = [item.turned(item.orientations[0]) for item in job.items]
    order = sorted(copies(job), key=lambda index: (-first[index][2], -first[index][0]))
    return order, [whole(first[index]) for index in order]


def cpsat_2d(job: Job, seconds: float, seed: int) -> Bins:
    """CP-SAT: a literal per item and bin, no-overlap-2D in every bin. Items are not turned."""
    from ortools.sat.python import cp_model

    until = time.perf_counter() + seconds
    order, sizes = tallest_first(job)
    places = shelves(job, sizes)
    model, (width, _, height) = cp_model.CpModel(), whole(job.bins[0].size)
    xs = [model.new_int_var(0, width - dx, "") for dx, _, _ in sizes]
    zs = [model.new_int_var(0, height - dz, "") for _, _, dz in sizes]
    inside = bins_in_order(model, len(sizes), places[-1][0] + 1)
    used = fill_bins(model, sizes, (width, height), xs, zs, inside)
    model.minimize(sum(used))
    for i, (bin, (x, _, z)) in enumerate(places):
        hint(model, [xs[i], zs[i]], [x, z])
        hint(model, inside[i], [bin == number for number in range(len(inside[i]))])
    if solver := search(model, until, seed):
        bins = [[solver.value(literal) for literal in choice].index(1) for choice in inside]
        corners = [(solver.value(x), 0, solver.value(z)) for x, z in zip(xs, zs, strict=True)]
        places = list(zip(bins, corners, strict=True))
    return gathered(order, places, sizes)


def bins_in_order(model: Any, items: int, bins: int) -> list[list[Any]]:
    """A literal per item and bin, for the bins that the item may be in.

    Bins are numbered by their first items: anything else is the same under other numbers.
    """
    inside = [[model.new_bool_var("") for _ in range(min(turn + 1, bins))] for turn in range(items)]
    for choice in inside:
        model.add_exactly_one(choice)
    return inside


def fill_bins(
    model: Any, sizes: list[Whole], room: tuple[int, int], xs: list, zs: list, inside: list[list]
) -> list[Any]:
    """No overlap in any bin; literals that say which are used."""
    used = [model.new_bool_var("") for _ in inside[-1]]
    interval = model.new_optional_fixed_size_interval_var
    for number, one in enumerate(used):
        rows = [(i, inside[i][number]) for i in range(number, len(sizes))]
        along_x = [interval(xs[i], sizes[i][0], there, "") for i, there in rows]
        along_z = [interval(zs[i], sizes[i][2], there, "") for i, there in rows]
        model.add_no_overlap_2d(along_x, along_z)
        area = sum(sizes[i][0] * sizes[i][2] * there for i, there in rows)
        model.add(area <= room[0] * room[1] * one)
    for one, following in pairwise(used):
        model.add_implication(following, one)
    return used


def cpsat_3d(job: Job, seconds: float, seed: int) -> Bins:
    """CP-SAT: two items are in different bins or one is beside, behind or over the other."""
    from ortools.sat.python import cp_model

    until = time.perf_counter() + seconds
    order, sizes = tallest_first(job)
    places = shelves(job, sizes)
    model, room, last = cp_model.CpModel(), whole(job.bins[0].size), places[-1][0]
    bins = [model.new_int_var(0, min(turn, last), "") for turn in range(len(order))]
    corners = [[model.new_int_var(0, side, "") for side in room] for _ in order]
    turns = [ways_to_turn(model, job.items[index]) for index in order]
    ends = [ends_inside(model, *pair, room) for pair in zip(corners, turns, strict=True)]
    for i, j in combinations(range(len(order)), 2):
        keep_apart(model, bins, corners, ends, i, j)
    most = model.new_int_var(bounds(job).bins - 1, last, "")
    model.add_max_equality(most, bins)
    model.minimize(most)
    for i, (bin, corner) in enumerate(places):
        hint(model, [bins[i], *corners[i]], [bin, *corner])
        hint(model, list(turns[i].values()), [way == sizes[i] for way in turns[i]])
    if solver := search(model, until, seed):
        places = [
            (solver.value(bin), whole(map(solver.value, corner)))
            for bin, corner in zip(bins, corners, strict=True)
        ]
        sizes = [next(way for way in ways if solver.value(ways[way])) for ways in turns]
    return gathered(order, places, sizes)


def ways_to_turn(model: Any, item: ItemType) -> dict[Whole, Any]:
    """Extent -> the literal that it has this one."""
    ways = {whole(item.turned(name)): model.new_bool_var("") for name in item.orientations}
    model.add_exactly_one(ways.values())
    return ways


def ends_inside(model: Any, corner: list, ways: dict[Whole, Any], room: Whole) -> list[Any]:
    """Where an item ends along x, y and z, which is inside the bin."""
    ends = []
    for axis in range(3):
        ends.append(corner[axis] + sum(way[axis] * taken for way, taken in ways.items()))
        model.add(ends[axis] <= room[axis])
    return ends


def keep_apart(model: Any, bins: list, corners: list, ends: list, i: int, j: int) -> None:
    apart = []
    for one, other in ((i, j), (j, i)):
        rules = [ends[one][axis] <= corners[other][axis] for axis in range(3)]
        for rule in (*rules, bins[one] < bins[other]):
            apart.append(model.new_bool_var(""))
            model.add(rule).only_enforce_if(apart[-1])
    model.add_bool_or(apart)


def hint(model: Any, variables: list, values: list) -> None:
    for variable, value in zip(variables, values, strict=True):
        model.add_hint(variable, value)


def search(model: Any, until: float, seed: int) -> Any:
    """The solver with its best solution, None if it has none."""
    from ortools.sat.python import cp_model

    solver = cp_model.CpSolver()
    solver.parameters.max_time_in_seconds = max(until - time.perf_counter(), 0.01)
    solver.parameters.num_workers = cores()
    solver.parameters.random_seed = seed
    found = solver.solve(model) in (cp_model.OPTIMAL, cp_model.FEASIBLE)
    return solver if found else None


def cores() -> int:
    """As many as jaxpack takes."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


def gathered(order: list[int], places: list[tuple[int, Whole]], sizes: list[Whole]) -> Bins:
    bins: dict[int, list[Box]] = {}
    for index, (bin, corner), size in zip(order, places, sizes, strict=True):
        bins.setdefault(bin, []).append(Box(index, corner, size))
    return list(bins.values())


# jaxpack, with its policy.


def jaxpack_plan(job: Job, seconds: float, seed: int, support: float) -> Plan:
    return jaxpack.solve(job, time_limit=seconds, seed=seed, support=support).plan


def warm_up(job: Job, support: float, seed: int) -> None:
    """Compiles for the shape of the job, which would count as time of its first instance."""
    loading = load_job(job, Rules(support))
    rules, stock = encode(loading)
    shape = rules, *(leaf.shape for leaf in jax.tree.leaves(stock))
    if shape not in compiled():
        compiled().add(shape)
        jaxpack.solve(job, time_limit=WARMING, seed=seed, support=support)


WARMING = 60.0  # seconds, in which a slow machine compiles


@cache
def compiled() -> set[tuple]:
    return set()


# The check and the audit.


def orientation_of(job: Job, box: Box) -> str:
    """An allowed one with that extent, else any: the checker then says that it is not allowed."""
    item = job.items[box.item]
    names = [*item.orientations, *ORIENTATIONS]
    return next((name for name in names if whole(item.turned(name)) == box.extent), names[0])


def as_plan(job: Job, bins: Bins) -> Plan:
    """Every bin from its floor up."""
    packed = Counter(box.item for boxes in bins for box in boxes)
    left = (Counter(copies(job)) - packed).elements()
    return Plan(tuple(PackedBin(0, placements(job, boxes)) for boxes in bins), tuple(left))


def placements(job: Job, boxes: list[Box]) -> tuple[Placement, ...]:
    return tuple(Placement(b.item, orientation_of(job, b), b.corner) for b in from_below(boxes))


def from_below(boxes: list[Box]) -> list[Box]:
    return sorted(boxes, key=lambda box: box.corner[::-1])


def boxes_of(job: Job, plan: Plan) -> Bins:
    """What `as_plan` makes a plan of."""
    return [
        [
            Box(put.item, whole(put.corner), whole(job.items[put.item].turned(put.orientation)))
            for put in packed.placements
        ]
        for packed in plan.bins
    ]


def settled(boxes: list[Box]) -> list[Box]:
    """The same once all have fallen straight down, the lowest first."""
    down: list[Box] = []
    for box in from_below(boxes):
        x, y, _ = box.corner
        rest = max((under.top for under in down if under.shares_floor(box)), default=0)
        down.append(replace(box, corner=(x, y, rest)))
    return down


def supported_share(bins: Bins) -> float:
    """Share of the items that stand on the floor or have half of their base on others' tops."""
    held = [
        2 * carried(box, boxes) >= box.extent[0] * box.extent[1] for boxes in bins for box in boxes
    ]
    return sum(held) / len(held)


def carried(box: Box, boxes: list[Box]) -> int:
    """Area of its base that something carries."""
    if box.corner[2] == 0:
        return box.extent[0] * box.extent[1]
    return sum(box.shares_floor(under) for under in boxes if under.top == box.corner[2])


def broken_rules(job: Job, plan: Plan) -> Counter[str]:
    """Rule -> how often it is broken, with no demand on support; "left out" for unpacked items."""
    found = Counter[str](violation.rule for violation in plan_violations(job, plan, Rules(0.0)))
    if plan.left_out:
        found["left out"] = len(plan.left_out)
    return found


def audited(job: Job, plan: Plan) -> dict[str, Any]:
    """What a row says of a plan."""
    broken, bins = broken_rules(job, plan), boxes_of(job, plan)
    valid = not set(broken) - GRAVITY
    fallen = [settled(boxes) for boxes in bins]
    if valid and broken_rules(job, as_plan(job, fallen)):
        raise AssertionError(f"{job.name}: a valid plan is not valid once it has settled")
    return {
        "bins": len(plan.bins),
        "lower_bound": bounds(job).bins,
        "valid": valid,
        "floating": broken[Rule.FLOATING],
        "supported": round(supported_share(bins), 4),
        "settled": round(supported_share(fallen), 4) if valid else "",
        "broken": " ".join(
            f"{NAMES.get(rule, rule)}:{count}" for rule, count in sorted(broken.items())
        ),
    }


# Rows and the summary.


@dataclass(frozen=True)
class Method:
    """A packer, and what it takes."""

    plan: Callable[[Job, float, int], Plan]
    dimensions: tuple[int, ...]
    module: str | None = None  # that it needs; None for our own
    support: float | None = None  # that it keeps
    largest: int = 10**9  # items

    @property
    def package(self) -> str | None:
        """What has to be installed."""
        return self.module and self.module.split(".")[0]


def peer(solver: Peer, module: str, dimensions: tuple[int, ...], largest: int = 10**9) -> Method:
    def plan(job: Job, seconds: float, seed: int) -> Plan:
        return as_plan(job, solver(job, seconds, seed))

    return Method(plan, dimensions, module, None, largest)


def ours(support: float) -> Method:
    def plan(job: Job, seconds: float, seed: int) -> Plan:
        return jaxpack_plan(job, seconds, seed, support)

    return Method(plan, (2, 3), None, support)


CP_SAT = "ortools.sat.python.cp_model"
METHODS = {
    "jaxpack": ours(0.5),
    "jaxpack-support-0": ours(0.0),
    "rectpack": peer(rectpack_default, "rectpack", (2,)),
    "rectpack-best": peer(rectpack_best, "rectpack", (2,)),
    "packingsolver3d": peer(packingsolver, "packingsolver3d", (2, 3)),
    "py3dbp": peer(py3dbp, "py3dbp", (3,)),
    "cp-sat-2d": peer(cpsat_2d, CP_SAT, (2,)),
    "cp-sat-3d": peer(cpsat_3d, CP_SAT, (3,), SMALL),
}


def installed(names: list[str]) -> dict[str, Method]:
    """The methods whose package is there, saying which are not."""
    there = {
        name: METHODS[name]
        for name in names
        if METHODS[name].package is None or find_spec(METHODS[name].package)
    }
    if missing := sorted({METHODS[name].package for name in names if name not in there}):
        print(f"not installed, left out: {', '.join(missing)}; pip install 'jaxpack[peers]'")
    return there


def row_of(method: Method, job: Job, seconds: float, seed: int) -> dict[str, Any]:
    if method.module:
        import_module(method.module)  # not counted
    else:
        warm_up(job, method.support or 0.0, seed)
    began, worked = time.perf_counter(), time.process_time()
    plan = method.plan(job, seconds, seed)
    # Both: on a machine with other work the second says how much of the first was ours.
    spent = {"seconds": time.perf_counter() - began, "cpu_seconds": time.process_time() - worked}
    return audited(job, plan) | {name: round(value, 2) for name, value in spent.items()}


def missing_rows(
    methods: dict[str, Method], rows: list[dict], data: Path, only: str
) -> Iterator[tuple[str, str, Job]]:
    """(set, method, instance) without a row."""
    done = {(row["instance"], row["method"]) for row in rows}
    for name in SETS:
        for job in instances(name, data):
            for method, about in methods.items():
                fits = job.dimension in about.dimensions and job.count <= about.largest
                if fits and only in job.name and (job.name, method) not in done:
                    yield name, method, job


def summary(rows: list[dict]) -> Iterator[str]:
    """A line of markdown per set and method."""
    yield "| set | method | instances | bins | bound | valid | supported | settled | seconds |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for name, method in product(SETS, METHODS):
        own = [row for row in rows if (row["set"], row["method"]) == (name, method)]
        if own:
            totals = [sum(int(row[key]) for row in own) for key in ("bins", "lower_bound")]
            valid = sum(str(row["valid"]) == "True" for row in own)
            shares = [percent(own, "supported"), percent(own, "settled")]
            seconds = f"{mean(own, 'seconds'):.1f}"
            fields = [name, method, len(own), *totals, f"{valid}/{len(own)}", *shares, seconds]
            yield f"| {' | '.join(map(str, fields))} |"


def mean(rows: list[dict], key: str) -> float:
    values = [float(row[key]) for row in rows if row[key] != ""]
    return sum(values) / len(values) if values else float("nan")


def percent(rows: list[dict], key: str) -> str:
    value = mean(rows, key)
    return "" if value != value else f"{100 * value:.0f} %"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_data_option(parser)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="instances whose name has this in it")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    options = parser.parse_args()
    prepare_jax()
    methods, rows = installed(options.methods), read_rows(PATH)
    for name, method, job in missing_rows(methods, rows, options.data, options.only):
        found = row_of(METHODS[method], job, options.seconds, options.seed)
        rows.append({"set": name, "instance": job.name, "method": method} | found)
        print(rows[-1], flush=True)
        write_rows(PATH, rows)
    print("\n".join(summary(rows)))


if __name__ == "__main__":
    main()
