"""What a job may ask of single items and bins beside their sizes and weights; off if not given."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

from jaxpack.model.exact import clean, cut, decimals, exact
from jaxpack.model.numbers import as_number, as_size, as_weight, as_whole, fault, plain, show

Sides = tuple[float, float, float]

WEIGHT_DECIMALS = 9  # whole numbers of these fit int64, up to the largest weight
MOST_OBSTACLES = 1_000  # of a bin


@dataclass(frozen=True)
class ItemLimits:
    """What is asked of every copy of an item. `Job` checks them.

    One item lies on another if its base is at that one's top, with an area in common.
    """

    weight_above: float = math.inf  # that may rest on it, passed on by area of contact
    stackable: bool = True  # whether anything may lie on it
    most_in_stack: int | None = None  # items in a stack that it is in, itself included
    stack_id: int = 0  # it lies only on items of the same
    group: str = ""  # those of one are in one bin if they fit one
    apart: str = ""  # no two of one are in one bin, be they copies of one item
    stop: int | None = None  # where it is unloaded, from 1; after all others if not given
    floor: bool = False  # whether it has to stand on the floor

    def checked(self, where: str) -> "ItemLimits":
        """The same, if every one is of its type and in its range; otherwise a UserError."""
        for name in ("stackable", "floor"):
            if not isinstance(given := getattr(self, name), bool):
                raise fault(f"{where}, {name}", f"{show(given)}: give True or False")
        for name in ("group", "apart"):
            if not isinstance(given := getattr(self, name), str):
                raise fault(f"{where}, {name}", f"{show(given)} is no text")
        return replace(
            self,
            weight_above=checked_limit(f"{where}, weight_above", self.weight_above),
            most_in_stack=_checked_count(f"{where}, most_in_stack", self.most_in_stack),
            stack_id=as_whole(self.stack_id, f"{where}, stack_id", low=0),
            stop=_checked_count(f"{where}, stop", self.stop),
        )


@dataclass(frozen=True)
class Obstacle:
    """A part of a bin that is taken. Items may lie on it."""

    corner: Sides  # the one nearest to the origin
    size: Sides  # along x, y and z

    def checked(self, where: str, room: Sides, dimension: int) -> "Obstacle":
        """The same, if it is a box within a bin of those sides; otherwise a UserError."""
        for what in ("corner", "size"):
            given = getattr(self, what)
            if not isinstance(given, tuple | list) or len(given) != 3:
                raise fault(f"{where}, {what}", show(given), "give three numbers, of x, y and z")
        x, y, z = [clean(as_number(side, f"{where}, corner")) for side in self.corner]
        length, width, height = [clean(as_size(side, f"{where}, size")) for side in self.size]
        if dimension == 2 and (y, width) != (0, 1):
            raise fault(where, f"y {plain(y)}, width {plain(width)} in 2D", "give 0 and 1")
        checked = Obstacle((x, y, z), (length, width, height))
        for axis, low, high, end in zip("xyz", checked.corner, checked.end, room, strict=True):
            if low < 0 or high > end:
                what = f"from {plain(low)} to {plain(high)} along {axis}, and the bin is"
                raise fault(where, f"{what} from 0 to {plain(end)}", "give what is inside")
        return checked

    @property
    def end(self) -> Sides:
        """The corner that is farthest from the origin."""
        x, y, z = (
            float(exact(low) + exact(side))
            for low, side in zip(self.corner, self.size, strict=True)
        )
        return x, y, z

    def within(self, room: Sides, places: int | None = None) -> "Obstacle | None":
        """What is of it in a bin of those sides, outwards to so many decimals; None if nothing."""
        low, high = list(self.corner), [*map(min, self.end, room)]
        if places is not None:
            unit = 10**places
            low = [math.floor(exact(side) * unit) / unit for side in low]
            high = [
                min(math.ceil(exact(side) * unit) / unit, end)
                for side, end in zip(high, room, strict=True)
            ]
        (x, y, z), (length, width, height) = (
            low,
            (float(exact(b) - exact(a)) for a, b in zip(low, high, strict=True)),
        )
        inside = min(length, width, height) > 0
        return Obstacle((x, y, z), (length, width, height)) if inside else None

    def meets(self, other: "Obstacle") -> bool:
        """Whether they have room in common."""
        ends = zip(self.corner, self.end, other.corner, other.end, strict=True)
        return all(a < d and c < b for a, b, c, d in ends)


@dataclass(frozen=True)
class BinLimits:
    """What is asked of every bin of a type. `Job` checks them."""

    most_items: int | None = None  # in one of them
    obstacles: tuple[Obstacle, ...] = ()  # of which none overlap
    overhang: float = 0.0  # `Rules.overhang`, for bounds alone, which know no rules

    def checked(self, where: str, room: Sides, dimension: int) -> "BinLimits":
        """The same, if all are of their type and in their range; otherwise a UserError."""
        if not isinstance(self.obstacles, tuple | list):
            raise fault(where, f"obstacles {show(self.obstacles)}", "give a tuple of Obstacle")
        if len(self.obstacles) > MOST_OBSTACLES:
            raise fault(where, f"more than {MOST_OBSTACLES:,} obstacles")
        obstacles = []
        for number, one in enumerate(self.obstacles):
            if not isinstance(one, Obstacle):
                raise fault(where, f"obstacle {number}", f"{show(one)} is no Obstacle")
            obstacles.append(one.checked(f"{where}, obstacle {number}", room, dimension))
        for (first, one), (second, other) in combinations(enumerate(obstacles), 2):
            if one.meets(other):
                raise fault(where, f"obstacles {first} and {second} overlap: cut one of them")
        return replace(
            self,
            most_items=_checked_count(f"{where}, most_items", self.most_items),
            obstacles=tuple(obstacles),
        )

    def within(self, room: Sides, places: int | None = None) -> "BinLimits":
        """The same for a bin of those sides: see `Obstacle.within`."""
        some = (one.within(room, places) for one in self.obstacles)
        return replace(self, obstacles=tuple(one for one in some if one))

    def lengths(self) -> Iterator[float]:
        """Those of the obstacles, and where they begin."""
        for one in self.obstacles:
            yield from (*one.corner, *one.size)


def checked_weight(where: str, weight: float) -> float:
    """A weight to a billionth; UserError if it is none."""
    weight = clean(as_weight(weight, where))
    fine = not weight.is_integer() and decimals([weight]) > WEIGHT_DECIMALS
    return cut(weight, WEIGHT_DECIMALS) if fine else weight


def checked_limit(where: str, weight: float) -> float:
    """A weight, or infinity for none; UserError if it is neither."""
    none = isinstance(weight, float) and weight == math.inf
    return weight if none else checked_weight(where, weight)


def _checked_count(where: str, count: object) -> int | None:
    return None if count is None else as_whole(count, where, low=1)
