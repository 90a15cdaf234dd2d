"""The position in which most of an item touches walls and other items."""

from typing import Any


def most_contact(at: Any) -> tuple[Any, ...]:
    """Greatest area in contact, then least z."""
    return -at.contact(), at.z
