"""Fills one bin after the other, again and again, with values that learn from what was wasted.

A pass packs everything: the bin in which the value is greatest (see `filling`), the same filling
again while copies last, then the next one. After it every bin's waste is charged to what was in it,
and the value of each kind becomes the mean of the old one and of what it was charged (sequential
value correction; Belov and Scheithauer, 2007). A bin is drawn several times, with noise on the
values, in two directions, with blocks that are shorter than they could be; the best one is taken.
Of a best subset, which has one bin, a beam looks for it instead.
"""

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import replace
from itertools import count
from time import perf_counter

import numpy as np

from jaxpack.model.encoding import MOST_ITEMS, Loading
from jaxpack.search.beam import Asked, Asking, alone, fill_by_beam
from jaxpack.search.between_bins import Between, filled_bins
from jaxpack.search.block_policy import Judge
from jaxpack.search.draws import by_size, drawn, filled_lane
from jaxpack.search.filling import Filling, Goods
from jaxpack.search.fillings import Filled, Kinds, best_of, cover, kinds_of
from jaxpack.search.local_search import Best
from jaxpack.search.quick import Stop

PASSES = 32  # after which the values begin anew
NOISE = 0.1  # of these, but for the first ones
DRAWS, FEWEST, AT_ONCE = 32, 8, 3072
"""Fillings of a bin of which the best is taken; fewer where there are many kinds."""
PRICED = 0.2  # noise on what the types of bins cost, from the second pass on
ALL: tuple[int | None, ...] = (None,)  # draws of the passes: all that are worth it in every one
BEAMS = ((8, 4, 4), (16, 2, 3))
"""(draws, width, children) of the beams, in turns, that look for a best subset after one pass."""
COVER, POOL = 8, 512  # passes after which bins of all of them are put together, and how many
COVERING = 0.2  # share of the time left that the cover may take
OF_PRICE = 1e-4  # what the price of the bins counts where a best subset is wanted


def search_values(
    loading: Loading,
    seed: int,
    stop: Stop,
    end: float = math.inf,
    known: Callable[[], Best | None] = lambda: None,
    judge: Judge | None = None,
) -> Iterator[tuple[Best | None, int]]:
    """(a packing that is better than those before or None, packings tried), pass by pass; where few
    items have their like, with rounds between the bins of the best one after each.

    Args:
        loading: what is packed, one that `has_values`.
        seed: of the draws.
        stop: asked all the time; the pass that it cuts off is lost, if not of a best subset.
        end: of the time, by `perf_counter`.
        known: the best packing of all searches, from which the rounds go on.
        judge: the policy that chooses blocks, if there is one.
    """
    return alone(values_asked(loading, seed, stop, end, known, judge), stop)


