"""Numbers from a user's files, tables or programs: read so that every error says where it is.

Whatever is wrong comes out as a `UserError` of one line: where, what, and what to do.
"""

import math
import re
import reprlib
from decimal import Decimal
from numbers import Real

from jaxpack.errors import UserError

LARGEST = 1e9  # of a weight or cost; its inverse is the smallest size
LONGEST = 2.0**30  # of a size

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)


def fault(*parts: object) -> UserError:
    """A UserError that says `parts` in one line."""
    text = ": ".join(str(part) for part in parts)
    return UserError("".join(c if c.isprintable() else "?" for c in text))


def show(value: object) -> str:
    """A value in a message, shortened."""
    try:
        return reprlib.repr(value)
    except ValueError:  # Python writes no int of more than 4300 digits
        return f"{type(value).__name__} of many digits"


def plain(number: float) -> int | float:
    """A number as it is written: without a trailing .0, and no NumPy type."""
    number = float(number)
    return int(number) if number.is_integer() and abs(number) < 1e15 else number


def as_number(value: object, where: str) -> float:
    """A finite number from a number or its text.

    Raises:
        UserError: where it is none.
    """
    if value is None or (isinstance(value, str) and not value.strip()):
        raise fault(where, "empty: give a number")
    if isinstance(value, str):
        number = float(value) if _NUMBER.fullmatch(value.strip()) else None
    elif isinstance(value, float | int | Real | Decimal) and not isinstance(value, bool):
        try:
            number = float(value)
        except (OverflowError, ValueError):  # an int or a Decimal that has no float
            number = math.inf
    else:
        number = None
    if number is None:
        raise fault(where, f"{show(value)} is not a number: give one such as 12.5")
    if not math.isfinite(number):
        raise fault(where, f"{number} is not a finite number: give one such as 12.5")
    return number


def as_size(value: object, where: str) -> float:
    """The length of a side: more than 0, between 1e-9 and 2^30; UserError if not."""
    number = as_number(value, where)
    if number <= 0:
        raise fault(where, f"{plain(number)} is not a size: give more than 0")
    if not 1 / LARGEST <= number <= LONGEST:
        what = f"{number:.10g} is out of range: choose a unit with sizes in 1e-9 to 2^30"
        raise fault(where, what)
    return number


def as_weight(value: object, where: str) -> float:
    """A weight: 0 to 1e9; UserError if not."""
    number = as_number(value, where)
    if not 0 <= number <= LARGEST:
        raise fault(where, f"{plain(number)} is not a weight: give 0 to 1e9")
    return number


def as_cost(value: object, where: str) -> float:
    """A cost: 0 to 1e9; UserError if not."""
    number = as_number(value, where)
    if not 0 <= number <= LARGEST:
        raise fault(where, f"{plain(number)} is not a cost: give 0 to 1e9")
    return number


def as_profit(value: object, where: str) -> float:
    """What an item is worth: 0 to 1e27, which is the largest volume; UserError if not."""
    number = as_number(value, where)
    if not 0 <= number <= LARGEST**3:
        raise fault(where, f"{plain(number)} is not a profit: give 0 to 1e27")
    return number


def as_whole(value: object, where: str, low: int, high: int | None = None) -> int:
    """A whole number, at least `low` and at most `high`; UserError if not."""
    number = as_number(value, where)
    if not number.is_integer() or number < low or (high is not None and number > high):
        limits = f"at least {low}" if high is None else f"{low} to {high}"
        raise fault(where, f"{plain(number)} is not possible: give a whole number, {limits}")
    return int(number)
