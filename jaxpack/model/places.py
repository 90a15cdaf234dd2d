"""Is there a place for an item alone in an empty bin: by its sides, the overhang and obstacles."""

from fractions import Fraction
from itertools import product

from jaxpack.model.exact import clean, exact
from jaxpack.model.job import BinType, Sides
from jaxpack.model.rules import Rules

MOST = 16  # obstacles of a bin between which places are looked for

Three = tuple[Fraction, Fraction, Fraction]


def room_of(kind: BinType, rules: Rules, dimension: int) -> Sides:
    """The sides of a bin and what items may reach over its edges."""
    x, y, z = (
        clean(side + 2 * more) if more else side
        for side, more in zip(kind.size, rules.reach(dimension), strict=True)
    )
    return x, y, z


def beside_obstacles(
    kind: BinType, extent: Sides, rules: Rules, dimension: int, floor: bool
) -> bool:
    """Whether an item, which its room is large enough for, can get into a bin: no where it is
    certain.

    Args:
        kind: of the bin.
        extent: of the item as it lies, along x, y and z.
        rules: their overhang and door.
        dimension: 2 or 3.
        floor: whether it has to stand on the floor.
    """
    obstacles = kind.limits.obstacles
    if not obstacles or len(obstacles) > MOST:
        return True
    taken = [(_three(one.corner), _three(one.end)) for one in obstacles]
    beside = _through_door if rules.door else _from_above
    return beside(kind, _three(extent), _three(rules.reach(dimension)), taken, floor)


def _from_above(
    kind: BinType, size: Three, reach: Three, taken: list[tuple[Three, Three]], floor: bool
) -> bool:
    """At the beginning of the bin or the end of obstacles, on top of what is under it there."""
    ends = [
        [-reach[axis], *(end[axis] for _, end in taken if _ends(kind, size, reach, axis, end))]
        for axis in (0, 1)
    ]
    for x, y in product(*ends):
        under = [
            end[2]
            for low, end in taken
            if low[0] < x + size[0] and x < end[0] and low[1] < y + size[1] and y < end[1]
        ]
        top = max(under, default=Fraction(0))
        if (top == 0 or not floor) and (kind.open or top + size[2] <= exact(kind.size[2])):
            return True
    return False


def _through_door(
    kind: BinType, size: Three, reach: Three, taken: list[tuple[Three, Three]], floor: bool
) -> bool:
    """Right behind the door, where least is in its way."""
    x = exact(kind.size[0]) + reach[0] - size[0]
    ends = [
        [-reach[axis], *(end[axis] for _, end in taken if _ends(kind, size, reach, axis, end))]
        for axis in (1, 2)
    ]
    return any(
        not any(
            x < end[0]
            and low[1] < y + size[1]
            and y < end[1]
            and low[2] < z + size[2]
            and z < end[2]
            for low, end in taken
        )
        for y, z in product(*ends)
        if z == 0 or not floor
    )


def _ends(kind: BinType, size: Three, reach: Three, axis: int, end: Three) -> bool:
    """Whether the item, from there on, is within the bin."""
    most = kind.size[axis]
    return most == float("inf") or end[axis] + size[axis] <= exact(most) + reach[axis]


def _three(sides: Sides) -> Three:
    x, y, z = map(exact, sides)
    return x, y, z
