"""From tables of items and bins to a checked plan: what `jaxpack.solve` does."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from jaxpack.errors import UserError
from jaxpack.io.certificates import write_certificate
from jaxpack.io.jobs import job_from_columns, read_job
from jaxpack.io.notes import Say, silent
from jaxpack.io.plans import write_plan_json
from jaxpack.io.steps import write_steps
from jaxpack.model.bounds import Bounds
from jaxpack.model.encoding import fitting_ways
from jaxpack.model.figures import PlanFigures, levelled, plan_figures, plan_profit
from jaxpack.model.job import Job, Plan
from jaxpack.model.numbers import as_number, as_whole
from jaxpack.model.objectives import gap, objective_of
from jaxpack.model.rules import Rules
from jaxpack.model.units import fine_enough
from jaxpack.packing.rules import rule_named
from jaxpack.search.portfolio import SolveOptions, solve_job
from jaxpack.search.record import End, Progress

LARGEST_SEED = 2**32 - 1

SENTENCES = {
    End.BOUND: "the bound: no plan can be better",
    End.TIME: "time",
    End.UNREADY: "time, before the search was compiled, which goes on when this program has ended",
    End.BUDGET: "the number of packings",
    End.LOST: "a process of the search that ended too soon, perhaps for want of memory",
    End.INTERRUPT: "an interrupt",
    End.ONLINE: "items that came one by one",
}


class Status(Enum):
    """What is known of a plan."""

    OPTIMAL = auto()  # no plan is better
    FEASIBLE = auto()  # time or packings were used up
    INTERRUPTED = auto()
    INFEASIBLE = auto()  # it leaves out items that should be packed: bins are too few


@dataclass(frozen=True)
class Solution:
    """A plan that has passed the independent check, and how good it is."""

    job: Job  # what was packed
    plan: Plan  # bins, and the placements in each in loading order
    figures: PlanFigures  # bins, utilisation, weight, cost, left_out
    bounds: Bounds  # what no plan can do without
    seconds: float  # from the start of the search to its end
    packings: int  # that were tried
    end: End  # what ended the search
    notes: tuple[str, ...] = ()  # what was assumed of the tables, a line each
    rules: Rules = Rules()  # by which it was packed

    @property
    def bound(self) -> int:
        """No plan that leaves out no item that fits has fewer bins."""
        return self.bounds.bins

    @property
    def least_cost(self) -> float:
        """Nor costs less."""
        return self.bounds.cost

    @property
    def gap(self) -> float | None:
        """How far from its bound the plan is at most: 0.05 is 5 %; None if items are unpacked.

        Of the objective's measure: cost or number of the bins, value.
        """
        return gap(self.job, self.plan, self.bounds)

    @property
    def unpacked(self) -> int:
        """How many items fit some bin and are left out though they should not be."""
        may = objective_of(self.job).leaves_out
        return 0 if may else self.figures.left_out - self.bounds.unfit

    @property
    def lacking(self) -> str:
        """Why, and what to do."""
        if objective_of(self.job).open_bin:
            return "there is one bin; give a larger one"
        endless = tuple(kind for kind in self.job.bins if kind.copies is None)
        ways = fitting_ways(replace(self.job, bins=endless), self.rules) if endless else ()
        if endless and any(ways[item] for item in self.plan.left_out):
            return "no place was found by all the rules; ask less, or give larger bins"
        return "there are too few bins; give more, or a larger COPIES"

    @property
    def value(self) -> float:
        """What all packed items are worth: their profits, of those without one the volume."""
        return float(plan_profit(self.job, self.plan))

    @property
    def height(self) -> float:
        """How high the highest of the bins is: up to the items that are highest for the objective
        height, otherwise that of the bin type.
        """
        return max((self.job.room(packed)[2] for packed in self.plan.bins), default=0.0)

    @cached_property
    def _levelled(self) -> Job:
        return levelled(self.job, self.plan)

    @property
    def status(self) -> Status:
        """What is known of the plan."""
        if self.unpacked or not self.plan.bins:
            return Status.INFEASIBLE
        known = {End.BOUND: Status.OPTIMAL, End.INTERRUPT: Status.INTERRUPTED}
        return known.get(self.end, Status.FEASIBLE)

    @property
    def limited_by(self) -> str:
        """What ended the search, in words."""
        return SENTENCES[self.end]

    def write_csv(self, path: str | PathLike[str], say: Say = silent) -> None:
        """Writes the plan as PackingSolver's certificate; `say` takes what there is to note."""
        write_certificate(Path(path), self._levelled, self.plan, say)

    def write_json(self, path: str | PathLike[str]) -> None:
        """Writes the plan and what it says of the job as JSON."""
        write_plan_json(Path(path), self._levelled, self.plan, self.rules)

    def write_steps(self, path: str | PathLike[str]) -> None:
        """Writes the loading steps, a row per item, as CSV."""
        write_steps(Path(path), self.job, self.plan)

    def write_html(self, path: str | PathLike[str]) -> None:
        """Writes a page to look at the plan in 3D and load it step by step."""
        from jaxpack.io.viewer import write_html  # a second to import

        write_html(Path(path), self._levelled, self.plan)

    def write_png(self, path: str | PathLike[str]) -> None:
        """Writes a picture of the first bins."""
        from jaxpack.io.pictures import write_png  # a second to import

        write_png(Path(path), self._levelled, self.plan)


