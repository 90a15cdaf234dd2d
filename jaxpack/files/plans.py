"""Plans in files: PackingSolver's certificate, JSON, a list of loading steps, BED-BPP's plans.

Bins, items and their types have the numbers of the job and the plan, from 0; steps count from 1
through all bins. Lengths and weights are in the job's units.
"""

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jaxpack.files.tables import Row, read_table, write_table
from jaxpack.files.texts import (
    json_line,
    json_lines,
    member,
    member_index,
    member_vector,
    read_json,
    write_text,
)
from jaxpack.loading.job import (
    FLAT_TURNED,
    ORIENTATIONS,
    UPRIGHT,
    ItemType,
    Job,
    PackedBin,
    Placement,
    Plan,
    Sides,
)
from jaxpack.loading.numbers import fault, plain, show

MOST_BINS = 100_000  # of a certificate, copies included

_AXES = {2: (0, 2), 3: (0, 1, 2)}  # of the certificate's columns: X and Y of 2D are x and z
_COLUMNS = {
    2: ("TYPE", "ID", "COPIES", "BIN", "X", "Y", "LX", "LY", "GROUP_ID"),
    3: ("TYPE", "ID", "COPIES", "BIN", "X", "Y", "Z", "LX", "LY", "LZ", "ROTATION"),
}
_STEP = ("STEP", "BIN", "ITEM", "NAME", "X", "Y", "Z", "LX", "LY", "LZ", "ROTATION", "WEIGHT")


def write_certificate(path: Path, job: Job, plan: Plan) -> None:
    """Writes PackingSolver's solution CSV: a BIN row before the ITEM rows of each bin."""
    axes = _AXES[job.dimension]
    rows: list[Sequence[object]] = [_COLUMNS[job.dimension]]
    for number, packed in enumerate(plan.bins):
        room = job.bins[packed.bin].size
        rows.append(["BIN", packed.bin, 1, number, *(0 for _ in axes), *_plain(room, axes), ""])
        for placement in packed.placements:
            extent = job.items[placement.item].turned(placement.orientation)
            box = *_plain(placement.corner, axes), *_plain(extent, axes)
            last = 0 if job.dimension == 2 else placement.orientation
            rows.append(["ITEM", placement.item, 1, number, *box, last])
    write_table(path, rows)


def read_certificate(path: Path, job: Job) -> Plan:
    """The plan of a job that a PackingSolver certificate holds.

    Whether the plan is valid is not checked, only that its types are the job's: their numbers
    and sides. A bin with COPIES is as many bins. What is in no bin is left out.

    Raises:
        UserError: naming the row and the column.
    """
    table = read_table(path)
    # GROUP_ID, which says nothing here, is not in older ones.
    table.need(column for column in _COLUMNS[job.dimension] if column != "GROUP_ID")
    bins: dict[int, tuple[int, int, list[Placement]]] = {}  # number: type, copies, placements
    total = 0
    for row in table.rows:
        kind = row.text("TYPE").upper()
        number = row.whole("BIN", low=0)
        copies = row.whole("COPIES", low=1)
        if kind == "BIN":
            bin_type = row.whole("ID", low=0, high=len(job.bins) - 1)
            if number in bins:
                raise fault(row.at("BIN"), f"bin {number} has a BIN row already: number it anew")
            total += copies
            if total > MOST_BINS:
                raise fault(row.at("COPIES"), f"more than {MOST_BINS:,} bins in all")
            _check_sides(row, job, job.bins[bin_type].size, f"bins of type {bin_type}")
            bins[number] = bin_type, copies, []
        elif kind == "ITEM":
            if number not in bins:
                raise fault(row.at("BIN"), f"bin {number} has no BIN row before this one: add it")
            if copies != bins[number][1]:
                raise fault(row.at("COPIES"), f"{copies}, but its bin has {bins[number][1]}")
            bins[number][2].append(_certified(row, job))
        else:
            raise fault(row.at("TYPE"), f"{show(kind)} is not known: use BIN or ITEM")
    packed = [
        PackedBin(bin_type, tuple(placements))
        for bin_type, copies, placements in bins.values()
        for _ in range(copies)
    ]
    return Plan(tuple(packed), _left_out(job, packed))


