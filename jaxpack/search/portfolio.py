"""From a job to a plan, in the time that is given: the best of everything that was tried."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from math import inf
from time import perf_counter

import numpy as np

from jaxpack.model.encoding import Genes, Loading, compiles, lane_genes, load_job
from jaxpack.model.job import Job
from jaxpack.model.objectives import bounds
from jaxpack.model.rules import Rules
from jaxpack.search.background import UNSENDABLE, SearchProcess, borrow, give_back
from jaxpack.search.beam import alone
from jaxpack.search.bin_values import has_values
from jaxpack.search.block_policy import shipped
from jaxpack.search.local_search import Best, better
from jaxpack.search.quick import SORTS, quick_packing, quick_plan
from jaxpack.search.record import End, Progress, Record
from jaxpack.search.requests import Request
from jaxpack.search.uncompiled import all_differ, search_uncompiled

SECONDS = 10.0
ALONE = 0.3  # share of the time in which orders are not searched, where most items have their like
UNCOMPILED = 48  # packings before the compiled search, where their number is given
TICK = 0.05  # seconds between looks at the clock
QUICK = 2  # packings that most orders are done with, before bounds are worked out that take time
BOUNDING = 0.15  # share of the time that these may take
CHECKING = 100  # times as long as to sort the items it takes to decode a plan and to check it,
PER_ITEM = 1e-4  # or so many seconds an item, where something else slowed the sorting down


@dataclass(frozen=True)
class SolveOptions:
    """How to pack."""

    time_limit: float | None = None  # seconds, compilation included; see `seconds`
    seed: int = 0
    rules: Rules = Rules()
    resolution: float | None = None  # corners stand on a grid of this length; anywhere if not given
    skip_unfit: bool = False
    policy: bool = True  # whether the shipped ones choose blocks, and draw orders to go on from
    packings: int | None = None  # that are tried at most: with one seed the plan is the same then

    @property
    def seconds(self) -> float:
        """The time limit: where none is given 10, but none if there is a number of packings."""
        if self.time_limit is not None:
            return self.time_limit
        return SECONDS if self.packings is None else inf


def policy_name(dimension: int) -> str:
    """Which of the shipped policies draws orders."""
    return f"bin-aware-{dimension}d-turned"


def solve_job(
    job: Job,
    options: SolveOptions = SolveOptions(),
    stop: Callable[[], bool] = lambda: False,
    progress: Callable[[Progress], object] = lambda better: None,
) -> Progress:
    """The last one of `improve`.

    Args:
        job, options, stop: see there.
        progress: called with every plan that is better than those before; ends the search, as
            `stop` does, if it returns something true.
    """
    told, last = False, None

    def stopped() -> bool:
        return told or stop()

    for found in improve(job, options, stopped):
        if last is None or found.plan is not last.plan:
            told = bool(progress(found)) or told
        last = found
    assert last is not None, "there is a first plan"
    return last


def improve(
    job: Job,
    options: SolveOptions = SolveOptions(),
    stop: Callable[[], bool] = lambda: False,
) -> Iterator[Progress]:
    """Better and better plans until time or packings are used up, the last one being the best.

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
    record = Record(job, loading, bounds(job, 0.0, options.rules), begun)
    sorting = perf_counter()
    first = lane_genes(loading, options.seed, 0)
    checking = min(CHECKING * (perf_counter() - sorting), PER_ITEM * len(loading.items))
    end = begun + options.seconds - checking

    def late() -> bool:
        return perf_counter() > end or stop()

    searches = _Searches(loading, options, end, late)
    tries = searches.run(first)
    for some in (islice(tries, QUICK), tries):
        for found, tried in some:
            if progress := record.with_one(found, tried):
                yield progress
                if progress.end:
                    return
        if some is not tries and not late():
            seconds = min(BOUNDING * options.seconds, end - perf_counter())
            closer = bounds(job, seconds if options.packings is None else None, options.rules)
            if progress := record.bounded(closer):
                yield progress
                return
    yield record.progress(End.INTERRUPT if stop() else searches.end_of(record.packings))


