"""The paper's rule (section II.C): the lowest position, of these the first along y, then x."""

from typing import Any


def lowest(at: Any) -> tuple[Any, ...]:
    """Least z; see `jaxpack.packing.rules`."""
    return (at.z,)
