"""Fills one bin after the other, again and again, with values that learn from what was wasted.

A pass packs everything: the bin in which the value is greatest (see `filling`), the same filling
again while copies last, then the next one. After it every bin's waste is charged to what was in it,
and the value of each kind becomes the mean of the old one and of what it was charged (sequential
value correction; Belov and Scheithauer, 2007). A bin is drawn several times, with noise on the
values, in two directions, with blocks that are shorter than they could be; the best one is taken.
"""

import math
from collections.abc import Iterator
from itertools import count
from time import perf_counter

import numpy as np

from jaxpack.model.encoding import MOST_ITEMS, Loading
from jaxpack.search import filling
from jaxpack.search.filling import Axes, Filling, Goods
from jaxpack.search.fillings import Filled, Kinds, best_of, cover, kinds_of
from jaxpack.search.local_search import Best
from jaxpack.search.quick import Stop

LARGER = 1.3  # exponent of the volume in the first values: large items are worth more than theirs
PASSES = 32  # after which the values begin anew
NOISE = 0.1  # of these, but for the first ones
DRAWN = 1.0  # of the values of a draw at most
DRAWS, FEWEST, AT_ONCE = 32, 8, 3072
"""Fillings of a bin of which the best is taken; fewer where there are many kinds."""
PRICED = 0.2  # noise on what the types of bins cost, from the second pass on
LESS = 0.4  # chance that a draw makes blocks of a kind shorter by one along an axis
STRICT = (0.25, 0.5, 1.0, 2.0)  # weights of spoiled volume that draws choose from
COVER, POOL = 8, 512  # passes after which bins of all of them are put together, and how many
COVERING = 0.2  # share of the time left that the cover may take
OF_PRICE = 1e-4  # what the price of the bins counts where a best subset is wanted


def fill_in_numpy(axes: Axes, blocks: int, goods: Goods, stop: Stop) -> Filling:
    """Takes steps until no space is awake or `stop` says so."""
    now = filling.empty(np, goods, blocks)
    while filling.goes_on(now) and not stop():
        now = filling.step(np, axes, goods, now)
    return now


def search_values(
    loading: Loading, seed: int, stop: Stop, end: float = math.inf
) -> Iterator[tuple[Best | None, int]]:
    """(a packing that is better than those before or None, packings tried), pass by pass.

    Args:
        loading: what is packed, one that `has_values`.
        seed: of the draws.
        stop: asked all the time; the pass that it cuts off is lost.
        end: of the time, by `perf_counter`.
    """
    kinds, random = kinds_of(loading), np.random.default_rng([seed, 2])
    price = loading.stock.price[kinds.bins].astype(float)
    pool: dict[tuple[int, bytes], Filled] = {}
    least, value = math.inf, _first_values(kinds, None)
    best_subset = loading.objective.leaves_out
    for number in count(1):
        noise = PRICED * random.standard_normal(len(price)) * (number > 1)
        bins, left = _pass(kinds, value, price * np.exp(noise), random, stop)
        if stop():
            return
        pool |= {(one.type, one.held.tobytes()): one for one in bins}
        pool = dict([*pool.items()][-POOL:])
        plans = [bins]
        if pool and number % COVER == 0 and not best_subset:
            seconds = COVERING * (end - perf_counter())
            if chosen := cover(kinds, [*pool.values()], seconds):
                plans.append(chosen)
        best = None
        for plan in plans:
            cost = _cost(kinds, plan)
            if cost < least - 1e-9 and (packing := best_of(kinds, plan)):
                best, least = packing, cost
        yield best, 1
        if number % PASSES == 0:
            value = _first_values(kinds, random)
        elif not best_subset:
            value = _charged(kinds, value, bins, left)


def _cost(kinds: Kinds, bins: list[Filled]) -> float:
    """What fillings cost together: their price, and more than that for what is left out."""
    stock = kinds.loading.stock
    price = sum(float(stock.price[kinds.bins[one.type]]) * one.times for one in bins)
    held = sum((one.times * one.held for one in bins), np.zeros(len(kinds.count), int))
    if kinds.loading.objective.leaves_out:
        return OF_PRICE * price - float(held @ stock.profit[kinds.first])
    left = np.maximum(kinds.count - held, 0).sum() / kinds.count.sum()
    return price + float(stock.penalty * (1 + left) if left else 0)


def has_values(loading: Loading) -> bool:
    """Whether bins can be filled by value: the objective and the rule are of the kind, corners may
    stand anywhere, areas have 32 bits, and there are not too many items.
    """
    stock = loading.stock
    return (
        loading.objective.fills
        and loading.rules.rule == "lowest"
        and int(stock.step) == 1
        and stock.needed.dtype == np.int32
        and len(stock.mask) <= MOST_ITEMS
    )


