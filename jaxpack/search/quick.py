"""Plans that are there before anything is compiled: first fit in NumPy, and a search over it.

Without blocks the placements are those of `packer.first_fit` to the unit. What is left when the
time is up stands in columns.
"""

import math
from collections.abc import Callable, Iterator
from itertools import count
from typing import NamedTuple

import numpy as np

from jaxpack.model.encoding import Genes, Loading, lane_genes
from jaxpack.model.objectives import Placed
from jaxpack.packing.rules import RULES, Rule, rule_named
from jaxpack.packing.top_map import TopMap
from jaxpack.search.columns import stand_in_columns
from jaxpack.search.local_search import Best
from jaxpack.search.ruled import pack_by_rules
from jaxpack.search.ruled_draws import draw_bins

SORTS = 12  # of `lane_genes`, without noise
PATIENCE = 60  # packings without a better one, and as many as there are runs, before a new start
ANNEALED, RULED_SORTS = 4, 4  # packings of orders by rules of their own: between passes, before
HEAT = 0.05  # rises of this size are accepted one time in three, in prices

Stop = Callable[[], bool]


class Run(NamedTuple):
    """Items of one kind, turned alike, that follow each other in an order."""

    item: int  # index in Job.items
    turn: int
    copies: int


def quick_plan(loading: Loading, genes: Genes, stop: Stop = lambda: False) -> Best:
    """The packing of one lane; what is left when `stop` says so stands in columns."""
    if loading.ruled:
        return _best(loading, *pack_by_rules(loading, genes, stop, to_end=True))
    bin, corner = pack_quickly(loading, genes, stop)
    if stop() and (bin < 0).any():
        if loading.objective.open_bin:
            genes = _low_columns(loading, genes, bin, corner)
        else:
            genes = stand_in_columns(loading, genes, bin, corner)
    return _best(loading, genes, bin, corner)


def _low_columns(loading: Loading, genes: Genes, bin: np.ndarray, corner: np.ndarray) -> Genes:
    """All items in columns, low ones that stand in the one bin: those of a half might not."""
    stock = loading.stock
    x, y, z = stock.bins[0].tolist()
    sizes = stock.sizes[np.arange(len(bin)), genes.turn].astype(np.float64)
    height = int(max(sizes[:, 2].max(), sizes.prod(1).sum() / (x * y)))
    while True:
        bin[:] = -1
        new = stand_in_columns(loading, genes, bin, corner, height)
        if (bin >= 0).all() or height >= z:
            return new
        height += 1 + height // 4


def search_quickly(
    loading: Loading, seed: int, first: Best, stop: Stop, sorts: int = SORTS - 1
) -> Iterator[Best | None]:
    """The sorts, then annealing from the best and from anew: a packing, None where it was cut off.

    Args:
        loading: what is packed.
        seed: of the random choices.
        first: to begin with; the first sort, or where so many `sorts` are 0 the best of all.
        stop: see `pack_quickly`.
        sorts: how many there are besides.
    """
    random = np.random.default_rng([seed, 1])
    best = first
    for lane in range(1, min(sorts, RULED_SORTS) + 1 if loading.ruled else sorts + 1):
        new = quick_packing(loading, lane_genes(loading, seed, lane), stop)
        yield new
        if new is None:
            return
        best = new if new.cost < best.cost else best
    several = len(loading.job.bins) > 1
    passes = draw_bins(loading, seed, stop) if loading.ruled else None
    now, idle, fresh = best, 0, False
    for number in count():
        if passes and number % ANNEALED == 0:
            filled = next(passes)
            new = None if filled is None else _best(loading, *filled)
            yield new
            if new is None:
                return
            best = new if new.cost < best.cost else best
        runs = runs_of(loading, now.genes)
        new = quick_packing(loading, _changed(loading, now.genes.pool, runs, random, several), stop)
        yield new
        if new is None:
            return
        idle = 0 if new.cost < now.cost - 1e-9 else idle + 1
        if new.cost <= now.cost + HEAT * random.exponential() / max(1.0, now.cost):
            now = new
        best = new if new.cost < best.cost else best
        if idle > PATIENCE + len(runs):
            idle, fresh = 0, not fresh
            now = best
            if fresh:
                anew = quick_packing(loading, _shuffled(loading, best.genes.pool, random), stop)
                yield anew
                if anew is None:
                    return
                now = anew


