"""What no plan can do without that leaves out no item that fits: bins, and their cost.

Bounds count the items that fit some bin: the others are left out of every plan. They hold for
boxes that do not overlap, however they rest on each other.
"""

import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from itertools import chain

import numpy as np

from jaxpack.model.bands import least_prices
from jaxpack.model.cover import Need, least
from jaxpack.model.figures import parts_of
from jaxpack.model.goods import LONGEST, UNLIMITED, Goods, goods_of
from jaxpack.model.hints import apart_items
from jaxpack.model.job import BinType, Job
from jaxpack.model.knapsack import cheapest, most_of
from jaxpack.model.martello import at_least, l1_and_l2, one_dimensional
from jaxpack.model.scales import scaled_needs
from jaxpack.model.sums import sums
from jaxpack.model.units import common

WORK = 2**23  # products of lengths in scales, about: a tenth of a second
LIGHT = 40  # bits of a weight
HEIGHTS = 12  # that are tried
ALIKE = 4  # rows of items of which it is found out how many bins they need alone


@dataclass(frozen=True)
class Bounds:
    """What every plan has at least that leaves out no item that fits some bin."""

    bins: int
    cost: float  # see `figures.total_cost`: bins without a cost count with their volume
    unfit: int  # copies of items that no bin can hold: they are left out of every plan
    worth: tuple[Fraction | int, ...]  # no plan has a smaller `Objective.worth`
    best: float  # nor a better `Objective.measure`


def bin_bounds(parts: tuple[str, ...], job: Job, seconds: float | None = None) -> Bounds:
    """Bounds of a job, in work that hardly grows with it: a fraction of a second, under 200 MB.

    Where there are not as many bins as are needed, no plan is what `bins` and `cost` are for; what
    they are then means nothing. `worth` is of what the bins can hold.

    Args:
        parts: what of the bins is minimised, the most important first: see `figures.parts_of`.
        job: items and bins.
        seconds: after which no more bounds are tried: the first few are had in any case.
    """
    if not job.by_load:
        return _bin_bounds(parts, job, seconds)
    found = (_bin_bounds(parts, some, seconds, more) for some, more in least_prices(job))
    return max(found, key=lambda one: (one.worth, one.cost))


def _bin_bounds(
    parts: tuple[str, ...], job: Job, seconds: float | None, more: Fraction = Fraction(0)
) -> Bounds:
    """The same, with what all items cost beside the empty bins."""
    begun = time.monotonic()
    goods = goods_of(job)
    if not len(goods.copies):
        return Bounds(0, 0.0, goods.unfit, (goods.unfit, *(0 for _ in parts)), 0.0)
    costs = np.array([float(parts_of(kind)["cost"]) for kind in goods.kinds])
    needs = [Need(max(1, _most_apart(job) - goods.unfit), (1,) * len(costs))]
    for need in chain(_on_floor(job, goods), _needs(goods, costs)):
        needs.append(need)
        if seconds is not None and time.monotonic() - begun > seconds:
            break
    (bins,) = _least(("bins",), goods.kinds, needs)
    needs.append(Need(int(bins), (1,) * len(costs)))
    sums = _least(parts, goods.kinds, needs)
    cost = sums[0] if parts[0] == "cost" else _least(("cost",), goods.kinds, needs)[0]
    if not goods.unfit:  # their weight is left out
        cost += more
        sums = [sum + more * (part == "cost") for sum, part in zip(sums, parts, strict=True)]
    worth: tuple[Fraction | int, ...] = (goods.unfit, *sums)
    if all(kind.copies is not None for kind in goods.kinds):
        most, few = most_of(goods, [1] * len(goods.copies))
        if missing := int(goods.copies.sum()) - most:
            worth = goods.unfit + missing, *cheapest(parts, goods.kinds, few)
    return Bounds(int(bins), float(cost), goods.unfit, worth, float(sums[0]))


def volume_bound(job: Job) -> int:
    """Bins until their volumes, the largest first, hold the volume of the items."""
    return _by_volume(goods_of(job))


def weight_bound(job: Job) -> int:
    """The same for the weight, and that two items above half the limit share no bin.

    0 if no bin has a limit.
    """
    return _by_weight(goods_of(job))


def martello_bounds(job: Job, halves: bool = False) -> tuple[int, int]:
    """The bounds L1 and L2: see `jaxpack.model.martello`, for `halves` too."""
    return l1_and_l2(goods_of(job), halves)


