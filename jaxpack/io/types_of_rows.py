"""Rows of tables as types of items and of bins."""

import math
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

from jaxpack.io.columns import NAMES, ROTATIONS, SIDES, TARIFF, Reading, Understood
from jaxpack.io.notes import note
from jaxpack.io.obstacles import with_obstacles
from jaxpack.io.tables import Row
from jaxpack.model.exact import exact
from jaxpack.model.job import FLAT_TURNED, BinType, ItemType, Sides, counted
from jaxpack.model.limits import BinLimits, ItemLimits
from jaxpack.model.numbers import as_number, as_profit, fault, plain, show
from jaxpack.model.tariff import Tariff

NO_LIMITS = ItemLimits()
LIMITS = {
    *("MAXIMUM_WEIGHT_ABOVE", "STACKABLE", "MAXIMUM_STACKABILITY", "STACKABILITY_ID"),
    *("GROUP", "APART", "STOP", "FLOOR"),
}
"""The columns of items that are limits."""
NONE = 2**31 - 1  # and what is above it is no limit in PackingSolver's files


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


def item_types(read: Understood, reading: Reading) -> tuple[ItemType, ...]:
    """The items of a table.

    Raises:
        UserError: naming the row and the column.
    """
    table = read.table
    if not table.lines:
        raise fault(table.header, "no items below the header: give at least one")
    _say_cut(read, reading)
    limited = not LIMITS.isdisjoint(table.columns)
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
                limits=_item_limits(row) if limited else NO_LIMITS,
            )
        )
    if not total:
        raise fault(table.header, "all COPIES are 0: give at least one item")
    return tuple(items)


def _item_limits(row: Row) -> ItemLimits:
    """What is asked of an item beside its size and weight."""
    above, stack = "MAXIMUM_WEIGHT_ABOVE", "MAXIMUM_STACKABILITY"
    identity = "STACKABILITY_ID"
    return ItemLimits(
        weight_above=row.weight(above) if _limited(row, above) else math.inf,
        stackable=row.flag("STACKABLE", default=True),
        most_in_stack=row.whole(stack, low=1) if _limited(row, stack) else None,
        stack_id=row.whole(identity, low=0) if row.has(identity) else 0,
        group=row.text("GROUP"),
        apart=row.text("APART"),
        stop=row.whole("STOP", low=1) if row.has("STOP") else None,
        floor=row.flag("FLOOR", default=False),
    )


def _limited(row: Row, column: str) -> bool:
    """Whether the cell is a limit: it is none where it is empty, -1, infinite or very large."""
    return _given(row, column) and not row.unlimited(column) and row.number(column) < NONE


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


def bin_types(
    read: Understood, dimension: int, factor: Fraction, reading: Reading
) -> tuple[BinType, ...]:
    """The bins of a table, with their obstacles, for items of a dimension; lengths times a factor.

    Raises:
        UserError: naming the row and the column.
    """
    table = read.table
    if read.dimension != dimension:
        sides = ", ".join(SIDES[dimension])
        what = f"bins of {read.dimension}D for items of {dimension}D"
        raise fault(table.header, what, f"give bins with columns {sides}")
    if not table.lines:
        raise fault(table.header, "no bins below the header: give at least one")
    _say_cut(read, reading)
    bins, most = [], "MAXIMUM_ITEMS"
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
                BinLimits(row.whole(most, low=1)) if _limited(row, most) else BinLimits(),
                _tariff(row, factor**dimension),
            )
        )
    return with_obstacles(bins, reading.obstacles, dimension, factor, reading.say)


def _tariff(row: Row, factor: Fraction) -> Tariff | None:
    """What is paid for a bin whose volumes are read times a factor; None if nothing is said."""
    rate, divisor, own = TARIFF
    if not row.has("BANDS") and not any(_given(row, column) for column in TARIFF):
        return None
    over = row.number(divisor) if _given(row, divisor) else None
    return Tariff(
        _bands(row),
        row.number(rate) if _given(row, rate) else 0.0,
        over if over is None or factor == 1 else float(exact(over) * factor),
        row.weight(own),
    )


def _bands(row: Row) -> tuple[tuple[float, float], ...]:
    """Weights and prices from a text such as 5:4.99 10:6.99."""
    where, bands = row.at("BANDS"), []
    for one in row.text("BANDS").split():
        weight, colon, price = one.partition(":")
        if not colon:
            what = f"{show(one)} is no band: write weight:price"
            raise fault(where, f"{what}, as in 5:4.99 10:6.99")
        bands.append((as_number(weight, where), as_number(price, where)))
    return tuple(bands)


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
