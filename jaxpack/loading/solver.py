"""From a job to a plan, in the time that is given: the best of everything that was tried."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum, auto
from math import inf
from time import perf_counter

import numpy as np

from jaxpack.loading.background import SearchProcess, borrow, give_back
from jaxpack.loading.bounds import Bounds, bounds
from jaxpack.loading.figures import plan_worth, total_cost
from jaxpack.loading.job import Job, Plan
from jaxpack.loading.quick import Best, quick_plan, search_quickly
from jaxpack.loading.stock import Loading, Rules, compiles, lane_genes, load_job, plan_of
from jaxpack.loading.validate import check_plan

TICK = 0.05  # seconds between looks at the clock
FIRST = 0.5  # share of the time after which the first plan is ended in columns
BOUNDING = 0.15  # share of the time that bounds may take
CHECKING = 4  # times as long as to encode a job it takes to decode a plan and to check it


@dataclass(frozen=True)
class SolveOptions:
    """How to pack."""

    time_limit: float = 10.0  # seconds, compilation included
    seed: int = 0
    support: float = Rules.support
    inclusive: bool = Rules.inclusive
    resolution: float | None = None  # corners stand on a grid of this length; anywhere if not given
    skip_unfit: bool = False
    policy: bool = True  # whether the shipped policy draws orders for the search to go on from

    @property
    def rules(self) -> Rules:
        """What holds for every item."""
        return Rules(self.support, self.inclusive)


class End(Enum):
    """What ends a search."""

    BOUND = auto()  # no plan can be better
    TIME = auto()
    UNREADY = auto()  # time, before the compiled search was ready
    INTERRUPT = auto()


@dataclass(frozen=True)
class Progress:
    """The best plan so far. It has passed the check."""

    plan: Plan
    bins: int
    cost: float
    bounds: Bounds
    seconds: float  # since the start
    packings: int  # tried so far
    end: End | None  # of the search; None where it goes on


def solve_job(
    job: Job,
    options: SolveOptions = SolveOptions(),
    stop: Callable[[], bool] = lambda: False,
) -> Progress:
    """The last one of `improve`."""
    *_, last = improve(job, options, stop)
    return last


def improve(
    job: Job,
    options: SolveOptions = SolveOptions(),
    stop: Callable[[], bool] = lambda: False,
) -> Iterator[Progress]:
    """Better and better plans until the time is up, the last one being the best.

    Args:
        job: what is packed into what.
        options: how.
        stop: asked many times a second; ends the search early, with a plan.

    Raises:
        UserError: where an item fits no bin.
        InvalidPlanError: never, unless this program is wrong.
    """
    begun = perf_counter()
    loading = load_job(job, options.rules, options.resolution, options.skip_unfit)
    checking = CHECKING * (perf_counter() - begun)
    record = _Record(loading, bounds(job, BOUNDING * options.time_limit), begun)
    end = begun + options.time_limit - checking

    def late() -> bool:
        return perf_counter() > end or stop()

    for found, tried in _searches(loading, options, begun, end, late, stop):
        if progress := record.with_one(found, tried):
            yield progress
            if progress.end:
                return
    searched = record.packings_compiled or not compiles(loading)
    ended = End.INTERRUPT if stop() else End.TIME if searched else End.UNREADY
    yield record.progress(ended)


class _Record:
    """The best plan that a search has met."""

    def __init__(self, loading: Loading, bounds: Bounds, begun: float) -> None:
        self.loading, self.bounds, self.begun = loading, bounds, begun
        self.packings = self.packings_compiled = 0
        self.cost, self.worth = inf, (inf,)
        self.plan = Plan(())

    def with_one(self, found: Best | None, tried: int) -> Progress | None:
        """With one packing more: the progress it is, None if it is none."""
        self.packings += tried
        if found is None or found.cost > self.cost - 1e-6:
            return None
        self.cost = found.cost
        genes, loading = found.genes, self.loading
        types = cheapest_types(loading, genes.turn, found.bin, found.corner)
        plan = plan_of(loading, genes.order, genes.turn, found.bin, found.corner, types)
        worth = plan_worth(loading.job, plan)
        if worth >= self.worth:
            return None
        check_plan(loading.job, plan, loading.rules.support, loading.rules.inclusive)
        self.plan, self.worth = plan, worth
        return self.progress(End.BOUND if self._at_bound() else None)

    def progress(self, end: End | None) -> Progress:
        """What there is now."""
        job, plan, seconds = self.loading.job, self.plan, perf_counter() - self.begun
        cost = total_cost(job, plan)
        return Progress(plan, len(plan.bins), cost, self.bounds, seconds, self.packings, end)

    def _at_bound(self) -> bool:
        return self.bounds.reached_by(self.loading.job, self.plan)


def _searches(
    loading: Loading,
    options: SolveOptions,
    begun: float,
    end: float,
    late: Callable[[], bool],
    stop: Callable[[], bool],
) -> Iterator[tuple[Best | None, int]]:
    """(a packing or None, packings tried since), until it is late: first of all one at once."""
    first_end = begun + FIRST * (end - begun)
    genes = lane_genes(loading, options.seed, 0)
    best = quick_plan(loading, genes, lambda: perf_counter() > first_end or stop())
    yield best, 1
    if not compiles(loading):
        for found in search_quickly(loading, options.seed, best, late):
            yield found, int(found is not None)
        return
    process = borrow()
    try:
        yield from _beside(process, loading, options, end, best, late)
    finally:
        give_back(process)


def _beside(
    process: SearchProcess,
    loading: Loading,
    options: SolveOptions,
    end: float,
    best: Best,
    late: Callable[[], bool],
) -> Iterator[tuple[Best | None, int]]:
    """Packings of the search in NumPy until the compiled one is ready, of that one from then on."""
    policy = f"bin-aware-{loading.job.dimension}d-turned" if options.policy else ""
    process.ask(loading, options.seed, end - perf_counter(), best.genes, policy)
    waiting = search_quickly(
        loading, options.seed, best, lambda: late() or (process.ready and process.alive)
    )
    for found in waiting:
        if found is not None:
            yield found, 1
    while not late():
        reply = process.next(min(TICK, end - perf_counter()))
        if isinstance(reply, int):
            yield None, reply
        elif reply is not None:
            yield Best(reply.genes, reply.bin, reply.corner, reply.cost), reply.packings
        elif not process.alive:  # it ran out of memory, or somebody ended it
            for found in search_quickly(loading, options.seed + 1, best, late):
                yield found, int(found is not None)


def cheapest_types(
    loading: Loading, turn: np.ndarray, bin: np.ndarray, corner: np.ndarray
) -> dict[int, int]:
    """For every bin that is used the type to take for it: the cheapest one left that can hold it.

    Args:
        loading: what was packed.
        turn, bin, corner: of one lane, by row of the stock.

    Returns:
        Index of `Stock.bins` -> index in Job.bins.
    """
    job, stock = loading.job, loading.stock
    slots, number = np.unique(bin[bin >= 0], return_inverse=True)
    own = loading.bins[slots]
    as_packed = dict(zip(slots.tolist(), own.tolist(), strict=True))
    if len(job.bins) == 1:
        return as_packed
    rows = np.flatnonzero(bin >= 0)
    ends = corner[rows].astype(np.int64) + stock.sizes[rows, turn[rows]]
    reach, weight = np.zeros((len(slots), 3), np.int64), np.zeros(len(slots), np.int64)
    np.maximum.at(reach, number, ends)
    np.add.at(weight, number, stock.weight[rows].astype(np.int64))
    kinds, first = np.unique(loading.bins, return_index=True)
    no_limit = np.iinfo(stock.limit.dtype).max
    prices = [
        (stock.price[row], kind) for kind, row in zip(kinds.tolist(), first.tolist(), strict=True)
    ]
    left = {kind: job.bins[kind].copies for kind in kinds.tolist()}
    chosen = {}
    # The dearest bins choose first: they have the most to save.
    for n in np.argsort(-stock.price[slots], kind="stable").tolist():
        able = [
            (price, kind != own[n], kind)
            for (price, kind), row in zip(prices, first.tolist(), strict=True)
            if left[kind] != 0
            and (reach[n] <= stock.bins[row]).all()
            and (stock.limit[row] == no_limit or weight[n] <= stock.limit[row])
        ]
        if not able:  # another one took the copy it had
            return as_packed
        kind = min(able)[2]
        chosen[int(slots[n])] = kind
        copies = left[kind]
        left[kind] = None if copies is None else copies - 1
    return chosen
