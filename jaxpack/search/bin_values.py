"""Fills one bin after the other, again and again, with values that learn from what was wasted.

A pass packs everything: the bin in which the value is greatest (see `filling`), the same filling
again while copies last, then the next one. After it every bin's waste is charged to what was in it,
and the value of each kind becomes the mean of the old one and of what it was charged (sequential
value correction; Belov and Scheithauer, 2007). A bin is drawn several times, with noise on the
values, in two directions, with blocks that are shorter than they could be; the best one is taken.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count
from typing import NamedTuple

import numpy as np

from jaxpack.model.encoding import MOST_ITEMS, Genes, Loading, most_together
from jaxpack.search import filling
from jaxpack.search.filling import BLOCKS, FAR, Filling, Goods
from jaxpack.search.local_search import Best
from jaxpack.search.quick import cost_of

LARGER = 1.3  # exponent of the volume in the first values: large items are worth more than theirs
PASSES = 32  # after which a lane begins anew
NOISE = 0.1  # of the values of a lane, but for the first ones
DRAWN = 0.6  # of the values of a draw
DRAWS, FEWEST, AT_ONCE = 32, 8, 3072
"""Fillings of a bin of which the best is taken; fewer where there are many kinds."""
LESS = 0.4  # chance that a draw makes blocks of a kind shorter by one along an axis
STRICT = (0.25, 0.5, 1.0, 2.0)  # what the volume that a block spoils counts in a draw
COVER = 8  # passes after which bins of all of them are put together
NODES = 200  # of the branch and bound for that
FINE = 4096  # lengths that sums of edges are known for; longer sides are rounded

Stop = Callable[[], bool]


def fill_in_numpy(several: bool, blocks: int, goods: Goods, stop: Stop = lambda: False) -> Filling:
    """Compiled by nobody."""
    now = filling.empty(np, goods, blocks)
    while filling.goes_on(now) and not stop():
        now = filling.step(np, several, goods, now)
    return now


class Filled(NamedTuple):
    """A bin, as often as it is packed like this."""

    kind: int  # index in Job.bins
    held: np.ndarray  # int32 [K], copies of each kind in it
    row: np.ndarray  # int32 [m], of the blocks
    grid: np.ndarray  # int32 [3, m]
    near: np.ndarray  # int32 [3, m]
    times: int = 1


@dataclass(frozen=True)
class Kinds:
    """A loading by kind: items that are alike."""

    loading: Loading
    rows: np.ndarray  # int [N], kind of every row of the stock
    first: np.ndarray  # int [K], a row of each
    count: np.ndarray  # int32 [K]
    side: np.ndarray  # int32 [3, R]
    needed: np.ndarray  # int32 [R]
    weight: np.ndarray  # int32 [K]
    volume: np.ndarray  # float64 [K]
    bins: np.ndarray  # int [T], a row of the stock for each type of bins
    limit: np.ndarray  # int32 [T]
    unit: int  # of the sums of edges
    several: bool  # whether any has more than one copy
    blocks: int  # that a bin may hold
    known: dict[bytes, np.ndarray] = field(default_factory=dict)  # sums

    def sums(self, left: np.ndarray) -> np.ndarray:
        """Longest sums of edges of the kinds of which some are left: int32 [3, L]."""
        key = (left > 0).tobytes()
        if key not in self.known:
            ways = self.side.shape[1] // len(left)
            some = np.repeat(left > 0, ways)
            most = int(self.loading.stock.bins[self.bins].max()) // self.unit
            columns = []
            for axis in range(3):
                edges, which = np.unique(
                    -(-self.side[axis, some] // self.unit), return_inverse=True
                )
                copies = np.bincount(which.ravel(), np.repeat(self.count, ways)[some]).astype(int)
                short = edges <= most
                columns.append(filling.longest_sums(edges[short], copies[short], most))
            self.known[key] = np.stack(columns) * np.int32(self.unit)
        return self.known[key]


def kinds_of(loading: Loading) -> Kinds:
    """Of a job."""
    stock = loading.stock
    N, ways = stock.sizes.shape[:2]
    table = np.concatenate(
        [stock.sizes.reshape(N, -1), stock.ways[:, None], stock.weight[:, None]], 1
    )
    _, first, rows, copies = np.unique(
        table, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    side = np.where(
        (np.arange(ways) < stock.ways[first][:, None])[..., None], stock.sizes[first], FAR
    ).reshape(-1, 3).T  # fmt: skip
    _, bins = np.unique(loading.bins, return_index=True)
    limits = stock.limit[bins].astype(np.int64)
    bounded = limits[limits < np.iinfo(stock.limit.dtype).max]
    unit = -(-int(bounded.max(initial=1)) // 2**28)
    weight = -(-stock.weight[first].astype(np.int64) // unit)
    limit = np.minimum(limits // unit, 2**29)
    return Kinds(
        loading, rows.ravel(), first, copies.astype(np.int32), side.astype(np.int32),
        stock.needed[first].reshape(-1).astype(np.int32), weight.astype(np.int32),
        stock.sizes[first, 0].astype(float).prod(1), bins, limit.astype(np.int32),
        -(-int(stock.bins[bins].max()) // FINE), bool(copies.max() > 1),
        min(BLOCKS, most_together(stock)),
    )  # fmt: skip


def search_values(loading: Loading, seed: int, stop: Stop) -> Iterator[tuple[Best | None, int]]:
    """(a packing that is better than those before or None, packings tried), pass by pass.

    Args:
        loading: what is packed, one that `has_values`.
        seed: of the draws.
        stop: asked all the time; the pass that it cuts off is lost.
    """
    kinds, random = kinds_of(loading), np.random.default_rng([seed, 2])
    price = loading.stock.price[kinds.bins].astype(float)
    pool: dict[tuple[int, bytes], Filled] = {}
    least, covered, value = math.inf, 0, _first_values(kinds, None)
    for number in count(1):
        bins, whole = _pass(kinds, value, random, stop)
        if stop():
            return
        pool |= {(one.kind, one.held.tobytes()): one for one in bins}
        plans = [bins] if whole else []
        if number % COVER == 0 and len(pool) > covered:
            covered = len(pool)
            plans += filter(None, [cover(kinds, [*pool.values()])])
        best = None
        for bins_of_plan in plans:
            cost = sum(one.times * price[one.kind] for one in bins_of_plan)
            if cost < least - 1e-9 and (packing := best_of(kinds, bins_of_plan)):
                best, least = packing, cost
        yield best, 1
        value = (
            _first_values(kinds, random) if number % PASSES == 0 else _charged(kinds, value, bins)
        )


def has_values(loading: Loading) -> bool:
    """Whether bins can be filled by value: corners anywhere, whole areas of 32 bits."""
    stock = loading.stock
    return (
        loading.objective.by_bins
        and loading.rules.rule == "lowest"
        and int(stock.step) == 1
        and stock.needed.dtype == np.int32
        and len(stock.mask) <= MOST_ITEMS
    )


def _first_values(kinds: Kinds, random: np.random.Generator | None) -> np.ndarray:
    """By volume, with noise if it is not the first time: float64 [K]."""
    value = kinds.volume * (kinds.volume / kinds.volume.mean()) ** (LARGER - 1)
    return value if random is None else value * np.exp(NOISE * random.standard_normal(len(value)))


def _charged(kinds: Kinds, value: np.ndarray, bins: list[Filled]) -> np.ndarray:
    """The values once everything has paid for the waste of its bins."""
    room = kinds.loading.stock.bins[kinds.bins].astype(float).prod(1)
    charged = np.zeros(len(value))
    for one in bins:
        filled = max(one.held @ kinds.volume, 1e-9)
        charged += one.times * one.held * kinds.volume * (room[one.kind] / filled)
    new = charged / kinds.count
    return np.where(new > 0, (value + new) / 2, value)


def _pass(
    kinds: Kinds, value: np.ndarray, random: np.random.Generator, stop: Stop
) -> tuple[list[Filled], bool]:
    """(bins, whether they hold everything): one after the other, each by its value and price."""
    stock, job = kinds.loading.stock, kinds.loading.job
    price = stock.price[kinds.bins].astype(float)
    copies = [job.bins[int(kinds.loading.bins[row])].copies for row in kinds.bins]
    there = np.array([np.inf if most is None else most for most in copies])
    left, bins = kinds.count.copy(), list[Filled]()
    while left.any() and (there > 0).any():
        types = np.flatnonzero(there > 0)
        goods, swapped = _drawn(kinds, value, left, types, random)
        done = fill_in_numpy(kinds.several, kinds.blocks, goods, stop)
        if stop():
            break
        held = left[left > 0, None] - done.left  # [kinds that are left, lanes]
        prices = np.repeat(price[types], held.shape[1] // len(types))
        worth = value[left > 0] @ held / prices
        lane = int(np.where((done.left == 0).all(0), 1e300 / prices, worth).argmax())
        if not held[:, lane].any():
            break
        one = _filled(kinds, done, lane, left > 0, held[:, lane], bool(swapped[lane]))
        one = one._replace(kind=int(types[lane // (held.shape[1] // len(types))]))
        some = one.held > 0
        times = int(min((left[some] // one.held[some]).min(), there[one.kind]))
        bins.append(one._replace(times=times))
        left = left - times * one.held
        there[one.kind] -= times
    return bins, not left.any()


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
    T, Z = len(types), max(FEWEST, min(DRAWS, AT_ONCE // (R * len(types))))
    draw, P = np.tile(np.arange(Z), T), T * Z
    swapped = (draw % 2 == 1) & (not kinds.loading.flat)

    def alike(table: np.ndarray) -> np.ndarray:
        return np.repeat(table[..., None], P, -1)

    def turned(table: np.ndarray) -> np.ndarray:
        return np.where(swapped, table[[1, 0, 2]], table)

    sums = kinds.sums(left)
    noise = DRAWN * random.standard_normal((K, P))
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


def best_of(kinds: Kinds, bins: list[Filled]) -> Best | None:
    """A packing in the rows of the stock, loaded from low to high; None where more is in the bins
    than there is, and cannot be taken out.
    """
    loading = kinds.loading
    N, ways = loading.stock.sizes.shape[:2]
    surplus = sum(one.times * one.held for one in bins) - kinds.count
    turn, bin, corner = np.zeros(N, np.int32), np.full(N, -1, np.int32), np.zeros((N, 3), np.int32)
    waiting = [np.flatnonzero(kinds.rows == kind).tolist() for kind in range(len(kinds.first))]
    slots = {
        kind: iter(np.flatnonzero(loading.bins == loading.bins[row]).tolist())
        for kind, row in enumerate(kinds.bins)
    }
    packed = []
    for one in bins:
        rows, places = _items(kinds, one)
        for _ in range(one.times):
            stays = _without_surplus(kinds, rows, places, surplus)
            packed.append((next(slots[one.kind]), rows[stays], places[stays]))
    if (surplus > 0).any():
        return None
    for slot, rows, places in packed:
        for row, place in zip(rows.tolist(), places, strict=True):
            mine = waiting[row // ways].pop()
            turn[mine], bin[mine], corner[mine] = row % ways, slot, place
    pool = [slot for slot, *_ in packed]
    order = np.lexsort((corner[:, 2], bin)).astype(np.int32)
    rest = np.setdiff1d(np.arange(len(loading.bins)), pool)
    genes = Genes(order, turn, np.concatenate([pool, rest]).astype(np.int32))
    return Best(genes, bin, corner, cost_of(loading, genes, bin, corner))


def _items(kinds: Kinds, one: Filled) -> tuple[np.ndarray, np.ndarray]:
    """(row int [n], near corner int [n, 3]) of every item in a bin."""
    rows, places = [], []
    for row, grid, near in zip(one.row.tolist(), one.grid.T, one.near.T, strict=True):
        steps = np.stack(np.meshgrid(*map(np.arange, grid), indexing="ij"), -1).reshape(-1, 3)
        places.append(near + steps * kinds.side[:, row])
        rows += [row] * len(steps)
    return np.array(rows), np.concatenate(places)


def _without_surplus(
    kinds: Kinds, rows: np.ndarray, places: np.ndarray, surplus: np.ndarray
) -> np.ndarray:
    """Which items stay, after what is too many and carries nothing is taken out: bool [n].

    Args:
        surplus: int [K], of each kind; what is taken out is subtracted.
    """
    K = len(surplus)
    kind, stays = rows // (kinds.side.shape[1] // K), np.ones(len(rows), bool)
    far = places + kinds.side[:, rows].T
    for n in np.argsort(-far[:, 2], kind="stable").tolist() if (surplus > 0).any() else ():
        if surplus[kind[n]] <= 0:
            continue
        above = stays & (places[:, 2] == far[n, 2])
        above &= ((places[:, :2] < far[n, :2]) & (far[:, :2] > places[n, :2])).all(1)
        if not above.any():
            stays[n] = False
            surplus[kind[n]] -= 1
    return stays


def cover(kinds: Kinds, pool: list[Filled]) -> list[Filled] | None:
    """The cheapest bins out of a pool that hold everything, perhaps some of it twice."""
    from scipy.optimize import Bounds, LinearConstraint, milp  # a third of a second
    from scipy.sparse import csr_array

    held = csr_array(np.stack([one.held for one in pool], 1))
    price = kinds.loading.stock.price[kinds.bins][[one.kind for one in pool]].astype(float)
    rows = [LinearConstraint(held, lb=kinds.count)]
    job = kinds.loading.job
    for kind, row in enumerate(kinds.bins):
        copies = job.bins[int(kinds.loading.bins[row])].copies
        if copies is not None:
            mine = np.array([[one.kind == kind for one in pool]], float)
            rows.append(LinearConstraint(mine, ub=copies))
    found = milp(
        price,
        integrality=np.ones(len(pool)),
        constraints=rows,
        bounds=Bounds(0, np.inf),
        options={"node_limit": NODES},
    )
    if found.x is None:
        return None
    times = np.round(found.x).astype(int)
    return [pool[n]._replace(times=int(times[n])) for n in np.flatnonzero(times)]
