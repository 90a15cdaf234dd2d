"""Columns that are known and not obeyed, most of PackingSolver, and when they ask for nothing."""

import math
from collections.abc import Callable

from jaxpack.io.tables import Row
from jaxpack.model.numbers import fault

Harmless = Callable[[Row, str], bool]  # whether the cell of that column asks for nothing

_AXLES = ("MIDDLE_AXLE_MAXIMUM_WEIGHT", "REAR_AXLE_MAXIMUM_WEIGHT")
_TRUCK = (
    "IS_SEMI_TRAILER_TRUCK",
    "TRACTOR_WEIGHT",
    "FRONT_AXLE_MIDDLE_AXLE_DISTANCE",
    "FRONT_AXLE_TRACTOR_GRAVITY_CENTER_DISTANCE",
    "FRONT_AXLE_HARNESS_DISTANCE",
    "EMPTY_TRAILER_WEIGHT",
    "HARNESS_REAR_AXLE_DISTANCE",
    "TRAILER_GRAVITY_CENTER_REAR_AXLE_DISTANCE",
    "TRAILER_START_HARNESS_DISTANCE",
)
_FRAGILE = ("FRAGILE", "NO_STACK", "NO_STACKING", "NOT_STACKABLE", "NON_STACKABLE")
_INSTEAD = {"GROUP_ID": "STOP", **dict.fromkeys(_FRAGILE, "STACKABLE 0")}
"""What says the same here."""
_TRIMS = ("LEFT_TRIM", "RIGHT_TRIM", "BOTTOM_TRIM", "TOP_TRIM")


def zero(row: Row, column: str) -> bool:
    """Whether the cell is 0."""
    return row.number(column) == 0


def _none(row: Row, column: str) -> bool:
    return row.number(column) == -1


def _no(row: Row, column: str) -> bool:
    return not row.flag(column, default=False)


def _any(row: Row, column: str) -> bool:
    return True  # says how another column is meant


def _no_limit(row: Row, column: str) -> bool:
    return row.unlimited(column) or row.number(column) >= 2**31 - 1


def _all_copies(row: Row, column: str) -> bool:
    return row.number(column) == (row.number("COPIES") if row.has("COPIES") else 1)


def _volume(row: Row, column: str) -> bool:
    sides = ("X", "Y", "Z") if row.has("X") else ("WIDTH", "HEIGHT")
    volume = math.prod(row.size(side) for side in sides)
    return row.number(column) == -1 or math.isclose(row.number(column), volume, rel_tol=1e-5)


OF_ITEMS: dict[str, Harmless] = {
    "COPIES_MIN": _all_copies,
    "PROFIT": _volume,
    "GROUP_ID": zero,
    "NESTING_HEIGHT": zero,
    "NESTING_LENGTH": zero,
    "MAXIMUM_WEIGHT_AFTER": _no_limit,
    "ELIGIBILITY_ID": _none,
    "STACK_ID": _none,
    **dict.fromkeys(_FRAGILE, _no),
}
OF_BINS: dict[str, Harmless] = {
    "COPIES_MIN": zero,
    "MAXIMUM_STACK_DENSITY": _no_limit,
    **dict.fromkeys(_TRUCK, zero),
    **dict.fromkeys(_AXLES, _no_limit),
    **dict.fromkeys(_TRIMS, zero),
    **{f"{trim}_TYPE": _any for trim in _TRIMS},
}


def check_foreign(row: Row, column: str, harmless: Harmless) -> None:
    """Refuses a cell that asks for what is not obeyed here.

    Raises:
        UserError: naming the row and the column.
    """
    if row.has(column) and not harmless(row, column):
        instead = f"say it with {_INSTEAD[column]}, or " if column in _INSTEAD else ""
        advice = f"{instead}plan without it with --ignore {column}"
        raise fault(row.at(column), "is not obeyed here", advice)
