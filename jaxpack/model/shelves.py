"""Do some items fit an empty bin together? A plain rule that says yes only where it is certain.

It is the same for whoever packs and for the check: the items of a group that fit a bin by it have
to be in one. What it lays out keeps to all rules, so that there is such a load: columns of items,
each standing on the whole of its base, and the columns in rows along x.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from operator import le

from jaxpack.model.exact import exact
from jaxpack.model.job import BinType, ItemType, Job, Placement
from jaxpack.model.limits import ItemLimits
from jaxpack.model.rules import Rules

Lengths = tuple[Fraction, Fraction, Fraction]
Piece = tuple[int, str, Lengths, Fraction]
"""Index of the item, orientation, extent, and the height at which it stands."""


def fits_one_bin(job: Job, items: Sequence[int], kind: BinType, rules: Rules) -> bool:
    """Whether `shelved` finds a place for all copies of these items, by index in `Job.items`."""
    return shelved(job, items, kind, rules) is not None


def shelved(
    job: Job, items: Sequence[int], kind: BinType, rules: Rules
) -> tuple[Placement, ...] | None:
    """All copies of some items in one bin, in loading order; None if that is not certain.

    Every item stands as its footprint is least. The largest footprints come first. An item goes on
    the last column if it is within the top of that; if one of the two is asked for more than a
    group, it begins a column instead. The columns with the widest footprints come first; where
    there is a door, those that are unloaded last.

    Args:
        job: what the items are of.
        items: by index in `Job.items`.
        kind: of the bin; with obstacles, or a balance to be kept, nothing is certain.
        rules: that hold for every item.
    """
    if kind.limits.obstacles or kind.open or rules.balance is not None:
        return None
    items = [index for index in items if job.items[index].copies]
    types, room = [job.items[index] for index in items], _lengths(kind.size)
    apart = [one.limits.apart for one in types for _ in range(one.copies) if one.limits.apart]
    most, weight = kind.limits.most_items, sum(exact(one.weight) * one.copies for one in types)
    if (
        len(set(apart)) < len(apart)
        or (most is not None and sum(one.copies for one in types) > most)
        or (kind.max_weight < math.inf and weight > exact(kind.max_weight))
    ):
        return None
    standing = []
    for index, item in zip(items, types, strict=True):
        turned = {way: _lengths(item.turned(way)) for way in item.orientations}
        ways = [way for way, size in turned.items() if all(map(le, size, room))]
        if not ways:
            return None
        way = min(ways, key=lambda way: turned[way][0] * turned[way][1])
        standing.append((index, way, turned[way]))
    volume = sum(math.prod(size) * job.items[index].copies for index, _, size in standing)
    if volume > math.prod(room):
        return None
    standing.sort(key=lambda one: (-one[2][0] * one[2][1], -one[2][2], one[0]))
    gaps = _lengths(rules.spacing(job.dimension))
    columns = _columns(job, standing, room[2], gaps[2], rules.heavy_below)
    if rules.door:
        columns.sort(key=lambda column: (-_stop(job.items[column[0][0]]), -column[0][2][1]))
    else:
        columns.sort(key=lambda column: -column[0][2][1])
    return _in_rows(columns, room, gaps)


def _columns(
    job: Job, standing: list[tuple[int, str, Lengths]], high: Fraction, gap: Fraction, heavy: bool
) -> list[list[Piece]]:
    """Items on top of each other."""
    columns = list[list[Piece]]()
    for index, way, size in standing:
        item = job.items[index]
        for _ in range(item.copies):
            z = Fraction(0)
            if columns and _plain(item):
                below, _, base, start = columns[-1][-1]
                under, z = job.items[below], start + base[2] + gap
                if not (
                    _plain(under)
                    and size[0] <= base[0]
                    and size[1] <= base[1]
                    and z + size[2] <= high
                    and not (heavy and item.weight > under.weight)
                ):
                    z = Fraction(0)
            if not z:
                columns.append([])
            columns[-1].append((index, way, size, z))
    return columns


def _in_rows(
    columns: list[list[Piece]], room: Lengths, gaps: Lengths
) -> tuple[Placement, ...] | None:
    """The columns beside each other; None where the floor is full."""
    places, x, y, wide = list[Placement](), Fraction(0), Fraction(0), Fraction(0)
    for column in columns:
        length, width, _ = column[0][2]
        if x + length > room[0]:
            x, y, wide = Fraction(0), y + wide + gaps[1], Fraction(0)
        if y + width > room[1]:
            return None
        places += [Placement(i, way, (float(x), float(y), float(z))) for i, way, _, z in column]
        x, wide = x + length + gaps[0], max(wide, width)
    return tuple(places)


def _plain(item: ItemType) -> bool:
    """Whether it may lie on any item, and any on it."""
    return replace(item.limits, group="", apart="") == ItemLimits()


def _stop(item: ItemType) -> float:
    return math.inf if item.limits.stop is None else item.limits.stop


def _lengths(sides: Sequence[float]) -> Lengths:
    x, y, z = map(exact, sides)
    return x, y, z
