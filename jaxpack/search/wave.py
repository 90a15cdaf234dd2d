"""Many orders packed side by side: the bins that they fill are filled together.

All of them get a plan first. Those that are not at their bound go on, the ones that had fewer
packings before the others; what is left of much time in the end goes to a search of its own for
each of those that could still win. What is found for an order depends on it, the seed and the
number of packings alone, not on the orders beside it.
"""

from collections import deque
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from math import inf
from time import perf_counter
from typing import Any

from jaxpack.errors import UserError
from jaxpack.model.encoding import lane_genes, load_job
from jaxpack.model.job import Job
from jaxpack.model.objectives import bounds
from jaxpack.search.beam import Asked, fill
from jaxpack.search.local_search import Best, better
from jaxpack.search.portfolio import SolveOptions, solve_job
from jaxpack.search.quick import quick_plan
from jaxpack.search.record import End, Progress, Record
from jaxpack.search.together import Fill, fill_together
from jaxpack.search.uncompiled import search_uncompiled

DRAWS = (1, 2, 4, 4, 8, 8, 16, None)  # fillings of a bin in the first passes; most need no more
WINDOW = 512  # orders that are searched side by side
LESSER = 16  # packings that count as one where only what comes after the measure can be won
BOUNDED = {8: 0.02, 32: 0.2}  # packings -> seconds for better bounds then
DEEP, SHARE = 32, 1.0  # packings after which an order may be searched alone, for so many seconds

Tell = Callable[[int, Progress], object]
"""Takes the number of an order and its progress."""


def canonical_order(job: Job) -> list[int]:
    """The items in an order that does not depend on that of their rows: indices of `Job.items`."""

    def key(number: int) -> tuple[Any, ...]:
        item = job.items[number]
        profit = -1.0 if item.profit is None else item.profit
        limits = repr(item.limits)
        return item.size, item.weight, item.orientations, profit, item.copies, limits, item.name

    return sorted(range(len(job.items)), key=key)


class _Order:
    """How far one of them is."""

    def __init__(self, number: int, job: Job, options: SolveOptions, stop: Callable[[], bool]):
        begun = perf_counter()
        self.given, self.place = job, canonical_order(job)
        self.job = job = copy(job)  # it has been checked
        object.__setattr__(job, "items", tuple(job.items[n] for n in self.place))
        loading = load_job(job, options.rules, options.resolution, options.skip_unfit)
        self.number, self.loading = number, loading
        self.record = Record(job, loading, bounds(job, 0.0, options.rules), begun)
        self.best: Best | None = None
        self.search = search_uncompiled(
            loading, options.seed, stop, known=lambda: self.best, draws=DRAWS
        )
        self.filled: Any = None
        self.turns = 0
        self.above = True  # whether the measure itself may be better
        self.ended: End | None = None

    def go_on(self) -> Asked | None:
        """Until bins have to be filled, or to the end of a packing: None."""
        try:
            event = self.search.send(self.filled)
        except StopIteration:
            return None
        self.filled = None
        if isinstance(event, Asked):
            return event
        self.take(*event)
        return None

    def take(self, found: Best | None, tried: int) -> None:
        """A packing, if there is one."""
        self.turns += 1
        if found:
            self.best = better(self.best or found, found)
        if progress := self.record.with_one(found, tried):
            self.ended, self.above = progress.end, progress.gap != 0

    def progress(self, why: End | None = None) -> Progress:
        """What there is now, of the order as it was given."""
        now, place = self.record.progress(self.ended or why), self.place
        bins = tuple(
            replace(
                packed,
                placements=tuple(replace(put, item=place[put.item]) for put in packed.placements),
            )
            for packed in now.plan.bins
        )
        plan = replace(now.plan, bins=bins, left_out=tuple(place[n] for n in now.plan.left_out))
        return replace(now, job=self.given, plan=plan)

    def bound(self, seconds: float) -> None:
        """Looks for better bounds."""
        if progress := self.record.bounded(bounds(self.job, seconds, self.loading.rules)):
            self.ended = progress.end
        self.above = self.record.progress(None).gap != 0

    @property
    def rank(self) -> float:
        """The lower, the earlier it goes on."""
        return self.turns * (1 if self.above else LESSER)


