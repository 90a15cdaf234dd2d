"""A list of items to load and the bins there are, in the user's own units, and a plan for it.

Plain Python and NumPy: what files are read into and written from. Lengths are along x (length),
y (width) and z (height), in any unit, the same for all; 2D is 3D with width 1: x is the WIDTH of
a two-dimensional file and z its HEIGHT.

A job is checked and cleaned once, when it is made, whoever makes it. From then on every length is a
whole number of one unit, of which the longest side of a bin has at most `FINEST`, and every weight
of billionths: `exact` of a number of a job is what it stands for, to the last digit.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from operator import mul
from typing import Any, TypeVar

import numpy as np

from jaxpack.errors import UserError
from jaxpack.model.exact import DIGITS, clean, cut, decimals, exact, whole
from jaxpack.model.limits import BinLimits, ItemLimits, checked_limit, checked_weight
from jaxpack.model.numbers import as_cost, as_profit, as_size, as_whole, fault, show
from jaxpack.model.tariff import Tariff

FINEST = 2**30
"""A side of a bin has at most so many units: far edges of items then fit int32."""
MOST_ITEMS = 100_000  # copies of a job's items, all together

Sides = tuple[float, float, float]

ORIENTATIONS = {
    "XYZ": (0, 1, 2),
    "YXZ": (1, 0, 2),
    "ZYX": (2, 1, 0),
    "YZX": (1, 2, 0),
    "XZY": (0, 2, 1),
    "ZXY": (2, 0, 1),
}
"""Name -> which of the item's own sides lies along x, y and z of the bin."""

UPRIGHT = ("XYZ", "YXZ")
FLAT_TURNED = ("XYZ", "ZYX")  # all that 2D has: as given, and by a quarter


@dataclass(frozen=True)
class ItemType:
    """Items that are the same in every respect. `Job` checks them."""

    size: Sides  # along x, y and z as it is given, in the unit of all lengths of the job
    copies: int = 1  # how many there are; 0 for none
    weight: float = 0.0  # of one of them, in the unit of all weights of the job
    orientations: tuple[str, ...] = ("XYZ",)  # those that are allowed, keys of ORIENTATIONS
    name: str = ""  # what files and pictures call it
    where: str = field(default="", compare=False)  # in its file, such as "row 2"
    tags: tuple[Any, ...] = field(default=(), compare=False)
    """What a file says of each copy beside all this, for files that are written."""
    profit: float | None = None  # what one is worth; its volume (2D: area) if not given
    limits: ItemLimits = ItemLimits()  # what else is asked of it

    def turned(self, orientation: str) -> Sides:
        """Its extent along x, y and z in that orientation."""
        x, y, z = ORIENTATIONS[orientation]
        return self.size[x], self.size[y], self.size[z]


@dataclass(frozen=True)
class BinType:
    """Bins that are the same in every respect. `Job` checks them."""

    size: Sides  # inside, along x, y and z, in the job's unit of length; open: infinitely high
    cost: float | None = None  # of one that is used; see `Job.priced`
    copies: int | None = None  # how many there are; any number if not given
    max_weight: float = math.inf  # of all that is in one of them
    name: str = ""  # what files and pictures call it
    where: str = field(default="", compare=False)  # in its file, such as "row 2"
    limits: BinLimits = BinLimits()  # what else is asked of it
    tariff: Tariff | None = None  # what is paid for it beside its cost

    @property
    def open(self) -> bool:
        """Whether nothing says how high it is."""
        return self.size[2] == math.inf

    def price_of(self, load: Fraction = Fraction(0)) -> Fraction:
        """What one of them costs with so much weight in it: its volume if nothing is given."""
        if self.tariff:
            return exact(self.cost or 0.0) + self.tariff.price(load, self.size)
        return exact(math.prod(self.size) if self.cost is None else self.cost)


def counted(total: int, what: str) -> int:
    """The total, of items. Raises UserError, which begins with `what`, where it is too many."""
    if total > MOST_ITEMS:
        raise fault(what, f"more than {MOST_ITEMS:,} items in all: split the job")
    return total


Entry = TypeVar("Entry", ItemType, BinType)