def solve(
    items: Any,
    bins: Any = None,
    *,
    obstacles: Any = None,
    time_limit: float | None = None,
    seed: int = 0,
    resolution: float | None = None,
    skip_unfit: bool = False,
    dimension: int | None = None,
    ignore: str | Sequence[str] = (),
    objective: str = "",
    packings: int | None = None,
    progress: Callable[[Progress], object] = lambda better: None,
    **rules: Any,
) -> Solution:
    """Packs items as well as it can find in the time: into the fewest bins, or the cheapest.

    With costs of bins the least cost comes first, then the fewest bins, then the least volume;
    without costs the fewest bins. What fits is left out only where there are too few bins.

    Args:
        items: a `Job`; or the path of a file; or a table with the columns of the CSV files: a data
            frame, a dict of columns, a structured NumPy array or a list of dicts.
        bins: likewise a path or a table. Not for a `Job`; .ins2D and .json need none.
        obstacles: what is taken in the bins, likewise: see `jaxpack.io.obstacles`.
        time_limit: seconds for the search, compilation included. Not given, they are 10, or as
            many as the packings take.
        seed: of the random choices.
        resolution: corners stand along x and y on a grid of this length; anywhere if not given.
        skip_unfit: leave out items that no bin can hold; otherwise they are an error.
        dimension: 2 or 3, where the tables must be of that; their columns say it.
        ignore: columns of the tables that need not be obeyed.
        objective: another one than the above, a key of `OBJECTIVES`: bins or price whatever the
            costs; value, the greatest value of what is packed (column PROFIT of the items, their
            volume without it), where bins without COPIES are one and items may be left out; height,
            the least of all in one bin, whose height may be open (Z, in 2D HEIGHT: empty or -1).
        packings: that the search tries at most. With the same seed and number the plan is the
            same on one machine, however busy that is.
        progress: called with every better `Progress`: its plan, measure, bound and gap, seconds and
            packings so far. If it returns something true, the search ends as by an interrupt.
        rules: fields of `Rules`, such as support=0.8: what carries an item, where it may stand.

    Returns:
        The best plan found, checked, in the units of the tables.

    Raises:
        UserError: where anything in it is wrong, in one line.
    """
    notes: list[str] = []
    job = _job(items, bins, obstacles, ignore, objective, notes.append)
    how = time_limit, seed, Rules(**rules), resolution, skip_unfit
    options = checked_options(SolveOptions(*how, packings=packings), job)
    if dimension not in (None, job.dimension):
        raise UserError(f"dimension {dimension}: the items have the columns of {job.dimension}D")
    found = solve_job(job, options, progress=progress)
    return replace(solution(job, found, options.rules), notes=tuple(notes))