class _Searches:
    """The search in NumPy, and the compiled one once it is ready."""

    def __init__(
        self,
        loading: Loading,
        options: SolveOptions,
        end: float,
        late: Callable[[], bool],
    ) -> None:
        self.loading, self.options = loading, options
        self.end, self.late = end, late
        stock = loading.stock
        alike = len(np.unique(np.column_stack([stock.sizes[:, 0], stock.weight]), axis=0))
        # Where most items have their like, orders of items are not worth searching from the start.
        self.fills = has_values(loading)
        self.orders_first = not self.fills or all_differ(loading)
        # It has learned from orders of copies in 3D.
        self.learned = options.policy and not loading.flat and 2 * alike <= len(loading.items)
        self.ready = True  # whether all that was asked has searched
        self.compiled = False  # whether the compiled search searches
        self.lost = False  # whether its process has ended before it
        self.best: Best | None = None

    def run(self, first: Genes) -> Iterator[tuple[Best | None, int]]:
        """(a packing or None, packings tried since), until it is late: at once one of `first`."""
        for found, tried in self._all(first):
            if found:
                self.best = better(self.best or found, found)
            yield found, tried

    def _all(self, first: Genes) -> Iterator[tuple[Best | None, int]]:
        best = quick_plan(self.loading, first, self.late)
        yield best, 1
        left = (self.options.packings or inf) - 1
        for other in self._by_type(left):
            yield other, 1
            best, left = better(best, other), left - 1
        if self.options.packings is not None:
            yield from self._counted(best, int(left))
            return
        quickly = self._quickly(best, self.late)
        # Most orders are done before anything starts.
        start = perf_counter() + (0 if self.orders_first else ALONE * (self.end - perf_counter()))
        for number, (found, tried) in enumerate(quickly, 1):
            yield found, tried
            if number >= SORTS and perf_counter() >= start:
                break
        process = self._asked() if compiles(self.loading) else None
        if process is None:
            yield from quickly
            return
        try:
            yield from self._beside(process, quickly)
        finally:
            give_back(process)

    def _by_type(self, most: float) -> Iterator[Best]:
        """Packings into each type of bins before the others: bins by value mix them."""
        types = len(self.loading.job.bins)
        lanes = 0 if types == 1 or self.orders_first else min(types, most)
        for lane in range(1, int(lanes) + 1):
            genes = lane_genes(self.loading, self.options.seed, lane)
            found = quick_packing(self.loading, genes, self.late)
            if found is None:
                return
            yield found

    def end_of(self, packings: int) -> End:
        """Why a search ends that has tried so many and was not interrupted."""
        if self.lost:
            return End.LOST
        if self.options.packings is not None and packings >= self.options.packings:
            return End.BUDGET
        return End.TIME if self.ready else End.UNREADY

    def _quickly(
        self, best: Best, stop: Callable[[], bool], sorts: int = SORTS - 1
    ) -> Iterator[tuple[Best | None, int]]:
        """What nobody has to compile."""
        judge = shipped() if self.learned else None
        search = search_uncompiled(
            self.loading, self.options.seed, stop, best, self.end, lambda: self.best, judge,
            sorts=sorts, others=lambda: self.compiled,
        )  # fmt: skip
        return alone(search, stop)

    def _counted(self, best: Best, left: int) -> Iterator[tuple[Best | None, int]]:
        """So many packings, whatever the clock says: some that nobody compiles, the compiled
        search, and what is too little for that or left by it.
        """
        quickly = self._quickly(best, self.late, min(SORTS - 1, left))
        compiled = self.orders_first and compiles(self.loading) and left > UNCOMPILED
        for found, tried in islice(quickly, UNCOMPILED if compiled else left):
            left -= tried
            yield found, tried
        if compiled and (process := self._asked(left)):
            try:
                while process.running and process.alive and not self.late():
                    for found, tried in self._reply(process):
                        left -= tried
                        yield found, tried
                self.lost = process.lost
            finally:
                give_back(process)
        self.compiled = False
        yield from islice(quickly, left)

    def _asked(self, packings: int | None = None) -> SearchProcess | None:
        """A process that begins the compiled search, if there can be one."""
        if self.late() or self.best is None:
            return None
        loading, seed = self.loading, self.options.seed
        draws = self.options.policy and not loading.objective.open_bin  # it sees shares of a bin
        policy = policy_name(loading.job.dimension) if draws else ""
        left = self.end - perf_counter()
        try:
            process = borrow()
        except OSError:  # an embedded interpreter, or no room for another process
            return None
        try:
            process.ask(Request(loading, seed, left, self.best.genes, policy, packings))
        except UNSENDABLE:  # an objective that has no name in any module
            give_back(process)
            return None
        return process

    def _reply(self, process: SearchProcess) -> Iterator[tuple[Best | None, int]]:
        """Its next packing, if one comes soon."""
        reply = process.next(min(TICK, self.end - perf_counter()))
        if isinstance(reply, int):
            yield None, reply
        elif reply is not None:
            self.ready = self.compiled = True
            yield reply.best, reply.packings

    def _beside(
        self, process: SearchProcess, quickly: Iterator[tuple[Best | None, int]]
    ) -> Iterator[tuple[Best | None, int]]:
        self.ready = not self.orders_first
        while not self.late():
            yield from islice(quickly, 1)
            while process.ready and not self.late():
                yield from self._reply(process)
            if self.compiled and not self.fills:
                yield from self._reply(process)
            if process.lost:
                self.compiled, self.lost = False, True
