"""The position under which the least volume stays empty: nothing gets there any more."""

from typing import Any


def least_wasted(at: Any) -> tuple[Any, ...]:
    """Least volume below the item that nothing fills, then least z."""
    return at.waste(), at.z