def checked_options(
    options: SolveOptions, job: Job, called: Callable[[str], str] = lambda name: name
) -> SolveOptions:
    """The options, if every one is of its type and in its range.

    Args:
        options: what is checked.
        job: what it is for.
        called: what messages call an option of that name.

    Raises:
        UserError: naming the option.
    """
    rule_named(options.rules.rule, called("rule"))
    if not isinstance(options.skip_unfit, bool | np.bool_):
        raise UserError(f"{called('skip_unfit')} {options.skip_unfit!r}: give True or False")
    limit, most = options.time_limit, options.packings
    limit = None if limit is None else as_number(limit, called("time_limit"))
    most = None if most is None else as_whole(most, called("packings"), 1)
    seed = as_whole(options.seed, called("seed"), 0, LARGEST_SEED)
    rules = options.rules.checked(called, job.dimension)
    job = objective_of(job).prepared(job, rules)
    for name in ("gap", "overhang"):
        if (length := getattr(rules, name)) and not fine_enough(job, length):
            what = "too many digits beside those of the sizes: give a rounder length"
            raise UserError(f"{called(name)} {length:g}: {what}")
    unit = options.resolution
    if limit is not None and limit <= 0:
        raise UserError(f"{called('time_limit')} {limit:g}: give seconds, more than 0")
    if unit is not None:
        unit = as_number(unit, called("resolution"))
        shortest = min(kind.size[axis] for kind in job.bins for axis in job.axes)
        if not 0 < unit <= shortest:
            what = f"give more than 0, at most {shortest:g}, a bin's shortest side"
            raise UserError(f"{called('resolution')} {unit:g}: {what}")
        if not fine_enough(job, unit, *filter(None, (rules.gap, rules.overhang))):
            what = "too many digits beside those of the sizes: give a rounder length"
            raise UserError(f"{called('resolution')} {unit:g}: {what}")
    return replace(
        options, time_limit=limit, seed=seed, rules=rules, resolution=unit, packings=most
    )


def solution(job: Job, found: Progress, rules: Rules) -> Solution:
    """What a search has ended with, in figures."""
    assert found.end is not None, "it goes on"
    return Solution(
        job=job,
        plan=found.plan,
        figures=plan_figures(levelled(job, found.plan), found.plan),
        bounds=found.bounds,
        seconds=found.seconds,
        packings=found.packings,
        end=found.end,
        rules=rules,
    )


def _job(
    items: Any,
    bins: Any,
    obstacles: Any,
    ignore: str | Sequence[str],
    objective: str,
    say: Say,
) -> Job:
    if isinstance(items, Job):
        if bins is not None or obstacles is not None:
            what = "bins" if obstacles is None else "obstacles"
            raise UserError(f"{what}: a job has its {what} already; give none beside it")
        return replace(items, objective=objective) if objective else items
    paths = str | PathLike
    how: dict[str, Any] = {"ignore": ignore, "objective": objective, "say": say}
    if not isinstance(items, paths):
        for what, given in (("bins", bins), ("obstacles", obstacles)):
            if isinstance(given, paths) or (given is None and what == "bins"):
                raise UserError(f"{what}: give a table of them, as the items are one")
        return job_from_columns(items, bins, obstacles=obstacles, **how)
    for what, given in (("bins", bins), ("obstacles", obstacles)):
        if given is not None and not isinstance(given, paths):
            raise UserError(f"{what}: give the path of a file, as the items are in one")
    jobs = read_job(items, bins, obstacles=obstacles, **how)
    if len(jobs) > 1:
        what = f"{items}: {len(jobs)} orders, one is solved at a time"
        raise UserError(f"{what}: give one of read_job('{items}')")
    return jobs[0]