def _certified(row: Row, job: Job) -> Placement:
    index = row.whole("ID", low=0, high=len(job.items) - 1)
    item = job.items[index]
    if job.dimension == 2:
        along = row.number("LX")
        orientation = min(FLAT_TURNED, key=lambda o: abs(item.turned(o)[0] - along))
        corner = row.number("X"), 0.0, row.number("Y")
    else:
        orientation = row.text("ROTATION").upper()
        if orientation not in ORIENTATIONS:
            what = f"{show(orientation)} is not known: use {', '.join(ORIENTATIONS)}"
            raise fault(row.at("ROTATION"), what)
        corner = row.number("X"), row.number("Y"), row.number("Z")
    _check_sides(row, job, item.turned(orientation), f"item {index}, {orientation}")
    return Placement(index, orientation, corner)


def _check_sides(row: Row, job: Job, sides: Sides, what: str) -> None:
    for axis, column in zip(_AXES[job.dimension], ("LX", "LY", "LZ"), strict=False):
        if not _alike(row.number(column), sides[axis]):
            found = f"{plain(row.number(column))}, but {what}, of this job has {plain(sides[axis])}"
            raise fault(row.at(column), f"{found}: is it of another job?")


def _alike(a: float, b: float) -> bool:
    return math.isclose(a, b, rel_tol=1e-6)  # others may write fewer digits


def _left_out(job: Job, packed: Iterable[PackedBin]) -> tuple[int, ...]:
    placed = Counter(placement.item for one in packed for placement in one.placements)
    return tuple(
        index for index, item in enumerate(job.items) for _ in range(item.copies - placed[index])
    )


class _Step(NamedTuple):
    """An item on its way into a bin."""

    number: int  # from 1
    bin: int  # index in Plan.bins
    item: ItemType
    placement: Placement

    @property
    def extent(self) -> Sides:
        return self.item.turned(self.placement.orientation)


def _steps(job: Job, plan: Plan) -> Iterator[_Step]:
    loads = [(bin, one) for bin, packed in enumerate(plan.bins) for one in packed.placements]
    for number, (bin, placement) in enumerate(loads, 1):
        yield _Step(number, bin, job.items[placement.item], placement)


def write_steps(path: Path, job: Job, plan: Plan) -> None:
    """Writes a CSV with a row per item in loading order; X, Y, Z is its front-bottom-left corner.

    LX, LY, LZ are its extents as it lies and ROTATION the orientation, a key of ORIENTATIONS.
    """
    rows: list[Sequence[object]] = [_STEP]
    for step in _steps(job, plan):
        box = *_plain(step.placement.corner), *_plain(step.extent)
        last = step.placement.orientation, plain(step.item.weight)
        rows.append([step.number, step.bin, step.placement.item, step.item.name, *box, *last])
    write_table(path, rows)


def write_plan_json(path: Path, job: Job, plan: Plan) -> None:
    """Writes a plan with all that it says of the job: a line per bin and per item.

    Positions are front-bottom-left corners, sides and extents along x, y and z; a bin's fill is
    the share of its volume that is filled.
    """
    loads: list[list[_Step]] = [[] for _ in plan.bins]
    for step in _steps(job, plan):
        loads[step.bin].append(step)
    bins = []
    for number, (packed, steps) in enumerate(zip(plan.bins, loads, strict=True)):
        kind = job.bins[packed.bin]
        filled = math.fsum(math.prod(step.item.size) for step in steps)
        about = {
            "bin": number,
            "type": packed.bin,
            "name": kind.name,
            "size": _plain(kind.size),
            "cost": plain(kind.price),
            "weight": plain(math.fsum(step.item.weight for step in steps)),
            "fill": round(filled / math.prod(kind.size), 6),
        }
        items = [
            {
                "step": step.number,
                "item": step.placement.item,
                "name": step.item.name,
                "position": _plain(step.placement.corner),
                "extent": _plain(step.extent),
                "orientation": step.placement.orientation,
                "weight": plain(step.item.weight),
            }
            for step in steps
        ]
        bins.append(
            f'{json_line(about)[:-1]}, "items": {json_lines(map(json_line, items), "    ")}}}'
        )
    left_out = [json_line({"item": n, "name": job.items[n].name}) for n in plan.left_out]
    head = f'"job": {json_line(job.name)},\n"dimension": {job.dimension}'
    lists = f'"bins": {json_lines(bins, "  ")},\n"left_out": {json_lines(left_out, "  ")}'
    write_text(path, f"{{\n{head},\n{lists}\n}}\n")