def pack_quickly(
    loading: Loading, genes: Genes, stop: Stop = lambda: False, blocks: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """(bin int32 [N], -1 for what was not packed, corner int32 [N, 3]) by row of the stock.

    Args:
        loading: what is to be packed.
        genes: of one lane.
        stop: asked before every placement; what follows then is not packed.
        blocks: items of a kind that follow each other are placed many at once where the ground is
            level, row by row; if the lowest position is taken.
    """
    stock = loading.stock
    rule = rule_named(loading.rules.rule)
    runs = runs_of(loading, genes, whole=blocks and rule is RULES["lowest"])
    ends = np.cumsum([run.copies for run in runs])
    rows = genes.order[ends - 1]  # one of each run
    turn = [run.turn for run in runs]
    sizes = stock.sizes[rows, turn].astype(np.int64)
    filler = _Filler(
        sizes, stock.needed[rows, turn], stock.weight[rows].astype(np.int64),
        np.asarray([run.copies for run in runs]), rule, stop,
    )  # fmt: skip
    bin, corner = np.full(len(genes.order), -1, np.int32), np.zeros((len(genes.order), 3), np.int32)
    starts, barren = ends - filler.waiting, set[int]()
    no_limit = np.iinfo(stock.limit.dtype).max
    for slot in genes.pool.tolist():
        kind = int(loading.bins[slot])
        if kind in barren:  # what waits has not changed since nothing of it fitted such a bin
            continue
        if not filler.waiting.any() or stop():
            break
        x, y, z = stock.bins[slot].tolist()
        limit = int(stock.limit[slot])
        top = TopMap((x, y, z), loading.flat, int(stock.step), loading.rules.firm)
        placed = list(filler.fill(top, math.inf if limit == no_limit else limit))
        barren = set() if placed else barren | {kind}
        for run, first, corners in placed:
            mine = genes.order[starts[run] + first : starts[run] + first + len(corners)]
            bin[mine], corner[mine] = slot, corners
    return bin, corner


class _Filler:
    """What waits to be packed, by run, and how one bin after the other is filled with it."""

    def __init__(
        self,
        size: np.ndarray,
        needed: np.ndarray,
        weight: np.ndarray,
        count: np.ndarray,
        rule: Rule,
        stop: Stop,
    ) -> None:
        self.size, self.needed, self.weight, self.count = size, needed, weight, count
        self.volume = size.astype(np.float64).prod(1)
        self.waiting = count.copy()
        self.rule, self.stop = rule, stop

    def fill(self, top: TopMap, limit: float) -> Iterator[tuple[int, int, np.ndarray]]:
        """(run, which of its copies is the first, corners) of what comes into a bin."""
        free, left = math.prod(top.room) * (1 + 1e-9), limit
        # Least height, by footprint, of what found no place: nothing higher will before the next.
        refused: dict[tuple[int, int], int] = {}
        offered = np.flatnonzero((self.waiting > 0) & self._may(slice(None), free, left))
        in_vain = 0  # offers since the last that was taken
        while len(offered) and not self.stop():
            if in_vain and in_vain & (in_vain - 1) == 0:  # 1, 2, 4, ...: as many at once
                next_ones, offered = offered[: 4 * in_vain], offered[4 * in_vain :]
                offered = np.concatenate([next_ones[top.have_room(self.size[next_ones])], offered])
                if not len(offered):
                    break
            in_vain += 1
            run, offered = int(offered[0]), offered[1:]
            length, width, height = self.size[run].tolist()
            volume, weight, came = float(self.volume[run]), int(self.weight[run]), False
            while self.waiting[run] and volume <= free and weight <= left:
                if height >= refused.get((length, width), height + 1):
                    break
                corner = top.first(
                    self.rule, (length, width, height), int(self.needed[run]), self.stop
                )
                if corner is None:
                    refused[length, width] = height
                    break
                most = min(int(self.waiting[run]), int(free / volume))
                if weight and left < math.inf:
                    most = min(most, int(left // weight))
                along, rows = 1, 1
                if most > 1:
                    row, beside = top.alike_beside((length, width, height), corner)
                    along = max(1, min(row, most))
                    rows = max(1, min(beside, most // along)) if along == row else 1
                corners = top.place((length, width, height), corner, along, rows)
                yield run, int(self.count[run] - self.waiting[run]), corners
                self.waiting[run] -= len(corners)
                free, left = free - len(corners) * volume, left - len(corners) * weight
                refused.clear()
                came, in_vain = True, 0
            if came:
                offered = offered[self._may(offered, free, left)]

    def _may(self, runs: slice | np.ndarray, free: float, left: float) -> np.ndarray:
        may: np.ndarray = (self.volume[runs] <= free) & (self.weight[runs] <= left)
        return may


def runs_of(loading: Loading, genes: Genes, whole: bool = True) -> list[Run]:
    """The runs of one lane in its order, or one run for every item."""
    item, turn = loading.items[genes.order], genes.turn[genes.order]
    change = (np.diff(item) != 0) | (np.diff(turn) != 0) | (not whole)
    starts = np.concatenate([[0], np.flatnonzero(change) + 1])
    counts = np.diff(np.append(starts, len(item)))
    rows = zip(item[starts].tolist(), turn[starts].tolist(), counts.tolist(), strict=True)
    return [Run(*row) for row in rows]


def genes_of(loading: Loading, runs: list[Run], pool: np.ndarray) -> Genes:
    """The lane of some runs; copies of an item take its rows as they come."""
    kind = np.repeat([run.item for run in runs], [run.copies for run in runs])
    order = np.empty(len(kind), np.int32)
    order[np.argsort(kind, kind="stable")] = np.arange(len(kind))
    turn = np.empty(len(kind), np.int32)
    turn[order] = np.repeat([run.turn for run in runs], [run.copies for run in runs])
    return Genes(order, turn, pool)


def cost_of(loading: Loading, genes: Genes, bin: np.ndarray, corner: np.ndarray) -> float:
    """What a packing costs to the search: see `Objective.cost`."""
    lies = loading.stock.sizes[np.arange(len(bin)), genes.turn]
    placed = Placed(bin[None], corner[None], lies[None])
    return float(loading.objective.cost(loading.stock, placed)[0])


def quick_packing(loading: Loading, genes: Genes, stop: Stop) -> Best | None:
    """The packing of one lane; None where it was cut off."""
    if loading.ruled:
        packing = pack_by_rules(loading, genes, stop, to_end=False)
    else:
        packing = genes, *pack_quickly(loading, genes, stop)
    return None if stop() else _best(loading, *packing)


def _best(loading: Loading, genes: Genes, bin: np.ndarray, corner: np.ndarray) -> Best:
    return Best(genes, bin, corner, cost_of(loading, genes, bin, corner))


def _changed(
    loading: Loading, pool: np.ndarray, runs: list[Run], random: np.random.Generator, several: bool
) -> Genes:
    """One random change: a run elsewhere, two exchanged, one turned, in part or whole; or bins."""
    runs = list(runs)
    one, two = random.integers(len(runs), size=2).tolist()
    run, choice = runs[one], random.random()
    ways = len(loading.ways[run.item])
    if several and choice < 0.2:
        first, second = (
            random.integers(min(len(pool), 2 * len(runs) + 8)),
            random.integers(len(pool)),
        )
        pool = pool.copy()
        pool[[first, second]] = pool[[second, first]]
    elif ways > 1 and (choice > 0.7 or len(runs) == 1):
        turned = int((run.turn + random.integers(1, ways)) % ways)
        part = run.copies if random.random() < 0.5 else int(random.integers(1, run.copies + 1))
        runs[one : one + 1] = [Run(run.item, turned, part), run._replace(copies=run.copies - part)]
        runs = [some for some in runs if some.copies]
    elif choice < 0.45:
        runs[one], runs[two] = runs[two], runs[one]
    else:
        part = run.copies if random.random() < 0.5 else int(random.integers(1, run.copies + 1))
        runs[one] = run._replace(copies=run.copies - part)
        runs.insert(two, run._replace(copies=part))
        runs = [some for some in runs if some.copies]
    return genes_of(loading, runs, pool)


def _shuffled(loading: Loading, pool: np.ndarray, random: np.random.Generator) -> Genes:
    kinds, counts = np.unique(loading.items, return_counts=True)
    chosen = random.permutation(len(kinds))
    runs = [
        Run(int(kinds[n]), int(random.integers(len(loading.ways[kinds[n]]))), int(counts[n]))
        for n in chosen
    ]
    return genes_of(loading, runs, pool)
