"""Numbers as the user meant them: 0.1 + 0.2 is 0.3 here.

A number counts to its 13th significant digit: what comes after that is the noise of floats, not a
length.
"""

import math
from collections.abc import Iterable
from decimal import ROUND_FLOOR, Decimal
from fractions import Fraction
from functools import lru_cache

import numpy as np

DIGITS = 13  # significant ones


@lru_cache(2**14)  # few lengths and weights come again and again
def exact(number: float) -> Fraction:
    """The decimal of 13 significant digits that is nearest to this float.

    Raises:
        ValueError: it is infinite or not a number.
    """
    return Fraction(_text(number))


def common_scale(numbers: Iterable[float]) -> int:
    """The least factor that makes whole numbers of all of them."""
    return math.lcm(*(exact(number).denominator for number in set(numbers)))


def decimals(numbers: Iterable[float]) -> int:
    """How many decimals these numbers have at most."""
    return max((max(0, -_exponent(number)) for number in set(numbers)), default=0)


def cut(number: float, places: int) -> float:
    """The number without what comes after so many decimals, but never 0."""
    unit = Decimal(1).scaleb(-places)
    return float(max(Decimal(_text(number)).quantize(unit, ROUND_FLOOR), unit))


def clean(number: float) -> float:
    """The float that is nearest to its 13 digits: `exact` of it is what `str` shows of it."""
    whole = abs(number) < 10**DIGITS and number % 1 == 0
    return float(number if whole else _text(number))


def volume(size: Iterable[float]) -> Fraction:
    """Of a box, to the last digit."""
    return math.prod((exact(side) for side in size), start=Fraction(1))


def whole(numbers: np.ndarray) -> tuple[np.ndarray, int]:
    """Clean numbers as whole ones, many at a time.

    Args:
        numbers: float [...], each of which `clean` leaves as it is.

    Returns:
        int64 [...] and how many decimals they have at most: number * 10**decimals is whole.
    """
    largest = np.abs(numbers).max(initial=0.0)
    for places in range(DIGITS + 10):  # a power of ten that is exact as a float
        if largest * 10.0**places >= 2**50:  # a product may be a whole number off
            break
        scaled = np.rint(numbers * 10.0**places)
        if (scaled / 10.0**places == numbers).all():
            return scaled.astype(np.int64), places
    flat = numbers.ravel().tolist()
    places = decimals(flat)
    known = {number: int(exact(number) * 10**places) for number in set(flat)}
    return np.array([known[number] for number in flat], np.int64).reshape(numbers.shape), places


def _text(number: float) -> str:
    return f"{number:.{DIGITS}g}"


def _exponent(number: float) -> int:
    exponent = Decimal(_text(number)).normalize().as_tuple().exponent
    if isinstance(exponent, str):
        raise ValueError(f"{number} is no finite number")
    return exponent