def read_plan_json(path: Path, job: Job) -> Plan:
    """The plan that `write_plan_json` wrote of a job; its validity is not checked.

    Raises:
        UserError: naming the bin and the item, where its types are not those of the job or
            anything else is wrong with the file.
    """
    data = read_json(path)
    bins = []
    for number, one in enumerate(member(data, "bins", list, str(path))):
        where = f"{path}: bin {number}"
        bin_type = member_index(one, "type", len(job.bins), where)
        _check_vector(one, "size", job.bins[bin_type].size, where)
        items = enumerate(member(one, "items", list, where))
        placed = tuple(_placement(item, job, f"{where}, item {index}") for index, item in items)
        bins.append(PackedBin(bin_type, placed))
    left = enumerate(member(data, "left_out", list, str(path)))
    left_out = (
        member_index(one, "item", len(job.items), f"{path}: left_out {n}") for n, one in left
    )
    return Plan(tuple(bins), tuple(left_out))


def _placement(data: Any, job: Job, where: str) -> Placement:
    index = member_index(data, "item", len(job.items), where)
    orientation = member(data, "orientation", str, where)
    if orientation not in ORIENTATIONS:
        what = f"{show(orientation)} is not known: use {', '.join(ORIENTATIONS)}"
        raise fault(where, "key 'orientation'", what)
    _check_vector(data, "extent", job.items[index].turned(orientation), where)
    return Placement(index, orientation, member_vector(data, "position", where))


def _check_vector(data: Any, key: str, wanted: Sides, where: str) -> None:
    found = member_vector(data, key, where)
    if not all(map(_alike, found, wanted)):
        what = f"{_plain(found)}, but this job has {_plain(wanted)}: is it of another job?"
        raise fault(where, f"key '{key}'", what)


def write_bed_bpp(path: Path, jobs: Sequence[Job], plans: Sequence[Plan]) -> None:
    """Writes BED-BPP's packing plans: per order, by the jobs' names, its items in loading order.

    The format knows one bin per order, mm and kg, and orientations 0 (as given) and 1 (turned on
    the floor). It wants an id, which is taken to be the end of a name "article-id", and a product
    group, which a job does not have.

    Raises:
        UserError: where a plan has more bins or other orientations, or two jobs one name.
    """
    orders: dict[str, list[dict[str, object]]] = {}
    for job, plan in zip(jobs, plans, strict=True):
        where = f"{path}: order '{job.name}'"
        if job.name in orders:
            raise fault(where, "is there twice: give jobs names of their own")
        if len(plan.bins) > 1:
            what = f"{len(plan.bins)} bins, but BED-BPP has one per order"
            raise fault(where, what, "write JSON or a certificate, or give larger bins")
        orders[job.name] = [_action(step, where) for step in _steps(job, plan)]
    write_text(path, json.dumps(orders, indent=1, ensure_ascii=False) + "\n")


def _action(step: _Step, where: str) -> dict[str, object]:
    placement, item = step.placement, step.item
    if placement.orientation not in UPRIGHT:
        what = f"item {placement.item} lies {placement.orientation}, BED-BPP has XYZ and YXZ only"
        raise fault(where, what, "write JSON or a certificate")
    sides = zip(("length/mm", "width/mm", "height/mm"), _plain(item.size), strict=True)
    return {
        "item": {
            "article": item.name,
            "id": item.name.rpartition("-")[2],
            "product_group": "",
            **dict(sides),
            "weight/kg": plain(item.weight),
            "sequence": step.number,
        },
        "flb_coordinates": _plain(placement.corner),
        "orientation": UPRIGHT.index(placement.orientation),
    }


def _plain(sides: Sides, axes: Iterable[int] = (0, 1, 2)) -> list[int | float]:
    return [plain(sides[axis]) for axis in axes]