def pack_wave(
    jobs: Sequence[Job],
    options: SolveOptions,
    stop: Callable[[], bool] = lambda: False,
    tell: Tell = lambda number, found: None,
    fill: Fill = fill,
) -> list[Progress | UserError | None]:
    """For every order its last progress, what is wrong with it, or None if it was not begun.

    Args:
        jobs: of the orders.
        options: seconds are those for all of them together, packings those for each.
        stop: asked many times a second; ends the searches early.
        tell: called with the first packing of every order, and when it ends.
        fill: what fills the bins.
    """
    wave = _Wave(jobs, options, stop, tell, fill)
    while not wave.late() and (wave.rest or wave.waiting or wave.active):
        if not wave.rest and wave.has_time():
            wave.search_alone()
            break
        wave.go_on()
    while wave.rest and not stop():  # a plan for each, however late it is
        wave.begin()
    wave.close(wave.active + wave.waiting)
    return wave.ended


class _Wave:
    """Orders on their way."""

    def __init__(
        self,
        jobs: Sequence[Job],
        options: SolveOptions,
        stop: Callable[[], bool],
        tell: Tell,
        fill: Fill,
    ) -> None:
        self.options, self.stop, self.tell, self.fill = options, stop, tell, fill
        self.ended: list[Progress | UserError | None] = [None] * len(jobs)
        self.rest = deque(enumerate(jobs))
        self.active, self.waiting = list[_Order](), list[_Order]()
        self.end, self.most = perf_counter() + options.seconds, options.packings or inf

    def late(self) -> bool:
        """Whether there is no time left."""
        return perf_counter() > self.end or self.stop()

    def begin(self) -> None:
        """With the next order."""
        number, job = self.rest.popleft()
        try:
            self.active.append(_Order(number, job, self.options, self.late))
        except UserError as error:
            self.ended[number] = error

    def admit(self) -> None:
        """Those that are next to the others: new ones first, then by their rank."""
        while self.rest and len(self.active) < WINDOW and not self.late():
            self.begin()
        if self.rest or not self.waiting or len(self.active) >= WINDOW:
            return
        # Those of which the measure may be won wait for nobody, the others for them.
        level = 1 + min((one.rank for one in self.active + self.waiting if one.above), default=inf)
        self.waiting.sort(key=lambda one: (one.rank, one.number))
        may = [one for one in self.waiting if one.above or one.rank < level]
        some = may[: WINDOW - len(self.active)]
        gone = {one.number for one in some}
        self.active += some
        self.waiting = [one for one in self.waiting if one.number not in gone]

    def go_on(self) -> None:
        """With the next bins of those that are packed side by side."""
        self.admit()
        asked, done = [], []
        for one in self.active:
            what = one.go_on()
            done.append(one) if what is None else asked.append((one, what))
        full = fill_together([what for _, what in asked], self.late, self.fill)
        for (one, _), filled in zip(asked, full, strict=True):
            one.filled = filled
        self.active = [one for one, _ in asked]
        for one in done:
            if one.record.plan is None:  # it was late, or the packing was none
                continue
            if one.turns == 1:
                self.tell(one.number, one.record.progress(None))
            going = one.above and not one.ended and one.record.packings < self.most
            if going and one.turns in BOUNDED and not self.late():
                most = inf if self.options.packings else BOUNDED[one.turns]
                one.bound(min(most, self.end - perf_counter()))
        self.keep(done)

    def keep(self, orders: Sequence[_Order]) -> None:
        """Those that are not done; the others end."""
        done = [one for one in orders if one.ended or one.record.packings >= self.most]
        self.close(done)
        gone = {one.number for one in done}
        self.waiting += [one for one in orders if one.number not in gone]

    def close(self, orders: Sequence[_Order]) -> None:
        """Ends some."""
        for one in orders:
            used_up = one.record.packings >= self.most
            why = End.BUDGET if used_up else End.INTERRUPT if self.stop() else End.TIME
            if one.record.plan is None:
                genes = lane_genes(one.loading, self.options.seed, 0)
                one.take(quick_plan(one.loading, genes, self.late), 1)
            self.ended[one.number] = found = one.progress(why)
            one.search.close()  # it knows the order, which knows it: free them now, not some day
            self.tell(one.number, found)

    def above(self) -> list[_Order]:
        """Those of which the measure may be better."""
        return [one for one in self.active + self.waiting if one.above]

    def has_time(self) -> bool:
        """Whether it is worth while to search each that could still win alone."""
        above = self.above()
        if self.options.packings or not above or any(one.turns < DEEP for one in above):
            return False
        return self.end - perf_counter() >= SHARE * len(above)

    def search_alone(self) -> None:
        """Each that could still win, for its share of the time."""
        above = self.above()
        for number, one in enumerate(above):
            share = (self.end - perf_counter()) / (len(above) - number)
            if share > 0 and not self.stop():
                options = replace(self.options, time_limit=share)
                one.ended = one.record.with_other(solve_job(one.job, options, self.stop))
