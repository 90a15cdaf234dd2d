"""The lowest position, of these the one nearest to a corner of the bin."""

from typing import Any


def nearest_corner(at: Any) -> tuple[Any, ...]:
    """Least z, then least distance to the nearest vertical edge of the bin, along the axes."""
    distance = 0 * at.z.astype("float32")
    for near, side, room in zip((at.x, at.y), at.size, at.room, strict=False):
        far = room - near - side
        distance += near + (far - near) * (far < near)
    return at.z, distance