def values_asked(
    loading: Loading,
    seed: int,
    stop: Stop,
    end: float = math.inf,
    known: Callable[[], Best | None] = lambda: None,
    judge: Judge | None = None,
    draws: Sequence[int | None] = ALL,
) -> Asking:
    """`search_values` for somebody who fills the bins that it asks for.

    Args:
        loading, seed, stop, end, known, judge: see there.
        draws: fillings of a bin in the first passes, None for as many as are worth it, the last one
            for all that follow. Rounds begin after the last one.
    """
    kinds, random = kinds_of(loading, judge), np.random.default_rng([seed, 2])
    by_hand = replace(kinds, judge=None)
    price = loading.stock.price[kinds.bins].astype(float)
    found, value = _Found(kinds), _first_values(kinds, None)
    best_subset = loading.objective.leaves_out
    between = Between(kinds, np.random.default_rng([seed, 3]))
    rounds = not best_subset and 2 * len(kinds.count) > kinds.count.sum()
    for number in count(1):
        noise = PRICED * random.standard_normal(len(price)) * (number > 1)
        # Of a best subset there is only this bin, and all the time for it.
        beam = BEAMS[number % len(BEAMS)] if best_subset and number > 1 else None
        # Small orders have no time for more than one way: by hand first, and then in turns.
        mine = kinds if best_subset or number % 2 == 0 else by_hand
        bins, left = yield from _pass(
            mine,
            value,
            price * np.exp(noise),
            random,
            stop,
            beam,
            draws[min(number, len(draws)) - 1],
        )
        if stop() and not best_subset:
            return
        found.add(bins)
        best = found.better(bins)
        if found.pool and number % COVER == 0 and not best_subset:
            seconds = COVERING * (end - perf_counter())
            if chosen := cover(kinds, [*found.pool.values()], seconds):
                best = found.better(chosen) or best
        yield best, 1
        for _ in range((len(bins) + 1) // 2 if rounds and number >= len(draws) else 0):
            found.look(known())
            if between.price_of(between.bins) > found.least + 1e-9 or not between.bins:
                between.begin(found.bins)
            found.add((yield from between.round(stop)))
            if stop():
                return
            yield found.better(between.bins), 1
        if number % PASSES == 0:
            value = _first_values(kinds, random)
        elif not best_subset:
            value = _charged(kinds, value, bins, left)


class _Found:
    """The last fillings that were made, and the packing that cost least."""

    def __init__(self, kinds: Kinds) -> None:
        self.kinds, self.least = kinds, math.inf
        self.bins = list[Filled]()
        self.pool: dict[tuple[int, bytes], Filled] = {}
        self.seen: Best | None = None

    def add(self, bins: list[Filled]) -> None:
        """Into the pool."""
        self.pool |= {(one.type, one.held.tobytes()): one for one in bins}
        self.pool = dict([*self.pool.items()][-POOL:])

    def better(self, bins: list[Filled]) -> Best | None:
        """The packing that they are, if it is one and better than those before."""
        cost = _cost(self.kinds, bins)
        if cost > self.least - 1e-9 or not (packing := best_of(self.kinds, bins)):
            return None
        self.least, self.bins = cost, filled_bins(self.kinds, packing)  # without a surplus
        return packing

    def look(self, best: Best | None) -> None:
        """At a packing of another search: is it better, its bins come into the pool."""
        if best is None or best is self.seen:
            return
        self.seen = best
        bins = filled_bins(self.kinds, best)
        if (cost := _cost(self.kinds, bins)) < self.least - 1e-9:
            self.least, self.bins = cost, bins
            self.add(bins)


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
    stand anywhere, areas have 32 bits, there are not too many items and no rules of their own.
    """
    stock = loading.stock
    return (
        loading.objective.fills
        and loading.rules.rule == "lowest"
        and int(stock.step) == 1
        and stock.needed.dtype == np.int32
        and len(stock.mask) <= MOST_ITEMS
        and not loading.ruled
    )


def _first_values(kinds: Kinds, random: np.random.Generator | None) -> np.ndarray:
    """By volume, with noise if `random` is given; by profit where a best subset is wanted: [K]."""
    if kinds.loading.objective.leaves_out:
        profit = kinds.loading.stock.profit[kinds.first].astype(float)
        return profit * (kinds.size @ kinds.count) / max(profit @ kinds.count, 1e-300)
    value = by_size(kinds)
    return value if random is None else value * np.exp(NOISE * random.standard_normal(len(value)))


def _charged(kinds: Kinds, value: np.ndarray, bins: list[Filled], left: np.ndarray) -> np.ndarray:
    """The values once everything has paid for the waste of its bins; what is left goes first."""
    charged = np.zeros(len(value))
    for one in bins:
        filled = max(one.held @ kinds.size, 1e-9)
        charged += one.times * one.held * kinds.size * (kinds.holds[one.type] / filled)
    new = charged / kinds.count
    value = np.where(new > 0, (value + new) / 2, value)
    return np.where(left > 0, 2 * value.max(), value)


def _pass(
    kinds: Kinds,
    value: np.ndarray,
    price: np.ndarray,
    random: np.random.Generator,
    stop: Stop,
    beam: tuple[int, int, int] | None = None,
    draws: int | None = None,
) -> Generator[Asked, Filling, tuple[list[Filled], np.ndarray]]:
    """(bins, what is left, int [K]): one after the other, each by its value for its price [T]."""
    there = kinds.there.copy()
    left, bins = kinds.count.copy(), list[Filled]()
    while left.any() and (there > 0).any():
        types = np.flatnonzero(there > 0)
        goods, swapped = _drawn(kinds, value, left, types, random, beam[0] if beam else draws)
        if beam:
            done = fill_by_beam(kinds, goods, value[left > 0], *beam[1:], stop)
        else:
            done = yield Asked(kinds, goods)
        if stop() and not kinds.loading.objective.leaves_out:
            break
        held = left[left > 0, None] - done.left  # [kinds that are left, lanes]
        prices = np.repeat(price[types], held.shape[1] // len(types))
        worth = value[left > 0] @ held / prices
        lane = int(worth.argmax())
        if not held[:, lane].any():
            break
        type = int(types[lane // (held.shape[1] // len(types))])
        one = filled_lane(kinds, done, lane, np.flatnonzero(left), type, bool(swapped[lane]))
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
    draws: int | None = None,
) -> tuple[Goods, np.ndarray]:
    """What may come into a bin of every type, so many draws of each, or as many as are worth it:
    lanes [T Z]; and which of them have x and y exchanged.
    """
    which = np.flatnonzero(left > 0)
    T = len(types)
    few = max(2, FEWEST // T, min(DRAWS, AT_ONCE // (len(which) * kinds.ways * T)))
    Z = draws or few
    lanes = np.arange(T * Z)
    sums = kinds.sums(left)
    return drawn(
        kinds, np.repeat(which[:, None], T * Z, 1), value[which, None], left[which, None],
        np.repeat(types, Z), sums, 0 * lanes, lanes % Z, random,
    )  # fmt: skip
