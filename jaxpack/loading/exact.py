"""Numbers as the user wrote them: 0.1 + 0.2 is 0.3 here."""

import math
from collections.abc import Iterable
from fractions import Fraction


def exact(number: float) -> Fraction:
    """The shortest decimal that reads back as this float: what stood in the file.

    Raises:
        ValueError: it is infinite or not a number.
    """
    return Fraction(str(number))


def common_scale(numbers: Iterable[float]) -> int:
    """The least factor that makes whole numbers of all of them."""
    return math.lcm(*(exact(number).denominator for number in set(numbers)))
