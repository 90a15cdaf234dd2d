"""Convex polygons in plain floats: few corners each, so that arrays would only cost time."""

from collections.abc import Sequence

Point = tuple[float, float]


def rectangle(low: Sequence[float], high: Sequence[float]) -> list[Point]:
    """Its four corners, counterclockwise."""
    return [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]


def hull(points: list[Point]) -> list[Point]:
    """The corners of the least convex polygon around points, counterclockwise.

    Of points in a line the two ends, of none nothing.
    """
    points = sorted(set(points))
    if len(points) < 3:
        return points
    halves = []
    for ordered in (points, points[::-1]):
        half: list[Point] = []
        for x, y in ordered:
            while len(half) > 1:
                (ax, ay), (bx, by) = half[-2:]
                if (bx - ax) * (y - ay) > (by - ay) * (x - ax):
                    break
                half.pop()
            half.append((x, y))
        halves.append(half[:-1])
    return halves[0] + halves[1]


def clipped(
    polygon: list[Point], low: Sequence[float], high: Sequence[float], noise: Sequence[float]
) -> list[Point]:
    """Corners of what a convex polygon and a rectangle share: an edge or a point count as well.

    Args:
        polygon: counterclockwise.
        low: the rectangle's corner with the least x and y.
        high: the opposite one.
        noise: along x and y; what misses the rectangle by less touches it.
    """
    for axis in (0, 1):
        for sign, end in ((1, low[axis] - noise[axis]), (-1, -high[axis] - noise[axis])):
            kept = []
            for one, other in zip(polygon, polygon[1:] + polygon[:1], strict=True):
                inside, next_inside = sign * one[axis] - end, sign * other[axis] - end
                if inside >= 0:
                    kept.append(one)
                if (inside < 0) != (next_inside < 0):
                    t = inside / (inside - next_inside)
                    kept.append(
                        (one[0] + (other[0] - one[0]) * t, one[1] + (other[1] - one[1]) * t)
                    )
            polygon = kept
    return [(min(max(x, low[0]), high[0]), min(max(y, low[1]), high[1])) for x, y in polygon]
