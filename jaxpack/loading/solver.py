"""From a job to a plan, in the time that is given: the best of everything that was tried."""

import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, wait
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxpack.learning.recipe import Policy
from jaxpack.loading.exact import exact
from jaxpack.loading.figures import cost_bound, lower_bound, total_cost
from jaxpack.loading.job import Job, Placement, Plan, Sides
from jaxpack.loading.learned import policy_genes
from jaxpack.loading.local_search import (
    ANNEAL,
    AS_GIVEN,
    BREED,
    Best,
    Genes,
    Lanes,
    advance,
    exchange,
    fresh_lanes,
    join,
)
from jaxpack.loading.quick import LANES as QUICK
from jaxpack.loading.quick import quick_plan
from jaxpack.loading.stock import Loading, first_genes, load_job, plan_of
from jaxpack.loading.units import units_of
from jaxpack.loading.validate import check_plan

T = TypeVar("T")

LANES, FEW_LANES, MANY_ITEMS = 32, 8, 256  # fewer where a round of many items takes seconds
ROUNDS = 8  # per dispatch, fewer where they take longer than a BREATH
BREATH = 0.25  # seconds
THREAD = "jaxpack plan"  # name of those that compile and search
EXCHANGE = 4  # dispatches after which those that breed and those that anneal share their best
HEAT = 0.02  # of the annealing at the start, in bins


@dataclass(frozen=True)
class SolveOptions:
    """How to pack."""

    time_limit: float = 10.0  # seconds, compilation included
    seed: int = 0
    support: float = 0.5  # least share of a footprint that must be carried
    resolution: float | None = None  # round sizes up to this grid; exact if not given
    skip_unfit: bool = False


@dataclass(frozen=True)
class Progress:
    """The best plan so far."""

    plan: Plan
    bins: int
    cost: float
    bound: int  # no plan has fewer bins
    seconds: float  # since the start
    packings: int  # tried so far
    limited_by: str = "time"  # what ends the search


def solve_job(
    job: Job, options: SolveOptions = SolveOptions(), policy: Policy | None = None
) -> Progress:
    """The best plan found in the time: checked, in the user's units. `policy`: see `improve`.

    Raises:
        UserError: where an item fits no bin, or the bins that there are do not hold the items.
        InvalidPlanError: never, unless this program is wrong.
    """
    last = None
    for progress in improve(job, options, policy):
        last = progress
    assert last is not None
    return last