@dataclass(frozen=True)
class Job:
    """What has to be packed into what.

    Raises:
        UserError: in one line that names the item or the bin, where a number is no size, weight
            or count, a name no text, an orientation is not known, there is nothing to pack or
            nothing to pack into, there are too many items, or in 2D a width is not 1.
    """

    items: tuple[ItemType, ...]  # with their copies
    bins: tuple[BinType, ...]  # with their copies
    dimension: int = 3  # 2 or 3
    name: str = ""  # of the order
    objective: str = ""
    """A key of `OBJECTIVES`; not given, it is price if one of the bins has a cost, else bins."""
    rounded: float | None = field(default=None, init=False, compare=False)
    """The length that finer sizes were cut off to, None if all are exact."""

    def __post_init__(self) -> None:
        if self.dimension not in (2, 3):
            raise fault("dimension", f"{show(self.dimension)} is not known: give 2 or 3")
        _check_name("the job", self.name)
        for what, known in (("items", ItemType), ("bins", BinType)):
            if not isinstance(entries := getattr(self, what), tuple | list):
                raise fault(what, show(entries), f"give a tuple of {known.__name__}")
        items = tuple(_checked_item(n, item, self.dimension) for n, item in enumerate(self.items))
        bins = tuple(_checked_bin(n, kind, self.dimension) for n, kind in enumerate(self.bins))
        count = sum(item.copies for item in items)
        if not count or not bins:
            what = "bins" if count else "items"
            raise UserError(f"{self.name or 'the job'} has no {what}: give at least one")
        if count > MOST_ITEMS:
            what = f"{count:,} items, more than {MOST_ITEMS:,}"
            raise UserError(f"{self.name or 'the job'} has {what}: split the job")
        object.__setattr__(self, "items", items)
        object.__setattr__(self, "bins", bins)
        places = self._places()
        if places is None:
            return
        del self.__dict__["_grain"]  # that of the finer lengths
        object.__setattr__(self, "rounded", 10.0**-places)
        object.__setattr__(self, "items", tuple(_cut_sides(item, places) for item in items))
        object.__setattr__(self, "bins", tuple(_cut_sides(kind, places) for kind in bins))

    def _places(self) -> int | None:
        """How many decimals of the lengths are kept, where not all of them can be.

        Any that make no more units of a side of a bin than `FINEST`, and no position of more than
        the digits that are read.
        """
        longest = exact(max(self.pile if kind.open else max(kind.size) for kind in self.bins))
        if longest > FINEST:
            what = f"its items on top of each other are {self.pile:,.0f} high, more than 2^30"
            raise UserError(f"{self.name or 'the job'}: {what}: choose a larger unit")
        unit, places = self._grain
        if longest / unit <= FINEST and longest * 10**places < 10**DIGITS:
            return None
        return max(n for n in range(places + 1) if longest * 10**n <= FINEST)

    @property
    def axes(self) -> tuple[int, ...]:
        """The axes of the sides that are given: 2D has x and z."""
        return (0, 2) if self.dimension == 2 else (0, 1, 2)

    def lengths(self) -> Iterator[float]:
        """The sides of all items and bins, but heights that are open, and those of obstacles."""
        for size in (*(item.size for item in self.items), *(kind.size for kind in self.bins)):
            x, y, z = size
            yield from (x, y) if self.dimension == 3 else (x,)
            if z < math.inf:
                yield z
        for kind in self.bins:
            for n, length in enumerate(kind.limits.lengths()):
                if n % 3 in self.axes and length:
                    yield length

    @property
    def pile(self) -> float:
        """How high the items are on the highest obstacle and each other, each turned so."""
        highest = (max(item.turned(o)[2] for o in item.orientations) for item in self.items)
        copies = (item.copies for item in self.items)
        base = max((one.end[2] for kind in self.bins for one in kind.limits.obstacles), default=0.0)
        return float(sum(map(mul, map(exact, highest), copies), exact(base)))

    def room(self, packed: "PackedBin") -> Sides:
        """The sides of a bin of a plan: up to the plan's height of it, or to the highest top if it
        has none and is open.
        """
        x, y, z = self.bins[packed.bin].size
        if packed.height is not None:
            return x, y, packed.height
        if z < math.inf:
            return x, y, z
        puts = packed.placements
        tops = (put.corner[2] + self.items[put.item].turned(put.orientation)[2] for put in puts)
        return x, y, clean(max(tops, default=0.0))

    @property
    def unit(self) -> Fraction:
        """The largest length of which every side is a whole multiple."""
        return self._grain[0]

    @cached_property
    def _grain(self) -> tuple[Fraction, int]:
        return _common_unit(self.lengths())

    @cached_property
    def count(self) -> int:
        """All copies of all items."""
        return sum(item.copies for item in self.items)

    @cached_property
    def limited(self) -> bool:
        """Whether more is asked of an item or a bin than sizes, weights and counts."""
        items = any(item.limits != ItemLimits() for item in self.items)
        return items or any(kind.limits != BinLimits() for kind in self.bins)

    @property
    def priced(self) -> bool:
        """Whether one of the bins has a cost or a tariff: those without cost their volume."""
        return self.by_load or any(kind.cost is not None for kind in self.bins)

    @property
    def by_load(self) -> bool:
        """Whether what a bin costs depends on what is in it."""
        return any(kind.tariff for kind in self.bins)


def _common_unit(lengths: Iterable[float]) -> tuple[Fraction, int]:
    """The largest length that all are multiples of, and how many decimals they have at most."""
    different = np.array(sorted(set(lengths)))
    try:
        sides, places = whole(different)
        common = int(np.gcd.reduce(sides))
    except OverflowError:  # more digits than can be kept
        places = decimals(different.tolist())
        common = math.gcd(*(int(exact(side) * 10**places) for side in different.tolist()))
    return Fraction(common, 10**places), places