def _first_values(kinds: Kinds, random: np.random.Generator | None) -> np.ndarray:
    """By volume, with noise if `random` is given; by profit where a best subset is wanted: [K]."""
    if kinds.loading.objective.leaves_out:
        profit = kinds.loading.stock.profit[kinds.first].astype(float)
        return profit * (kinds.volume @ kinds.count) / max(profit @ kinds.count, 1e-300)
    value = kinds.volume * (kinds.volume / kinds.volume.mean()) ** (LARGER - 1)
    return value if random is None else value * np.exp(NOISE * random.standard_normal(len(value)))


def _charged(kinds: Kinds, value: np.ndarray, bins: list[Filled], left: np.ndarray) -> np.ndarray:
    """The values once everything has paid for the waste of its bins; what is left goes first."""
    room = kinds.loading.stock.bins[kinds.bins].astype(float).prod(1)
    charged = np.zeros(len(value))
    for one in bins:
        filled = max(one.held @ kinds.volume, 1e-9)
        charged += one.times * one.held * kinds.volume * (room[one.type] / filled)
    new = charged / kinds.count
    value = np.where(new > 0, (value + new) / 2, value)
    return np.where(left > 0, 2 * value.max(), value)


def _pass(
    kinds: Kinds, value: np.ndarray, price: np.ndarray, random: np.random.Generator, stop: Stop
) -> tuple[list[Filled], np.ndarray]:
    """(bins, what is left, int [K]): one after the other, each by its value for its price [T]."""
    there = kinds.there.copy()
    left, bins = kinds.count.copy(), list[Filled]()
    while left.any() and (there > 0).any():
        types = np.flatnonzero(there > 0)
        goods, swapped = _drawn(kinds, value, left, types, random)
        done = fill_in_numpy(kinds.axes, kinds.blocks, goods, stop)
        if stop():
            break
        held = left[left > 0, None] - done.left  # [kinds that are left, lanes]
        prices = np.repeat(price[types], held.shape[1] // len(types))
        worth = value[left > 0] @ held / prices
        lane = int(worth.argmax())
        if not held[:, lane].any():
            break
        one = _filled(kinds, done, lane, left > 0, held[:, lane], bool(swapped[lane]))
        one = one._replace(type=int(types[lane // (held.shape[1] // len(types))]))
        some = one.held > 0
        times = int(min((left[some] // one.held[some]).min(), there[one.type]))
        bins.append(one._replace(times=times))
        left = left - times * one.held
        there[one.type] -= times
    return bins, left


def _drawn(
    kinds: Kinds,
    value: np.ndarray,
    left: np.ndarray,
    types: np.ndarray,
    random: np.random.Generator,
) -> tuple[Goods, np.ndarray]:
    """What may come into a bin of every type, some draws of each: lanes [T Z]; and which of them
    have x and y exchanged.
    """
    ways = kinds.side.shape[1] // len(left)
    some, rows = left > 0, np.repeat(left > 0, ways)
    K, R = int(some.sum()), int(rows.sum())
    T = len(types)
    Z = max(2, FEWEST // T, min(DRAWS, AT_ONCE // (R * T)))
    draw, P = np.tile(np.arange(Z), T), T * Z
    swapped = (draw % 2 == 1) & (not kinds.loading.flat)

    def alike(table: np.ndarray) -> np.ndarray:
        return np.repeat(table[..., None], P, -1)

    def turned(table: np.ndarray) -> np.ndarray:
        return np.where(swapped, table[[1, 0, 2]], table)

    sums = kinds.sums(left)
    noise = DRAWN * random.random(P) * random.standard_normal((K, P))
    strict = random.choice(STRICT, P)
    less = random.random((3, R, P)) < LESS
    # The first two as they are, the next two with the largest blocks.
    noise[:, draw < 2], strict[draw < 2], less[..., draw < 4] = 0, 1, False
    goods = Goods(
        side=turned(alike(kinds.side[:, rows])),
        needed=alike(kinds.needed[rows]),
        value=(value[some, None] * np.exp(noise)).astype(np.float32),
        weight=alike(kinds.weight[some]),
        count=alike(left[some]),
        room=turned(np.repeat(kinds.loading.stock.bins[kinds.bins[types]].T, Z, 1)),
        limit=np.repeat(kinds.limit[types], Z),
        sums=sums.ravel(),
        first=turned(alike(np.arange(3, dtype=np.int32) * np.int32(sums.shape[1]))),
        unit=np.int32(kinds.unit),
        less=less.astype(np.int32),
        strict=strict.astype(np.float32),
    )
    return goods, swapped


def _filled(
    kinds: Kinds, done: Filling, lane: int, some: np.ndarray, held: np.ndarray, swapped: bool
) -> Filled:
    """What a lane has in its bin, by all kinds and rows; only `some` kinds were left."""
    used, axes = int(done.used[lane]), [1, 0, 2] if swapped else [0, 1, 2]
    ways = kinds.side.shape[1] // len(some)
    row, grid, near = (leaf[..., :used, lane] for leaf in (done.row, done.grid, done.near))
    every = np.zeros(len(some), np.int32)
    every[some] = held
    kind = np.flatnonzero(some)[row // ways]
    return Filled(-1, every, kind * ways + row % ways, grid[axes], near[axes])