def improve(
    job: Job,
    options: SolveOptions = SolveOptions(),
    policy: Policy | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> Iterator[Progress]:
    """Better and better plans until the time is up, the last one being the best.

    Args:
        policy: a bin-aware one for the job's dimension; the search goes on from its orders too.
        stop: asked before every turn of the search, once it is compiled; ends it early.

    Raises:
        UserError: where an item fits no bin.
        InvalidPlanError: never, unless this program is wrong.
    """
    begun = time.perf_counter()
    units = units_of(job, options.resolution)
    loading, left_out = load_job(job, units, options.support, True, options.skip_unfit)
    slack = 0.0 if units.exact else float(units.length)
    goal = _Goal(job, lower_bound(job), cost_bound(job), len(left_out))
    packings, best_cost, best_worth = 0, math.inf, (math.inf, math.inf)
    for best, tried in _searches(loading, options, policy, begun, stop):
        packings += tried
        if float(best.cost) > best_cost - 1e-6:
            continue
        best_cost = float(best.cost)
        found = _decoded(loading, best, left_out)
        # What the search compares is without the exchange of bins for cheaper ones.
        if (worth := (len(found.left_out), total_cost(job, found))) > best_worth:
            continue
        plan, best_worth = found, worth
        check_plan(job, plan, options.support, True, slack)
        reached = goal.reached_by(plan)
        yield _progress(goal, plan, begun, packings, "the bound" if reached else "time")
        if reached:
            return
    compiling = packings <= len(QUICK)
    ended = "time, which went into compiling" if compiling else "time"
    yield _progress(goal, plan, begun, packings, "an interrupt" if stop() else ended)


@dataclass(frozen=True)
class _Goal:
    """What no plan can better."""

    job: Job
    bound: int  # bins
    least_cost: float
    unfit: int  # copies that are left out whatever happens

    def reached_by(self, plan: Plan) -> bool:
        """Whether there is nothing left to win."""
        cheap = total_cost(self.job, plan) <= self.least_cost * (1 + 1e-9)
        alike = len({bin.price for bin in self.job.bins}) == 1
        few = alike and len(plan.bins) <= self.bound
        return len(plan.left_out) == self.unfit and (cheap or few)


def _progress(goal: _Goal, plan: Plan, begun: float, packings: int, limited_by: str) -> Progress:
    seconds, cost = time.perf_counter() - begun, total_cost(goal.job, plan)
    return Progress(plan, len(plan.bins), cost, goal.bound, seconds, packings, limited_by)


def _searches(
    loading: Loading,
    options: SolveOptions,
    policy: Policy | None,
    begun: float,
    stop: Callable[[], bool],
) -> Iterator[tuple[Best, int]]:
    """(a packing, the best one of the search, packings tried since), until the time is up."""
    end = begun + options.time_limit
    many = LANES if len(loading.stock.mask) <= MANY_ITEMS else FEW_LANES
    lanes = yield from _first_lanes(loading, options.seed, many, end)
    if lanes is None:
        return
    drawn, seeds = None, list[Genes]()
    if policy:
        drawn = _in_thread(partial(policy_genes, loading, policy, options.seed))
    # Two on every core, which take turns: the even ones breed, the odd ones anneal.
    islands = [lanes._replace(key=key) for key in jax.random.split(lanes.key, 2 * _cores())]
    turn, rounds, lasted = 0, 1, deque([0.0], EXCHANGE)
    while (now := time.perf_counter()) + max(lasted) < end and not stop():
        heat = HEAT * ((end - now) / options.time_limit) ** 2
        how, mine = ((BREED, islands[::2]), (ANNEAL, islands[1::2]))[turn % 2]
        guests = [None] * (len(mine) - 1) + [seeds.pop() if seeds else None]
        work = [
            _in_thread(partial(dispatch, loading, some, how, rounds, heat, others))
            for some, others in zip(mine, guests, strict=True)
        ]
        results = [_within(end - time.perf_counter(), task) for task in work]
        done = [some for some in results if some is not None]
        if len(done) < len(work):
            return
        tried = many * (rounds * len(done) + bool(guests[-1]))
        if 2 * (time.perf_counter() - now) < BREATH:
            rounds = min(2 * rounds, ROUNDS)
        if drawn and drawn.done():
            orders, drawn = drawn.result(), None
            parts = range(0, len(orders.order), many)
            seeds = [jax.tree.map(lambda leaf: leaf[i : i + many], orders) for i in parts]  # noqa: B023
        islands[turn % 2 :: 2] = done
        turn += 1
        if turn % EXCHANGE == 0:
            islands = _exchanged(islands, turn // EXCHANGE % 2)
        lasted.append(time.perf_counter() - now)
        yield min((some.best for some in islands), key=lambda best: float(best.cost)), tried


def _first_lanes(
    loading: Loading, seed: int, many: int, end: float
) -> Generator[tuple[Best, int], None, Lanes | None]:
    """Plans until the search is compiled; returns its first lanes, None if time was up before."""
    # The first plan is made at once: it may be all that it takes.
    if best := quick_plan(loading, seed, QUICK[0], lambda: False):
        yield best, 1
    genes = first_genes(loading, np.random.default_rng(seed), many)
    lanes = fresh_lanes(jax.random.key(seed), genes)
    compiled = _in_thread(partial(dispatch, loading, lanes, AS_GIVEN, 1, 0.0))

    def unwanted() -> bool:
        return compiled.done() or time.perf_counter() > end

    for lane in QUICK[1:]:
        if best := quick_plan(loading, seed, lane, unwanted):
            yield best, 1
    first = _within(end - time.perf_counter(), compiled)
    if first is not None:
        yield first.best, many
    return first


def dispatch(
    loading: Loading,
    lanes: Lanes,
    how: int,
    rounds: int,
    heat: float,
    guests: Genes | None = None,
) -> Lanes:
    """The lanes after so many rounds, guests in the place of worse ones. See `advance`."""
    if guests:
        others = dispatch(loading, fresh_lanes(lanes.key, guests), AS_GIVEN, 1, 0.0)
        lanes = join(lanes, others)
    numbers = jnp.int32(rounds), jnp.float32(heat), jnp.int32(how)
    return jax.block_until_ready(advance(loading.rules, loading.stock, lanes, *numbers))


def _exchanged(islands: list[Lanes], first: int) -> list[Lanes]:
    """After all neighbours from the first on have exchanged their best: the last one's is first."""
    islands = islands[first:] + islands[:first]
    pairs = zip(islands[::2], islands[1::2], strict=True)
    islands = [lanes for pair in pairs for lanes in exchange(*pair)]
    return islands[-first:] + islands[:-first] if first else islands


def _decoded(loading: Loading, best: Best, left_out: tuple[int, ...]) -> Plan:
    order, turn, bin, corner = map(
        np.asarray, (best.genes.order, best.genes.turn, best.bin, best.corner)
    )
    return with_cheapest_bins(loading.job, plan_of(loading, order, turn, bin, corner, left_out))


def _in_thread(work: Callable[[], T]) -> Future[T]:
    """Begins the work.

    Nobody waits for a compilation that came too late but the interpreter, at its end: it would
    fall over one that is under way.
    """
    future: Future[T] = Future()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=run, name=THREAD).start()
    return future


def _within(seconds: float, future: Future[T]) -> T | None:
    """What comes of it, None if not in so many seconds."""
    wait((future,), max(seconds, 0))
    return future.result() if future.done() else None


def _cores() -> int:
    return max(1, min(len(os.sched_getaffinity(0)), 8)) if hasattr(os, "sched_getaffinity") else 1


def with_cheapest_bins(job: Job, plan: Plan) -> Plan:
    """The same packing with every bin exchanged for the cheapest one left that can hold it."""
    left = {number: bin.copies for number, bin in enumerate(job.bins)}
    needs = []
    for packed in plan.bins:
        ends = [
            [
                exact(at) + exact(side)
                for at, side in zip(put.corner, _extent(job, put), strict=True)
            ]
            for put in packed.placements
        ]
        reach = tuple(max(end) for end in zip(*ends, strict=True))
        needs.append((reach, math.fsum(job.items[put.item].weight for put in packed.placements)))
    chosen: dict[int, int] = {}
    # The dearest bins choose first: they have the most to save.
    for number in sorted(range(len(needs)), key=lambda n: -job.bins[plan.bins[n].bin].price):
        reach, weight = needs[number]
        able = [
            kind
            for kind, bin in enumerate(job.bins)
            if left[kind] != 0
            and weight <= bin.max_weight
            and all(end <= exact(side) for end, side in zip(reach, bin.size, strict=True))
        ]
        own = plan.bins[number].bin
        if not able:  # another one took the copy it had
            return plan
        chosen[number] = min(able, key=lambda kind: (job.bins[kind].price, kind != own))
        copies = left[chosen[number]]
        left[chosen[number]] = None if copies is None else copies - 1
    bins = tuple(replace(packed, bin=chosen[n]) for n, packed in enumerate(plan.bins))
    return replace(plan, bins=bins)


def _extent(job: Job, put: Placement) -> Sides:
    return job.items[put.item].turned(put.orientation)