def _checked_item(number: int, item: ItemType, dimension: int) -> ItemType:
    if not isinstance(item, ItemType):
        raise fault(f"item {number}", f"{show(item)} is no ItemType")
    where = item.where or f"item {number}"
    _check_name(where, item.name)
    where += f" ({item.name})" if item.name else ""
    ways = item.orientations
    if not isinstance(ways, tuple | list) or not ways:
        raise fault(where, f"orientations {show(ways)}", "give a tuple of at least one name")
    known = FLAT_TURNED if dimension == 2 else tuple(ORIENTATIONS)
    if wrong := [way for way in ways if way not in known]:
        raise fault(where, f"orientation {show(wrong[0])} is not known: use {', '.join(known)}")
    return replace(
        item,
        size=_checked_sides(where, item.size, dimension),
        copies=as_whole(item.copies, f"{where}, copies", low=0),
        weight=checked_weight(f"{where}, weight", item.weight),
        profit=None if item.profit is None else clean(as_profit(item.profit, f"{where}, profit")),
        orientations=tuple(dict.fromkeys(ways)),
        limits=_checked_limits(where, item.limits, ItemLimits),
    )


def _checked_bin(number: int, kind: BinType, dimension: int) -> BinType:
    if not isinstance(kind, BinType):
        raise fault(f"bin {number}", f"{show(kind)} is no BinType")
    # The bins of many orders are the same.
    known: dict[int, BinType] = kind.__dict__.setdefault("_checked", {})
    if dimension in known and isinstance(kind.size, tuple):
        return known[dimension]
    where = kind.where or f"bin {number}"
    _check_name(where, kind.name)
    where += f" ({kind.name})" if kind.name else ""
    cost, size = kind.cost, _checked_sides(where, kind.size, dimension, may_be_open=True)
    tariff = kind.tariff and _checked_limits(where, kind.tariff, Tariff, size)
    limit = checked_limit(f"{where}, max_weight", kind.max_weight)
    known[dimension] = replace(
        kind,
        size=size,
        cost=None if cost is None else clean(as_cost(cost, f"{where}, cost")),
        copies=None if kind.copies is None else as_whole(kind.copies, f"{where}, copies", low=0),
        max_weight=tariff.limit(limit) if tariff else limit,
        tariff=tariff,
        limits=_checked_limits(where, kind.limits, BinLimits, size, dimension),
    )
    return known[dimension]


def _check_name(where: str, name: object) -> None:
    if not isinstance(name, str):
        raise fault(where, f"name {show(name)} is no text")


Limits = TypeVar("Limits", ItemLimits, BinLimits, Tariff)


def _checked_limits(where: str, limits: Limits, known: type[Limits], *how: Any) -> Limits:
    if not isinstance(limits, known):
        raise fault(where, f"limits {show(limits)}", f"give {known.__name__}")
    return limits if limits == known() else limits.checked(where, *how)


def _checked_sides(where: str, sides: Sides, dimension: int, may_be_open: bool = False) -> Sides:
    if not isinstance(sides, tuple | list) or len(sides) != 3:
        raise fault(where, f"size {show(sides)}", "give three sides, along x, y and z")
    is_open = may_be_open and isinstance(sides[2], float) and sides[2] == math.inf
    what, given = f"{where}, size", sides[:2] if is_open else sides
    x, y, *end = [clean(as_size(side, what)) for side in given]
    z = end[0] if end else math.inf
    if dimension == 2 and y != 1:
        raise fault(where, f"size {(x, y, z)} in 2D", "give width (the second) as 1")
    return x, y, z


def _cut_sides(entry: Entry, places: int) -> Entry:
    x, y, z = (cut(side, places) if side < math.inf else side for side in entry.size)
    if isinstance(entry, BinType) and entry.limits.obstacles:
        return replace(entry, size=(x, y, z), limits=entry.limits.within((x, y, z), places))
    return replace(entry, size=(x, y, z))


@dataclass(frozen=True)
class Placement:
    """One item in its bin."""

    item: int  # index in Job.items, from 0
    orientation: str  # key of ORIENTATIONS
    corner: Sides  # x, y, z of the corner that is nearest to the origin, in the job's unit


@dataclass(frozen=True)
class PackedBin:
    """One bin that is used."""

    bin: int  # index in Job.bins, from 0
    placements: tuple[Placement, ...]  # in loading order: each rests on earlier ones or the floor
    height: float | None = None  # below which they lie; that of the bin type if not given


@dataclass(frozen=True)
class Plan:
    """A packing of a job."""

    bins: tuple[PackedBin, ...]  # in the order in which they were opened
    left_out: tuple[int, ...] = ()  # index in Job.items of every copy that was not packed
