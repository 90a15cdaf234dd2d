"""Jobs from files: tables with PackingSolver's columns, 2DPackLib's .ins2D, BED-BPP's orders.

A table has a header with its columns in any order, capitals or not.

    2D items   WIDTH, HEIGHT [, COPIES, WEIGHT, ORIENTED, PROFIT, NAME or ID]
    2D bins    WIDTH, HEIGHT [, COST, COPIES, MAXIMUM_WEIGHT, NAME or ID]
    3D items   X, Y, Z [, COPIES, WEIGHT, ROTATION_XYZ, ..., ROTATION_ZXY, PROFIT, NAME or ID]
    3D bins    X, Y, Z [, COST, COPIES, MAXIMUM_WEIGHT, NAME or ID]

An empty cell is as no column. Items have 1 copy then and weigh nothing. In 2D ORIENTED 0 lets an
item be turned by a quarter; without that items may not be turned, as in the standard instances. In
3D items may be turned as the ROTATION columns with 1 say, without any not at all. For bins empty
or -1 is: COST their volume, COPIES any number, MAXIMUM_WEIGHT none. PROFIT is for the objective
value: without it items are worth their volume, and bins without COPIES are one. For the objective
height that of a bin may be empty or -1: it is open. See docs/file-formats.md.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from os import PathLike
from pathlib import Path
from typing import Any

from jaxpack.io.bed_bpp import read_orders
from jaxpack.io.columns import (
    BINS,
    ITEMS,
    NAMES,
    ROTATIONS,
    SIDES,
    Reading,
    Understood,
    check_ignored,
    same_unit,
    understand,
)
from jaxpack.io.ins2d import read_ins2d
from jaxpack.io.notes import Say, note, silent
from jaxpack.io.spreadsheets import WORKBOOKS, read_table
from jaxpack.io.tables import Row, Table, table_from_columns
from jaxpack.model.exact import exact
from jaxpack.model.job import FLAT_TURNED, BinType, ItemType, Job, Sides, counted
from jaxpack.model.numbers import as_profit, fault, plain

TABLES = (".csv", ".tsv", ".txt", *WORKBOOKS)
ORDER = "ORDER"
"""The column that says which order an item belongs to, where a table may hold several."""


def read_job(
    items: str | PathLike[str],
    bins: str | PathLike[str] | None = None,
    *,
    ignore: str | Sequence[str] = (),
    packingsolver: bool = False,
    objective: str = "",
    by_order: bool = False,
    say: Say = silent,
) -> list[Job]:
    """The jobs of a file, in its units: one, or of a BED-BPP file one per order.

    Args:
        items: path of a file .csv, .xlsx, .ins2D or .json.
        bins: of a table of bins, .csv or .xlsx. A table of items needs it; for others it replaces
            what their file says: the bin of an .ins2D file, the target of an order (a euro pallet,
            1200 x 800, if it names none, or a roll container, 800 x 700, both up to 2000 mm).
        ignore: columns that are left out of account, capitals or not.
        packingsolver: read tables exactly as PackingSolver 0.1.1233 does: without COPIES there is
            one bin, 2D items without ORIENTED may be turned, without a rotation that is 1 items
            are as given, -1 as MAXIMUM_WEIGHT is a limit, and decimals of lengths are cut off.
        objective: what is wanted of a plan, a key of `OBJECTIVES`: some obey more columns. Not
            given, the least cost if bins have costs, otherwise the fewest bins.
        by_order: read a job per order of a table too: the rows that have the same in its column
            ORDER, if it has one.
        say: takes a line for everything that was assumed, such as the `append` of a list.

    Raises:
        UserError: naming the file, the row and the column (of JSON the order and the key).
    """
    reading = Reading(_capitals(ignore), packingsolver, say, objective)
    items, bins = Path(items), None if bins is None else Path(bins)
    kind = items.suffix.lower()
    if kind in TABLES:
        if bins is None:
            what = f"a {kind[1:].upper()} file of items needs one of bins too"
            raise fault(items, f"{what}: give both")
        return _jobs(read_table(items, say), read_table(bins, say), items.stem, reading, by_order)
    if kind not in (".ins2d", ".json"):
        raise fault(items, f"files '{kind}' are not known: give .csv, .xlsx, .ins2D or .json")
    given = None
    if bins is not None:
        read = understand(read_table(bins, say), BINS, reading)
        check_ignored(reading, read)
        given = _bins(read, 2 if kind == ".ins2d" else 3, Fraction(1), reading)
    else:
        check_ignored(reading)
    if kind == ".ins2d":
        return [read_ins2d(items, given, reading)]
    jobs = read_orders(items, given, copies=1 if reading.goal.leaves_out else None)
    return [replace(job, objective=objective) for job in jobs] if objective else jobs


def job_from_columns(
    items: Any,
    bins: Any,
    name: str = "",
    *,
    ignore: str | Sequence[str] = (),
    packingsolver: bool = False,
    objective: str = "",
    say: Say = silent,
) -> Job:
    """A job from tables of a program, with the columns of the CSV files.

    Args:
        items: a data frame, a dict of columns, a structured NumPy array or a list of dicts. None,
            NaN and NA are empty cells.
        bins: likewise.
        name: the job's name.
        ignore, packingsolver, objective, say: see `read_job`.

    Raises:
        UserError: naming the table, the row, counted from 0, and the column.
    """
    reading = Reading(_capitals(ignore), packingsolver, say, objective)
    tables = table_from_columns(items, "items"), table_from_columns(bins, "bins")
    return _jobs(*tables, name, reading)[0]


def _capitals(names: str | Sequence[str]) -> frozenset[str]:
    names = [names] if isinstance(names, str) else names
    return frozenset(" ".join(name.upper().split()) for name in names)


def _jobs(
    items: Table, bins: Table, name: str, reading: Reading, by_order: bool = False
) -> list[Job]:
    several = by_order and ORDER in items.columns and ORDER not in reading.ignore
    known = replace(reading, ignore=reading.ignore | {ORDER}) if several else reading
    goods, rooms = understand(items, ITEMS, known), understand(bins, BINS, reading)
    check_ignored(reading, goods, rooms)
    orders = _orders(items, goods) if several else {name: goods}
    types = {order: _items(part, reading) for order, part in orders.items()}
    factor = same_unit(goods, rooms, reading.say)
    kinds = _bins(rooms, goods.dimension, factor, reading)
    return [
        Job(own, kinds, goods.dimension, name, reading.objective) for name, own in types.items()
    ]


def _orders(items: Table, goods: Understood) -> dict[str, Understood]:
    """The rows of each order, by its name, in the order in which they first come."""
    items.need((ORDER,))
    lines: dict[str, list] = {}
    for row, line in zip(items.rows(), goods.table.lines, strict=True):
        if not (name := row.text(ORDER)):
            raise fault(row.at(ORDER), "empty: say which order the item belongs to")
        lines.setdefault(name, []).append(line)
    if not lines:
        return {"": goods}
    return {
        name: replace(goods, table=replace(goods.table, lines=own)) for name, own in lines.items()
    }


def _size(row: Row, dimension: int, whole: bool, end: float | None = None) -> Sides:
    """The sides; where there is an end, it is the last."""
    columns = SIDES[dimension] if end is None else SIDES[dimension][:-1]
    sides = [row.size(column) for column in columns]
    if whole:
        for column, side in zip(columns, sides, strict=True):
            if side < 1 or (isinstance(row.cell(column), str) and "e" in row.cell(column).lower()):
                what = f"{row.cell(column)} is read up to its first sign that is no digit"
                raise fault(row.at(column), what, "PackingSolver knows whole numbers only")
        sides = [float(math.floor(side)) for side in sides]
    sides += [] if end is None else [end]
    return (sides[0], 1.0, sides[1]) if dimension == 2 else (sides[0], sides[1], sides[2])


def _end(row: Row, dimension: int, reading: Reading) -> float | None:
    """Infinity if the height of a bin is open, which an empty cell says, -1 or inf; else None."""
    height = SIDES[dimension][-1]
    if _given(row, height) and not row.unlimited(height):
        return None
    if not reading.goal.open_bin:
        raise fault(row.at(height), "the height is open: give one, or use --objective height")
    return math.inf


def _say_cut(read: Understood, reading: Reading) -> None:
    """Says that decimals are cut off where there are any."""
    if not reading.packingsolver:
        return
    for row in read.table.rows():
        for column in SIDES[read.dimension]:
            if _given(row, column) and not row.unlimited(column) and row.size(column) % 1:
                what = f"{plain(row.size(column))} is read without its decimals"
                reading.say(note(row.at(column), f"{what}, as PackingSolver reads all lengths"))
                return


def _items(read: Understood, reading: Reading) -> tuple[ItemType, ...]:
    table = read.table
    if not table.lines:
        raise fault(table.header, "no items below the header: give at least one")
    _say_cut(read, reading)
    items = []
    total = 0
    for row in table.rows():
        copies = row.whole("COPIES", low=0) if row.has("COPIES") else 1
        total = counted(total + copies, f"{row.at('COPIES')}: {copies} copies")
        flat = read.dimension == 2
        ways = _flat_orientations(row, reading) if flat else _orientations(row, read.flags, reading)
        items.append(
            ItemType(
                _size(row, read.dimension, reading.packingsolver),
                copies,
                row.weight("WEIGHT"),
                ways,
                row.text(*NAMES),
                f"row {row.row}",
                profit=_profit(row) if "PROFIT" in reading.goal.obeys else None,
            )
        )
    if not total:
        raise fault(table.header, "all COPIES are 0: give at least one item")
    return tuple(items)


def _profit(row: Row) -> float | None:
    if not row.has("PROFIT") or row.number("PROFIT") == -1:
        return None
    return as_profit(row.number("PROFIT"), row.at("PROFIT"))


def _flat_orientations(row: Row, reading: Reading) -> tuple[str, ...]:
    return ("XYZ",) if row.flag("ORIENTED", default=not reading.packingsolver) else FLAT_TURNED


def _orientations(row: Row, columns: Sequence[str], reading: Reading) -> tuple[str, ...]:
    allowed = tuple(ROTATIONS[column] for column in columns if row.flag(column, default=False))
    if allowed or reading.packingsolver or not any(row.has(column) for column in columns):
        return allowed or ("XYZ",)
    raise fault(row.where, f"columns {', '.join(columns)}", "all are 0: allow at least one")


def _bins(
    read: Understood, dimension: int, factor: Fraction, reading: Reading
) -> tuple[BinType, ...]:
    table = read.table
    if read.dimension != dimension:
        sides = ", ".join(SIDES[dimension])
        what = f"bins of {read.dimension}D for items of {dimension}D"
        raise fault(table.header, what, f"give bins with columns {sides}")
    if not table.lines:
        raise fault(table.header, "no bins below the header: give at least one")
    _say_cut(read, reading)
    bins = []
    for row in table.rows():
        size = _size(row, dimension, reading.packingsolver, _end(row, dimension, reading))
        if factor != 1:
            x, y, z = (float(exact(s) * factor) if s < math.inf else s for s in size)
            size = x, (1.0 if dimension == 2 else y), z
        limit, none = _limit(row, reading)
        bins.append(
            BinType(
                size,
                _cost(row) if _given(row, "COST") else None,
                0 if none else _bin_copies(row, reading),
                limit,
                row.text(*NAMES),
                f"row {row.row} of {Path(table.source).name}",
            )
        )
    return tuple(bins)


def _given(row: Row, column: str) -> bool:
    """Whether the cell is neither empty nor -1, which stands for no limit."""
    return row.has(column) and (row.unlimited(column) or row.number(column) != -1)


def _bin_copies(row: Row, reading: Reading) -> int | None:
    if (reading.packingsolver or reading.goal.leaves_out) and not row.has("COPIES"):
        return 1
    if not _given(row, "COPIES") or row.unlimited("COPIES"):
        return None
    return row.whole("COPIES", low=0)


def _limit(row: Row, reading: Reading) -> tuple[float, bool]:
    """The most weight, and whether nothing can keep to it."""
    column = "MAXIMUM_WEIGHT"
    if not row.has(column) or row.unlimited(column):
        return math.inf, False
    if row.number(column) == -1:
        if not reading.packingsolver:
            return math.inf, False
        what = "-1 is a limit that nothing keeps to in PackingSolver: the bin is not used"
        reading.say(note(row.at(column), what))
        return 0.0, True
    return row.weight(column), False


def _cost(row: Row) -> float:
    cost = row.number("COST")
    if cost < 0:
        raise fault(row.at("COST"), f"{cost:g} is negative: give 0 or more, or -1 for the volume")
    return cost
