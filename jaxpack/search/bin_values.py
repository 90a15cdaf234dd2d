"""Fills one bin after the other, again and again, with values that learn from what was wasted.

A pass packs everything: the bin in which the value is greatest (see `filling`), the same filling
again while copies last, then the next one. After it every bin's waste is charged to what was in it,
and the value of each kind becomes the mean of the old one and of what it was charged (sequential
value correction; Belov and Scheithauer, 2007). Lanes differ in direction, in noise and in how much
the volume counts that a block spoils.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
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
GROUPS, DRAWS = 1, 32  # groups of lanes that learn values; fillings of which each takes the best
LESS = 0.4  # chance that a draw makes blocks of a kind shorter by one along an axis
COVER = 8  # passes after which bins of all of them are put together
NODES = 200  # of the branch and bound for that
FINE = 4096  # lengths that sums of edges are known for; longer sides are rounded

Fill = Callable[[bool, int, Goods], Filling]
"""(whether there are several copies of a kind, blocks of a bin, goods) -> the bins filled."""
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


class _Groups:
    """What each group of lanes knows: its values. Its lanes draw fillings, the best is taken."""

    def __init__(self, kinds: Kinds, groups: int, draws: int, seed: int) -> None:
        self.kinds, self.G, self.draws = kinds, groups, draws
        self.random = np.random.default_rng([seed, 2])
        self.value = np.empty((len(kinds.first), groups))
        self.age = np.zeros(groups, int)
        self.fresh(np.arange(groups), first=True)

    def fresh(self, groups: np.ndarray, first: bool = False) -> None:
        """Values by volume."""
        volume = self.kinds.volume
        value = volume * (volume / volume.mean()) ** (LARGER - 1)
        noise = NOISE * self.random.standard_normal((len(volume), len(groups)))
        if first:
            noise[:, 0] = 0
        self.value[:, groups] = value[:, None] * np.exp(noise)
        self.age[groups] = 0

    def goods(self, left: np.ndarray, types: np.ndarray) -> tuple[Goods, np.ndarray]:
        """Of every group in every type of bins, so many draws each: lanes [T G Z]; which of them
        have x and y exchanged.
        """
        kinds, T, G, Z = self.kinds, len(types), self.G, self.draws
        P = T * G * Z
        draw = np.arange(P) % Z
        swapped = (draw % 2 == 1) & (not kinds.loading.flat)
        type_of = np.repeat(np.arange(T), G * Z)

        def by_lane(table: np.ndarray) -> np.ndarray:  # [3, ..., T] -> [3, ..., P]
            many = table[..., type_of]
            return np.where(swapped, many[[1, 0, 2]], many)

        def alike(table: np.ndarray) -> np.ndarray:
            return np.repeat(table[..., None], P, -1)

        side = by_lane(np.repeat(kinds.side[..., None], T, -1))
        masks, mask_of = np.unique(left > 0, axis=1, return_inverse=True)
        sums = np.stack([kinds.sums(mask) for mask in masks.T])
        length = sums.shape[-1]
        mask_of = np.tile(np.repeat(mask_of.ravel(), Z), T)
        first = mask_of * 3 * length + np.arange(3)[:, None] * length
        value = np.tile(np.repeat(self.value, Z, 1), T)
        noise = DRAWN * self.random.standard_normal(value.shape)
        strict = self.random.choice([0.25, 0.5, 1.0, 2.0], P)
        noise[:, draw < 2] = 0
        less = self.random.random((3, kinds.side.shape[1], P)) < LESS
        less[..., draw < 4] = 0
        strict[draw < 2] = 1
        goods = Goods(
            side=side,
            needed=alike(kinds.needed),
            value=(value * np.exp(noise)).astype(np.float32),
            weight=alike(kinds.weight),
            count=np.tile(np.repeat(left, Z, 1), T).astype(np.int32),
            room=by_lane(kinds.loading.stock.bins[kinds.bins[types]].T),
            limit=kinds.limit[types][type_of],
            sums=sums.ravel(),
            first=np.where(swapped, first[[1, 0, 2]], first).astype(np.int32),
            unit=np.int32(kinds.unit),
            less=less.astype(np.int32),
            strict=strict.astype(np.float32),
        )
        return goods, swapped


def search_values(
    loading: Loading, seed: int, stop: Stop, fill: Fill | None = None
) -> Iterator[tuple[Best | None, int]]:
    """(a packing that is better than those before or None, packings tried), pass by pass.

    Args:
        loading: what is packed, one that `has_values`.
        seed: of the noise.
        stop: asked all the time; the pass that it cuts off is lost.
        fill: what fills the bins, in NumPy if not given.
    """
    kinds = kinds_of(loading)
    groups = _Groups(kinds, GROUPS, DRAWS, seed)
    price = loading.stock.price[kinds.bins].astype(float)
    pool: dict[tuple[int, bytes], Filled] = {}
    least, covered = math.inf, 0
    for number in count(1):
        found = _one_pass(kinds, groups, fill or partial(fill_in_numpy, stop=stop), stop)
        if stop():
            return
        pool |= {(one.kind, one.held.tobytes()): one for bins, _ in found for one in bins}
        plans = [bins for bins, whole in found if whole]
        if number % COVER == 0 and len(pool) > covered:
            covered = len(pool)
            plans += filter(None, [cover(kinds, [*pool.values()])])
        best = None
        for bins in plans:
            cost = sum(one.times * price[one.kind] for one in bins)
            if cost < least - 1e-9 and (packing := best_of(kinds, bins)):
                best, least = packing, cost
        yield best, GROUPS
        _correct(kinds, groups, found)


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


def _one_pass(
    kinds: Kinds, groups: _Groups, fill: Fill, stop: Stop
) -> list[tuple[list[Filled], bool]]:
    G, K, Z = groups.G, len(kinds.first), groups.draws
    loading = kinds.loading
    copies = [loading.job.bins[int(loading.bins[row])].copies for row in kinds.bins]
    stock_left = np.array([[10**9 if c is None else c] * G for c in copies])  # [T, G]
    price = loading.stock.price[kinds.bins].astype(float)
    left = np.repeat(kinds.count[:, None], G, 1)
    bins: list[list[Filled]] = [[] for _ in range(G)]
    open_ = np.ones(G, bool)
    while open_.any():
        types = np.flatnonzero((stock_left[:, open_] > 0).any(1))
        if not len(types):
            break
        goods, swapped = groups.goods(np.where(open_, left, 0), types)
        done = fill(kinds.several, kinds.blocks, goods)
        if stop():
            break
        after = np.asarray(done.left).reshape(K, len(types), G, Z)
        count = (left * open_)[:, None, :, None] - after  # [K, T, G, Z]
        worth = np.einsum("ktgz,kg->tgz", count, groups.value) / price[types, None, None]
        score = np.where((after == 0).all(0), 1e300 / price[types, None, None], worth)
        score = np.where((stock_left[types] > 0)[..., None], score, -1)
        score = score.transpose(1, 0, 2).reshape(G, -1)
        chosen = score.argmax(1)
        for group in np.flatnonzero(open_):
            t, z = divmod(int(chosen[group]), Z)
            mine = count[:, t, group, z]
            some = mine > 0
            if not some.any() or score[group, chosen[group]] < 0:
                open_[group] = False
                continue
            kind = int(types[t])
            times = int(min((left[some, group] // mine[some]).min(), stock_left[kind, group]))
            at = (t * G + group) * Z + z
            used = int(done.used[at])
            axes = [1, 0, 2] if swapped[at] else [0, 1, 2]
            row, grid, near = (
                np.asarray(leaf[..., :used, at]) for leaf in (done.row, done.grid, done.near)
            )
            bins[group].append(Filled(kind, mine.copy(), row, grid[axes], near[axes], times))
            left[:, group] -= times * mine
            stock_left[kind, group] -= times
            open_[group] = left[:, group].any()
    return [(bins[group], not left[:, group].any()) for group in range(G)]


def _correct(kinds: Kinds, groups: _Groups, found: list[tuple[list[Filled], bool]]) -> None:
    room = kinds.loading.stock.bins[kinds.bins].astype(float).prod(1)
    for group, (bins, _) in enumerate(found):
        charged = np.zeros(len(kinds.first))
        for one in bins:
            filled = max(one.held @ kinds.volume, 1e-9)
            charged += one.times * one.held * kinds.volume * (room[one.kind] / filled)
        new, old = charged / kinds.count, groups.value[:, group]
        groups.value[:, group] = np.where(new > 0, (old + new) / 2, old)
    groups.age += 1
    if len(old_ones := np.flatnonzero(groups.age >= PASSES)):
        groups.fresh(old_ones)


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
