"""The best plan of a tiny job with whole sizes, by trying everything: for bounds to be held to.

Boxes that do not overlap, wherever they are and whatever is under them, so nothing is better.
"""

import math
from functools import cache
from itertools import product

PLENTY = 99


def optimum(job):
    """What all items that fit some bin need: (bins, cost, worth), each the least on its own.

    `worth` is the least of (cost if priced, bins, volume of the bins). None where there
    are too few bins.
    """
    ways = [[_ways(item, kind) for item in job.items] for kind in job.bins]
    fitting = [
        number
        for number in range(len(job.items))
        if any(row[number] and kind.copies != 0 for row, kind in zip(ways, job.bins, strict=True))
    ]
    loads = [_loads(job, kind, row, fitting) for kind, row in zip(job.bins, ways, strict=True)]
    prices = [float(kind.price_of()) for kind in job.bins]
    rooms = [math.prod(kind.size) for kind in job.bins]

    @cache
    def best(rest, stock):
        if not rest:
            return 0, 0, (0,) * (2 + job.priced)
        first, found = rest & -rest, []
        for kind, some in enumerate(loads):
            if not stock[kind]:
                continue
            left = tuple(n - (k == kind and n < PLENTY) for k, n in enumerate(stock))
            worth = (prices[kind],) * job.priced + (1, rooms[kind])
            for load in some:
                if load & first and load & rest == load and (after := best(rest & ~load, left)):
                    more = tuple(map(sum, zip(after[2], worth, strict=True)))
                    found.append((after[0] + 1, after[1] + prices[kind], more))
        return tuple(map(min, zip(*found, strict=True))) if found else None

    stock = tuple(PLENTY if kind.copies is None else kind.copies for kind in job.bins)
    return best((1 << len(fitting)) - 1, stock), len(job.items) - len(fitting)


def _ways(item, kind):
    turned = {item.turned(way) for way in item.orientations}
    fits = item.weight <= kind.max_weight
    return [
        tuple(map(int, sides))
        for sides in sorted(turned)
        if fits and all(side <= room for side, room in zip(sides, kind.size, strict=True))
    ]


def _loads(job, kind, ways, fitting):
    """The sets of fitting items, as bits, that a bin can hold."""
    loads = {0}
    for load in range(1, 1 << len(fitting)):
        inside = [number for bit, number in enumerate(fitting) if load >> bit & 1]
        # What is in it without one of them is a load too.
        if (
            all(load & ~(1 << bit) in loads for bit in range(len(fitting)) if load >> bit & 1)
            and sum(job.items[number].weight for number in inside) <= kind.max_weight
            and all(ways[number] for number in inside)
            and _packable([ways[number] for number in inside], tuple(map(int, kind.size)))
        ):
            loads.add(load)
    return loads - {0}


def _packable(boxes, room):
    if sum(math.prod(ways[0]) for ways in boxes) > math.prod(room):
        return False
    cells = sorted(([*_placed(ways, room)] for ways in boxes), key=len)

    def place(number, taken):
        return number == len(cells) or any(
            not box & taken and place(number + 1, box | taken) for box in cells[number]
        )

    return place(0, 0)


def _placed(ways, room):
    """The cells, as bits, that a box takes wherever it may be."""
    for sides in ways:
        for corner in product(*(range(r - s + 1) for r, s in zip(room, sides, strict=True))):
            spans = [range(c, c + s) for c, s in zip(corner, sides, strict=True)]
            yield sum(1 << ((x * room[1] + y) * room[2] + z) for x, y, z in product(*spans))


def greatest_value(job):
    """The most that items in the bins can be worth, and the worth of such a plan in the fewest bins
    and then the least volume: (value, bins, volume).
    """
    ways = [[_ways(item, kind) for item in job.items] for kind in job.bins]
    every = range(len(job.items))
    loads = [
        _loads(job, kind, row, [n for n in every if row[n]])
        for kind, row in zip(job.bins, ways, strict=True)
    ]
    loads = [  # as bits of all items
        {
            sum(1 << n for bit, n in enumerate([n for n in every if row[n]]) if load >> bit & 1)
            for load in some
        }
        for some, row in zip(loads, ways, strict=True)
    ]
    profits = [math.prod(i.size) if i.profit is None else i.profit for i in job.items]

    @cache
    def best(taken, stock):
        found = [(0, 0, 0)]
        for kind, some in enumerate(loads):
            if not stock[kind]:
                continue
            left = tuple(n - (k == kind) for k, n in enumerate(stock))
            for load in some:
                if not load & taken:
                    value = sum(profits[n] for n in every if load >> n & 1)
                    more = value, -1, -math.prod(job.bins[kind].size)
                    found.append(tuple(map(sum, zip(best(taken | load, left), more, strict=True))))
        return max(found)

    return best(0, tuple(kind.copies for kind in job.bins))


def lowest(job):
    """The least height of one bin that holds all items which fit its floor."""
    (kind,) = job.bins
    ways = [_ways(item, kind) for item in job.items]
    boxes = [some for some in ways if some]
    length, width, _ = map(int, (*kind.size[:2], 0))
    for height in range(sum(max(sides[2] for sides in some) for some in boxes) + 1):
        within = [[sides for sides in some if sides[2] <= height] for some in boxes]
        if all(within) and _packable(within, (length, width, height)):
            return height
    return None