def least_height(job: Job, seconds: float | None = None) -> tuple[Fraction, Goods]:
    """No plan with all items that fit into the one bin is lower; and these items.

    By the volume over the floor and by the highest item, then by heights at which `bin_bounds`
    proves that one bin is not enough. Every height is one of items on top of each other.

    Args:
        job: with one bin, which has a height.
        seconds: after which no more heights are tried.
    """
    begun, goods = time.monotonic(), goods_of(job)
    if not len(goods.copies):
        return Fraction(0), goods
    rooms, heights = goods.filled()[0].tolist(), goods.sizes[..., 2]
    volumes = _sum_of_products(*goods.sizes[0].T, goods.copies)
    least = max(-(-volumes // (rooms[0] * rooms[1])), int(heights.min(0).max()))
    low, high, tried, step = least - 1, math.inf, least, 1 + least // 256
    for _ in range(HEIGHTS):
        if _needs_two(goods, tried):
            low = tried
        else:
            high = tried
        if high - low <= 1 or (seconds is not None and time.monotonic() - begun > seconds):
            break
        tried, step = (low + step, 2 * step) if high == math.inf else ((low + int(high)) // 2, step)
    least = low + 1
    if goods.rooms[0, 2] <= LONGEST:
        above = sums(heights, goods.copies, int(goods.rooms[0, 2])) >> least
        least += (above & -above).bit_length() - 1 if above else 0
    return least * goods.unit, goods


def _needs_two(goods: Goods, height: int) -> bool:
    """Whether a bin of that height is provably too low for all."""
    rooms = goods.rooms.copy()
    rooms[:, 2] = height
    fits = goods.sizes[..., 2] <= height  # [ways, rows]
    first = np.take_along_axis(goods.sizes, fits.argmax(0)[None, :, None], 0)
    sizes = np.where(fits[..., None], goods.sizes, first)
    lower = replace(goods, sizes=sizes, rooms=rooms, limits=np.full(len(rooms), UNLIMITED))
    return any(_bins(need) > 1 for need in _needs(lower, np.ones(len(rooms))))


def _least(parts: tuple[str, ...], kinds: tuple[BinType, ...], needs: list[Need]) -> list[Fraction]:
    """See `least`: what the bins come to in every part of the price."""
    prices, units = _prices(parts, kinds)
    if len(kinds) == 1:
        bins = max(map(_bins, needs))
        found = tuple(bins * each for each in prices[0])
    else:
        copies = [math.inf if kind.copies is None else kind.copies for kind in kinds]
        found = least(prices, copies, needs)
    return [price * unit for price, unit in zip(found, units, strict=True)]


@lru_cache(256)  # the bins of many orders are the same
def _prices(
    parts: tuple[str, ...], kinds: tuple[BinType, ...]
) -> tuple[list[tuple[int, ...]], list[Fraction]]:
    """(What a bin of each type costs, by part, in whole units; the units.)"""
    each = [[parts_of(kind)[part] for kind in kinds] for part in parts]
    units = list(map(_unit, each))
    prices = [[int(price / unit) for price in some] for some, unit in zip(each, units, strict=True)]
    return list(zip(*prices, strict=True)), units


def _unit(prices: list[Fraction]) -> Fraction:
    """The largest price of which all are whole multiples."""
    return common(prices) or Fraction(1)


def _bins(need: Need) -> int:
    """Of the one type that there is."""
    (each,) = need.of_kind
    return at_least(float(need.amount), float(each)) if need.amount else 0


def _needs(goods: Goods, price: np.ndarray) -> Iterator[Need]:
    """What the bins of a plan have to come up to, in volume, weight and number."""
    yield _number(goods)
    yield from _alone(goods)
    groups = list(goods.groups())
    prices = [np.ones(len(price))]
    if len(set(price.tolist())) > 1:
        prices.append(price)
    for group in groups:
        if group is not goods:
            yield _number(group)
        sizes, rooms = group.sizes[..., list(group.axes)], group.filled()[:, list(group.axes)]
        yield from scaled_needs(sizes, group.copies, rooms, prices, WORK // len(groups))
        weights, copies, limits = _heavy(group)
        if len(weights):
            lengths = weights[None, :, None]
            yield from scaled_needs(lengths, copies, limits[:, None], prices, WORK // 8)


def _on_floor(job: Job, goods: Goods) -> Iterator[Need]:
    """The same for items that have to stand on the floor: none of them is above another."""
    items = tuple(item for item in job.items if item.limits.floor)
    if not items:
        return
    own = goods_of(replace(job, items=items))
    if not len(own.copies):
        return
    # The first way counts for the area, so that has to be the least of any.
    least_base = np.argsort(own.sizes[..., :2].prod(2), axis=0, kind="stable")
    sizes = np.take_along_axis(own.sizes, least_base[..., None], 0)
    flat = replace(
        own,
        sizes=np.where(np.arange(3) == 2, 1, sizes),
        rooms=np.where(np.arange(3) == 2, 1, own.rooms),
        axes=tuple(axis for axis in own.axes if axis != 2),
    )
    for need in _needs(flat, np.ones(len(own.kinds))):
        each = dict(zip(own.kinds, need.of_kind, strict=True))
        yield replace(need, of_kind=tuple(each.get(kind, 0) for kind in goods.kinds))


def _number(goods: Goods) -> Need:
    count = max(_by_volume(goods), _by_weight(goods), _by_number(goods))
    # What fits side by side needs one bin, and no bound says more.
    lengths = goods.copies @ goods.sizes.min(0)
    if (lengths[list(goods.axes)] > goods.rooms.max(0)[list(goods.axes)]).all():
        count = max(count, l1_and_l2(goods, halves=True)[1])
    return Need(count, tuple((goods.rooms.min(1) > 0).astype(int).tolist()))


def _most_apart(job: Job) -> int:
    """The most items of which no two are in one bin."""
    return max((sum(i.copies for i in some) for some in apart_items(job).values()), default=0)


def _alone(goods: Goods) -> Iterator[Need]:
    """Of the rows with most volume, how many of such items alone a bin holds: a whole number."""
    volumes = goods.sizes[0].astype(float).prod(1)
    for row in np.argsort(-volumes * goods.copies, kind="stable")[:ALIKE].tolist():
        own = replace(goods, sizes=goods.sizes[:, [row]], copies=goods.copies[[row]])
        volume, weight = math.prod(own.sizes[0, 0].tolist()), int(goods.weights[row])
        most = [math.prod(room) // volume for room in own.filled().tolist()]
        if weight:
            most = [
                min(n, limit // weight)
                for n, limit in zip(most, goods.limits.tolist(), strict=True)
            ]
        there = goods.fits[row].tolist()
        yield Need(
            int(goods.copies[row]),
            tuple(n if fit else 0 for n, fit in zip(most, there, strict=True)),
        )


def _by_volume(goods: Goods) -> int:
    total = _sum_of_products(*goods.sizes[0].T, goods.copies)
    return _fewest(total, _capacities(goods, map(math.prod, goods.rooms.tolist())))


def _by_number(goods: Goods) -> int:
    total, used = int(goods.copies.sum()), goods.rooms.min(1) > 0
    most = (kind.limits.most_items or total for kind in goods.kinds)
    each = (count if some else 0 for count, some in zip(most, used.tolist(), strict=True))
    return _fewest(total, _capacities(goods, each))


def _by_weight(goods: Goods) -> int:
    weights, copies, limits = _heavy(goods)
    if not len(weights):
        return 0
    total = _sum_of_products(goods.weights, goods.copies)
    fewest = _fewest(total, _capacities(goods, goods.limits.tolist()))
    if total <= goods.limits.max():
        return fewest
    return max(fewest, one_dimensional(2 * weights, copies, int(2 * limits.max())))


def _heavy(goods: Goods) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights and copies of what has a weight [n], and limits [kinds]; none if no bin has one.

    Rounded down to few bits: what is in a bin stays within its limit, as a sum rounded down is no
    less than that of its parts. A bin without limit can hold all that there is.
    """
    total = _sum_of_products(goods.weights, goods.copies)
    limits = np.array([min(limit, total) for limit in goods.limits.tolist()], object)
    shift = max(0, int(limits.max()).bit_length() - LIGHT)
    some = (goods.weights >> shift > 0) & bool((goods.limits < UNLIMITED).any())
    return goods.weights[some] >> shift, goods.copies[some], (limits >> shift).astype(np.int64)


def _sum_of_products(*columns: np.ndarray) -> int:
    return sum(map(math.prod, zip(*(column.tolist() for column in columns), strict=True)))


def _capacities(goods: Goods, each: Iterable[int]) -> list[tuple[int, int | None]]:
    copies = (kind.copies for kind in goods.kinds)
    return list(zip(each, copies, strict=True))


def _fewest(amount: int, bins: list[tuple[int, int | None]]) -> int:
    """How many of these (capacity, copies) hold an amount; all of them if it is too much."""
    count = 0
    for capacity, copies in sorted(bins, key=lambda kind: kind[0], reverse=True):
        if amount <= 0 or capacity <= 0:
            break
        full = -(-amount // capacity)
        taken = full if copies is None else min(full, copies)
        count += taken
        amount -= taken * capacity
    return count
