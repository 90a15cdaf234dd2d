"""What items are sorted by, the largest first: one table for orders of every kind."""

from collections.abc import Callable
from typing import Any


def _longest(length: Any, width: Any, height: Any) -> tuple[Any, ...]:
    side = length + (width - length) * (width > length)
    return (side + (height - side) * (height > side),)


SORTS: dict[str, Callable[[Any, Any, Any], tuple[Any, ...]]] = {
    "volume": lambda length, width, height: (length * width * height,),
    "footprint": lambda length, width, height: (length * width, height),
    "height": lambda length, width, height: (height, length * width),
    "longest": _longest,
}
"""Name -> (length, width, height), arrays of NumPy or JAX -> keys, the most important first."""
