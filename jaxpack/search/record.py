"""The best plan that a search has met, in the words of the job, and checked."""

from dataclasses import dataclass
from enum import Enum, auto
from math import inf
from time import perf_counter

from jaxpack.model.bounds import Bounds
from jaxpack.model.encoding import Loading, plan_of
from jaxpack.model.figures import total_cost
from jaxpack.model.job import Job, Plan
from jaxpack.model.objectives import gap, objective_of
from jaxpack.model.plan_check import check_plan
from jaxpack.search.bin_types import cheapest_types
from jaxpack.search.local_search import Best


class End(Enum):
    """What ends a search."""

    BOUND = auto()  # no plan can be better
    TIME = auto()
    UNREADY = auto()  # time, before the compiled search was ready
    BUDGET = auto()  # packings
    LOST = auto()  # one of both, but the process of the compiled search had ended before
    INTERRUPT = auto()
    ONLINE = auto()  # items came one by one: there was nothing to search for


@dataclass(frozen=True)
class Progress:
    """The best plan so far. It has passed the check."""

    job: Job
    plan: Plan
    bounds: Bounds
    seconds: float  # since the start
    packings: int  # tried so far
    end: End | None  # of the search; None where it goes on

    @property
    def bins(self) -> int:
        """How many are used."""
        return len(self.plan.bins)

    @property
    def cost(self) -> float:
        """Of all of them."""
        return total_cost(self.job, self.plan)

    @property
    def measure(self) -> float:
        """The number that is minimised first, or maximised: bins, their cost, value, height."""
        return objective_of(self.job).measure(self.job, self.plan)

    @property
    def bound(self) -> float:
        """What no plan's measure is better than."""
        return self.bounds.best

    @property
    def gap(self) -> float | None:
        """How far the measure is from the bound at most: see `objectives.gap`."""
        return gap(self.job, self.plan, self.bounds)


class Record:
    """The best plan that a search has met."""

    def __init__(self, job: Job, loading: Loading, bounds: Bounds, begun: float) -> None:
        self.job, self.loading, self.bounds, self.begun = job, loading, bounds, begun
        self.packings, self.cost = 0, inf
        self.plan: Plan | None = None

    def with_one(self, found: Best | None, tried: int) -> Progress | None:
        """With one packing more: the progress it is, None if it is none."""
        self.packings += tried
        loading = self.loading
        if found is None or (
            found.cost > self.cost - 1e-6 and "cost" not in loading.objective.parts
        ):
            return None
        self.cost, genes = found.cost, found.genes
        types = cheapest_types(loading, genes.turn, found.bin, found.corner, genes.order)
        plan = plan_of(loading, genes.order, genes.turn, found.bin, found.corner, types)
        worth = loading.objective.worth(loading.given, plan)
        if self.plan and worth >= loading.objective.worth(loading.given, self.plan):
            return None
        check_plan(loading.given, plan, loading.rules)
        self.plan = plan
        return self.progress(End.BOUND if worth <= self.bounds.worth else None)

    def bounded(self, bounds: Bounds) -> Progress | None:
        """With other bounds: the progress it is if the plan is at them."""
        self.bounds = bounds
        assert self.plan, "the first packing is one"
        at_them = self.loading.objective.worth(self.job, self.plan) <= bounds.worth
        return self.progress(End.BOUND) if at_them else None

    def with_other(self, found: Progress) -> End | None:
        """With what another search of the job has found: `BOUND` if the plan is at it."""
        self.packings += found.packings
        worth = self.loading.objective.worth
        assert self.plan, "the first packing is one"
        if worth(self.job, found.plan) < worth(self.job, self.plan):
            self.plan = found.plan
        self.bounds = max(self.bounds, found.bounds, key=lambda one: one.worth)
        return End.BOUND if worth(self.job, self.plan) <= self.bounds.worth else None

    def progress(self, end: End | None) -> Progress:
        """What there is now."""
        assert self.plan, "the first packing is one"
        seconds = perf_counter() - self.begun
        return Progress(self.job, self.plan, self.bounds, seconds, self.packings, end)
