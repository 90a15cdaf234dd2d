"""PackingSolver's certificate: a plan as CSV.

Its readers know whole numbers only and cut decimals off: a plan that has some is written with all
lengths times the least factor that makes them whole.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from jaxpack.io.notes import Say, note, silent
from jaxpack.io.spreadsheets import plain_numbers, read_table
from jaxpack.io.tables import Row, Table, write_table
from jaxpack.model.exact import common_scale, exact
from jaxpack.model.job import (
    FLAT_TURNED,
    ORIENTATIONS,
    Job,
    PackedBin,
    Placement,
    Plan,
    Sides,
)
from jaxpack.model.numbers import fault, plain, show
from jaxpack.model.objectives import objective_of

MOST_BINS = 100_000  # of a certificate, copies included
MOST_SCALE = 10**6
LARGEST = 2**31 - 1  # of the numbers in it

_AXES = {2: (0, 2), 3: (0, 1, 2)}  # of the certificate's columns: X and Y of 2D are x and z
_COLUMNS = {
    2: ("TYPE", "ID", "COPIES", "BIN", "X", "Y", "LX", "LY", "GROUP_ID"),
    3: ("TYPE", "ID", "COPIES", "BIN", "X", "Y", "Z", "LX", "LY", "LZ", "ROTATION"),
}
_NUMBERS = ("ID", "COPIES", "BIN", "X", "Y", "Z", "LX", "LY", "LZ")


def write_certificate(path: Path, job: Job, plan: Plan, say: Say = silent) -> None:
    """Writes PackingSolver's solution CSV: a BIN row before the ITEM rows of each bin.

    Args:
        path: the file.
        job: what is packed.
        plan: how.
        say: takes a line that names the factor, if the lengths are written times one.

    Raises:
        UserError: where that factor or a length times it is too large, or the file cannot be
            written.
    """
    axes = _AXES[job.dimension]
    scale = _factor(path, set(_lengths(job, plan)))

    def whole(sides: Sides) -> list[int]:
        return [int(exact(sides[axis]) * scale) for axis in axes]

    rows: list[Sequence[object]] = [_COLUMNS[job.dimension]]
    for number, packed in enumerate(plan.bins):
        room = job.bins[packed.bin].size
        rows.append(["BIN", packed.bin, 1, number, *(0 for _ in axes), *whole(room), ""])
        for placement in packed.placements:
            extent = job.items[placement.item].turned(placement.orientation)
            last = 0 if job.dimension == 2 else placement.orientation
            box = *whole(placement.corner), *whole(extent)
            rows.append(["ITEM", placement.item, 1, number, *box, last])
    write_table(path, rows)
    if scale > 1:
        what = f"all lengths are written times {scale:,}"
        say(note(path, f"{what}: PackingSolver's files have whole numbers only"))


def check_scale(path: Path, job: Job) -> None:
    """Checks that a certificate can hold the lengths of a job, before there is a plan.

    Raises:
        UserError: where they have too many digits.
    """
    _factor(path, set(job.lengths()))


def _factor(path: Path, lengths: set[float]) -> int:
    """What makes whole numbers of all lengths."""
    scale = common_scale(lengths)
    if scale > MOST_SCALE or max(lengths, default=0) * scale > LARGEST:
        what = "PackingSolver knows whole lengths up to 2^31 only, and these have more digits"
        raise fault(path, what, "round the sizes, or write the plan as .json")
    return scale


def _lengths(job: Job, plan: Plan) -> Iterator[float]:
    """All that a certificate of the plan holds."""
    for packed in plan.bins:
        yield from (job.bins[packed.bin].size[axis] for axis in _AXES[job.dimension])
        for placement in packed.placements:
            for sides in (placement.corner, job.items[placement.item].size):
                yield from (sides[axis] for axis in _AXES[job.dimension])


def read_certificate(path: Path, job: Job) -> Plan:
    """The plan of a job that a PackingSolver certificate holds.

    Whether the plan is valid is not checked, only that its types are the job's: their numbers
    and sides. Where the sides of the first bin are those of the job times a whole number, all
    lengths are taken to be so. A bin with COPIES is as many bins, STACK rows are passed over.
    What is in no bin is left out.

    Raises:
        UserError: naming the row and the column.
    """
    table = plain_numbers(read_table(path), _NUMBERS)
    # GROUP_ID, which says nothing here, is not in older ones.
    table.need(column for column in _COLUMNS[job.dimension] if column != "GROUP_ID")
    scale = _scale(table, job)
    # Number: type, copies, placements, height if that is the plan's.
    bins: dict[int, tuple[int, int, list[Placement], float | None]] = {}
    total = 0
    for row in table.rows():
        kind = row.text("TYPE").upper()
        if kind == "STACK":
            continue
        number = row.whole("BIN", low=0)
        copies = row.whole("COPIES", low=1)
        if kind == "BIN":
            bin_type = row.whole("ID", low=0, high=len(job.bins) - 1)
            if number in bins:
                raise fault(row.at("BIN"), f"bin {number} has a BIN row already: number it anew")
            total += copies
            if total > MOST_BINS:
                raise fault(row.at("COPIES"), f"more than {MOST_BINS:,} bins in all")
            x, y, z = job.bins[bin_type].size
            height = None
            if objective_of(job).open_bin:
                z = height = row.size("LY" if job.dimension == 2 else "LZ") / scale
            _check_sides(row, job, (x, y, z), scale, f"bins of type {bin_type}")
            bins[number] = bin_type, copies, [], height
        elif kind == "ITEM":
            if number not in bins:
                raise fault(row.at("BIN"), f"bin {number} has no BIN row before this one: add it")
            if copies != bins[number][1]:
                raise fault(row.at("COPIES"), f"{copies}, but its bin has {bins[number][1]}")
            bins[number][2].append(_certified(row, job, scale))
        else:
            raise fault(row.at("TYPE"), f"{show(kind)} is not known: use BIN or ITEM")
    packed = [
        PackedBin(bin_type, tuple(placements), height)
        for bin_type, copies, placements, height in bins.values()
        for _ in range(copies)
    ]
    return Plan(tuple(packed), _left_out(job, packed))


def _scale(table: Table, job: Job) -> int:
    """What the lengths are multiplied with: 1 unless the first bin says another whole number."""
    row = next((row for row in table.rows() if row.text("TYPE").upper() == "BIN"), None)
    if row is None:
        return 1
    size = job.bins[row.whole("ID", low=0, high=len(job.bins) - 1)].size
    columns = [*zip(_AXES[job.dimension], ("LX", "LY", "LZ"), strict=False)]
    columns = columns[:-1] if objective_of(job).open_bin else columns
    ratios = [row.number(column) / size[axis] for axis, column in columns]
    scale = round(ratios[0]) if 1 <= ratios[0] <= MOST_SCALE else 1
    return scale if all(math.isclose(ratio, scale, rel_tol=1e-6) for ratio in ratios) else 1


def _certified(row: Row, job: Job, scale: int) -> Placement:
    index = row.whole("ID", low=0, high=len(job.items) - 1)
    item = job.items[index]
    if job.dimension == 2:
        along = row.number("LX") / scale
        orientation = min(FLAT_TURNED, key=lambda o: abs(item.turned(o)[0] - along))
        x, y, z = row.number("X"), 0.0, row.number("Y")
    else:
        orientation = row.text("ROTATION").upper()
        if orientation not in ORIENTATIONS:
            what = f"{show(orientation)} is not known: use {', '.join(ORIENTATIONS)}"
            raise fault(row.at("ROTATION"), what)
        x, y, z = row.number("X"), row.number("Y"), row.number("Z")
    _check_sides(row, job, item.turned(orientation), scale, f"item {index}, {orientation}")
    return Placement(index, orientation, (x / scale, y / scale, z / scale))


def _check_sides(row: Row, job: Job, sides: Sides, scale: int, what: str) -> None:
    for axis, column in zip(_AXES[job.dimension], ("LX", "LY", "LZ"), strict=False):
        side = sides[axis] * scale
        if not alike(row.number(column), side):
            found = f"{plain(row.number(column))}, but {what}, of this job has {plain(side)}"
            raise fault(row.at(column), f"{found}: is it of another job?")


def alike(a: float, b: float) -> bool:
    """Whether two lengths in files are the same: some write fewer digits than others."""
    return math.isclose(a, b, rel_tol=1e-6)


def _left_out(job: Job, packed: Iterable[PackedBin]) -> tuple[int, ...]:
    placed = Counter(placement.item for one in packed for placement in one.placements)
    return tuple(
        index for index, item in enumerate(job.items) for _ in range(item.copies - placed[index])
    )
