"""The most that bins can hold of the items of a job, where they cannot hold all."""

import math
from bisect import bisect_left
from collections.abc import Iterator
from fractions import Fraction
from itertools import accumulate, chain, islice, repeat
from typing import Any

import numpy as np

from jaxpack.model.exact import exact
from jaxpack.model.figures import parts_of
from jaxpack.model.goods import UNLIMITED, Goods, goods_of
from jaxpack.model.job import BinType, Job
from jaxpack.model.units import common


def most_profit(job: Job) -> tuple[Fraction, int, Goods]:
    """No subset of the items that the bins can hold is worth more, and it needs so many of the
    bins at least; and these items.
    """
    goods = goods_of(job)
    volumes, cube = _volumes(goods), goods.unit ** len(goods.axes)
    profits = [
        exact(profit) if profit >= 0 else volume * cube
        for profit, volume in zip(goods.profits.tolist(), volumes, strict=True)
    ]
    unit = common(profits) or Fraction(1)
    most, few = most_of(goods, [int(profit / unit) for profit in profits])
    return most * unit, few, goods


def cheapest(parts: tuple[str, ...], kinds: tuple[BinType, ...], bins: int) -> list[Fraction]:
    """What so many bins come to at least, by each of `figures.parts_of`."""
    each = ([parts_of(kind)[part] for kind in kinds] for part in parts)
    return [sum(_one_by_one(kinds, amounts, bins), Fraction(0)) for amounts in each]


def most_of(goods: Goods, values: list[int]) -> tuple[int, int]:
    """The most that what the bins can hold comes to by the values of rows, and in how many bins.

    By the volume of the bins and by their weight limits: the relaxed knapsack problem of each,
    where an item may be in a bin in part.
    """
    copies = goods.copies.tolist()
    if not copies:
        return 0, 0
    amounts = [(_volumes(goods), [-math.prod(room) for room in goods.filled().tolist()])]
    if (goods.limits < UNLIMITED).all():
        amounts.append((goods.weights.tolist(), (-goods.limits).tolist()))
    rooms = [
        [0, *accumulate(_one_by_one(goods.kinds, largest, sum(copies)))] for _, largest in amounts
    ]

    def within(bins: int) -> int:
        return min(
            _relaxed_knapsack(values, each, copies, -room[bins])
            for (each, _), room in zip(amounts, rooms, strict=True)
        )

    most = within(-1)
    return most, bisect_left(range(len(rooms[0])), most, key=within)


def _one_by_one(kinds: tuple[BinType, ...], amounts: list[Any], bins: int) -> Iterator[Any]:
    """Amounts of so many bins at most, the least first."""
    there = sorted(zip(amounts, kinds, strict=True), key=lambda one: one[0])
    each = (repeat(amount, bins if kind.copies is None else kind.copies) for amount, kind in there)
    return islice(chain.from_iterable(each), bins)


def _volumes(goods: Goods) -> list[int]:
    return [math.prod(row) for row in goods.sizes[0].tolist()] if len(goods.copies) else []


def _relaxed_knapsack(values: list[int], each: list[int], copies: list[int], capacity: int) -> int:
    """The most value of copies that need at most the capacity, rounded down: by its dual, which
    bounds it for any price of the capacity and is it for the right one.
    """
    density = np.array([float(v) / a if a else math.inf for v, a in zip(values, each, strict=True)])
    rows, left = np.argsort(-density, kind="stable").tolist(), capacity
    for row in rows:
        left -= each[row] * copies[row]
        if left < 0:
            price = Fraction(values[row], each[row])
            break
    else:
        price = Fraction(0)
    gain, per = price.numerator, price.denominator
    over = (max(0, per * v - gain * a) * n for v, a, n in zip(values, each, copies, strict=True))
    return (gain * capacity + sum(over)) // per
