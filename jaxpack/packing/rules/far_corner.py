"""The lowest position, of these the one farthest from the paper's corner."""

from typing import Any


def far_corner(at: Any) -> tuple[Any, ...]:
    """Least z, then greatest y, then greatest x."""
    return at.z, -at.y, -at.x
