"""Fillings of one bin each: how several of them are a packing, and which ones to choose.

Out of all bins that were ever filled an integer program (HiGHS, in SciPy) takes the cheapest that
hold everything. What is then there twice is taken out from the top.
"""

import math
from dataclasses import dataclass, field
from itertools import permutations
from typing import NamedTuple

import numpy as np

from jaxpack.model.encoding import Genes, Loading, most_together
from jaxpack.model.sums import sums
from jaxpack.search.block_policy import Judge
from jaxpack.search.filling import BLOCKS, FAR, Axes
from jaxpack.search.local_search import Best
from jaxpack.search.quick import cost_of

NODES = 50  # of the branch and bound of the cover
REMEMBERED = 256  # sums of edges, for that many choices of kinds
FINE = 4096  # lengths that sums of edges are known for; longer sides are rounded


class Filled(NamedTuple):
    """A bin, as often as it is packed like this."""

    type: int  # of the bin, an index in `Kinds.bins`
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
    size: np.ndarray  # float64 [K], what an item takes of a bin: see `_sizes`
    bins: np.ndarray  # int [T], a row of the stock for each type of bins
    limit: np.ndarray  # int32 [T]
    holds: np.ndarray  # float64 [T], how much of such size
    unit: int  # of the sums of edges, which are rounded down
    axes: Axes  # see `filling.step`
    there: np.ndarray  # int [T], bins of each type
    blocks: int  # that a bin may hold
    judge: Judge | None  # what is added to the score of a block
    known: dict[bytes, np.ndarray] = field(default_factory=dict)  # sums

    @property
    def firm(self) -> bool:
        """Whether items rest only on what is firm."""
        return self.loading.rules.firm

    @property
    def ways(self) -> int:
        """Orientations that every kind has rows for."""
        return self.side.shape[1] // len(self.count)

    def sums(self, left: np.ndarray) -> np.ndarray:
        """Longest sums of edges of the kinds of which some are left: int32 [3, L]."""
        key = (left > 0).tobytes()
        if key not in self.known:
            if len(self.known) >= REMEMBERED:
                self.known.clear()
            some = np.repeat(left > 0, self.ways)
            most = int(self.loading.stock.bins[self.bins].max()) // self.unit
            copies = np.repeat(self.count, self.ways)[some]
            edges = self.side[:, some] // self.unit
            columns = [longest_sums(along, copies, most) for along in edges]
            self.known[key] = np.stack(columns) * np.int32(self.unit)
        return self.known[key]


def longest_sums(edges: np.ndarray, copies: np.ndarray, length: int) -> np.ndarray:
    """For every length up to `length` the longest sum of edges that is not longer: int32.

    Args:
        edges: int [n], units.
        copies: int [n], of each at most.
    """
    whole = sums(edges, copies, length)
    bits = np.frombuffer(whole.to_bytes(length // 8 + 1, "little"), np.uint8)
    reached = np.unpackbits(bits, count=length + 1, bitorder="little")
    return np.maximum.accumulate(reached * np.arange(length + 1, dtype=np.int32))


def kinds_of(loading: Loading, judge: Judge | None = None) -> Kinds:
    """Of a job, and what fills its bins."""
    stock = loading.stock
    N, ways = stock.sizes.shape[:2]
    columns = stock.ways, stock.weight, stock.profit.view(np.int32)
    table = np.concatenate([stock.sizes.reshape(N, -1), np.stack(columns, 1)], 1)
    every = list(map(tuple, table.tolist()))
    found = {row: n for n, row in reversed([*enumerate(every)])}  # where it comes first
    different = sorted(found)
    place = {row: kind for kind, row in enumerate(different)}
    rows = np.array([place[row] for row in every])
    first, copies = np.array([found[row] for row in different]), np.bincount(rows)
    side = np.where(
        (np.arange(ways) < stock.ways[first][:, None])[..., None], stock.sizes[first], FAR
    ).reshape(-1, 3).T  # fmt: skip
    bins = loading.first
    # In 2D y is not in the way; where nothing has its like, no axis is.
    axes = ((0, 1, 2), (2, 1, 0)) if loading.flat else tuple(permutations(range(3)))
    axes = axes if copies.max() > 1 else axes[:1]
    limits = stock.limit[bins].astype(np.int64)
    bounded = limits[limits < np.iinfo(stock.limit.dtype).max]
    unit = -(-int(bounded.max(initial=1)) // 2**30)
    weight = -(-stock.weight[first].astype(np.int64) // unit)
    limit = np.minimum(limits // unit, 2**30)
    size, holds = _sizes(loading, first, copies, bins)
    return Kinds(
        loading, rows, first, copies.astype(np.int32), side.astype(np.int32),
        np.maximum(stock.needed[first], 1).reshape(-1).astype(np.int32), weight.astype(np.int32),
        size, bins, limit.astype(np.int32), holds,
        -(-int(stock.bins[bins].max()) // FINE), axes, np.diff(bins, append=len(loading.bins)),
        min(BLOCKS, most_together(stock)), judge,
    )  # fmt: skip


def _sizes(
    loading: Loading, first: np.ndarray, copies: np.ndarray, bins: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What an item of each kind takes [K] and what a bin of each type holds [T]: volume and weight,
    in units of volume, the more of the one of which there is more beside what a bin holds.
    """
    stock = loading.stock
    volume, room = (
        stock.sizes[first, 0].astype(float).prod(1),
        stock.bins[bins].astype(float).prod(1),
    )
    if (stock.limit[bins] == np.iinfo(stock.limit.dtype).max).any():
        return volume, room
    weight, limit = stock.weight[first].astype(float), stock.limit[bins].astype(float)
    weight, limit = (column * (room.max() / max(limit.max(), 1)) for column in (weight, limit))
    full, heavy = volume @ copies, weight @ copies
    part = heavy**2 / (heavy**2 + full**2)
    return (1 - part) * volume + part * weight, (1 - part) * room + part * limit


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
            packed.append((next(slots[one.type], -1), rows[stays], places[stays]))
    if (surplus > 0).any() or any(slot < 0 for slot, *_ in packed):
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


def cover(kinds: Kinds, pool: list[Filled], seconds: float = math.inf) -> list[Filled] | None:
    """The cheapest bins out of a pool that hold everything, perhaps some of it twice; None where
    none were found in the time.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp  # a third of a second
    from scipy.sparse import csr_array

    held = csr_array(np.stack([one.held for one in pool], 1))
    price = kinds.loading.stock.price[kinds.bins][[one.type for one in pool]].astype(float)
    rows = [LinearConstraint(held, lb=kinds.count)]
    job = kinds.loading.job
    for kind, row in enumerate(kinds.bins):
        copies = job.bins[int(kinds.loading.bins[row])].copies
        if copies is not None:
            mine = np.array([[one.type == kind for one in pool]], float)
            rows.append(LinearConstraint(mine, ub=copies))
    found = milp(
        price,
        integrality=np.ones(len(pool)),
        constraints=rows,
        bounds=Bounds(0, np.inf),
        options={"node_limit": NODES, "time_limit": max(0, seconds)},
    )
    if found.x is None:
        return None
    times = np.round(found.x).astype(int)
    return [pool[n]._replace(times=int(times[n])) for n in np.flatnonzero(times)]
