"""From tables of items and bins to a checked plan: what `jaxpack.solve` does."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

from jaxpack.errors import UserError
from jaxpack.files.jobs import job_from_columns, read_job
from jaxpack.files.plans import write_certificate, write_plan_json, write_steps
from jaxpack.files.weights import load_policy
from jaxpack.learning.recipe import Policy
from jaxpack.loading.figures import PlanFigures, cost_bound, plan_figures
from jaxpack.loading.job import Job, Plan
from jaxpack.loading.solver import Progress, SolveOptions, solve_job
from jaxpack.loading.stock import fitting_ways
from jaxpack.loading.units import FINEST, Units, in_units, units_of
from jaxpack.loading.validate import check_plan

LARGEST_SEED = 2**32 - 1


@dataclass(frozen=True)
class Solution:
    """A plan that has passed the independent check, and how good it is."""

    job: Job
    plan: Plan
    figures: PlanFigures  # bins, utilisation, weight, cost, left_out
    bound: int  # no plan that leaves out no item that fits has fewer bins
    least_cost: float  # nor costs less
    unpacked: int  # items that fit some bin, but of such bins there are too few
    rounding: float  # share by which rounding their sides up adds to the items' volume
    seconds: float
    packings: int  # that were tried
    limited_by: str  # what ended the search: "time ...", "the bound" or "an interrupt"

    @property
    def gap(self) -> float | None:
        """How far above its bound the plan is at most: 0.05 is 5 %; None if items are unpacked.

        Of the bins, or of their cost where they differ in it.
        """
        if self.unpacked:
            return None
        found = self.figures
        return relative_gap(self.job, found.bins, found.cost, self.bound, self.least_cost)

    def write_csv(self, path: str | PathLike[str]) -> None:
        """Writes the plan as PackingSolver's certificate."""
        write_certificate(Path(path), self.job, self.plan)

    def write_json(self, path: str | PathLike[str]) -> None:
        """Writes the plan and what it says of the job as JSON."""
        write_plan_json(Path(path), self.job, self.plan)

    def write_steps(self, path: str | PathLike[str]) -> None:
        """Writes the loading steps, a row per item, as CSV."""
        write_steps(Path(path), self.job, self.plan)

    def write_html(self, path: str | PathLike[str]) -> None:
        """Writes a page to look at the plan in 3D and load it step by step."""
        from jaxpack.files.viewer import write_html  # a second to import

        write_html(Path(path), self.job, self.plan)

    def write_png(self, path: str | PathLike[str]) -> None:
        """Writes a picture of the first bins."""
        from jaxpack.files.pictures import write_png  # a second to import

        write_png(Path(path), self.job, self.plan)


def solve(
    items: Any,
    bins: Any = None,
    *,
    time_limit: float = 10.0,
    seed: int = 0,
    support: float = 0.5,
    resolution: float | None = None,
    skip_unfit: bool = False,
    dimension: int | None = None,
) -> Solution:
    """Packs items into as few bins as it can find in the time, or into the cheapest.

    Args:
        items: a `Job`; or the path of a file .csv, .ins2D or .json; or a table with the columns
            of the CSV files: a data frame, a dict of columns, a structured NumPy array or a list
            of dicts.
        bins: likewise a path or a table. Not for a `Job`; .ins2D and .json need none.
        time_limit: seconds for the search, compilation included.
        seed: of the random choices.
        support: least share of an item's base that lies on what is under it, 0 to 1.
        resolution: the grid to which items are rounded up and bins down; exact if not given.
        skip_unfit: leave out items that no bin can hold; otherwise they are an error.
        dimension: 2 or 3, where the tables must be of that; their columns say it.

    Raises:
        UserError: where anything in it is wrong, in one line.
    """
    options = SolveOptions(time_limit, seed, support, resolution, skip_unfit)
    job = _job(items, bins)
    check_options(options, job)
    if dimension not in (None, job.dimension):
        raise UserError(f"dimension {dimension}: the items have the columns of {job.dimension}D")
    best = solve_job(job, options, drawing_policy(job))
    return solution(job, options, best, least_cost(job, best.bound))


def check_options(
    options: SolveOptions, job: Job, called: Callable[[str], str] = lambda name: name
) -> None:
    """Checks the range of every option.

    Args:
        options: what is checked.
        job: what it is for.
        called: what messages call an option of that name.

    Raises:
        UserError: naming the option.
    """
    unit = options.resolution
    axes = (0, 2) if job.dimension == 2 else (0, 1, 2)
    sides = [kind.size[axis] for kind in job.bins for axis in axes]
    finest = f"{max(sides) / FINEST:.3g}"
    allowed = {
        "time_limit": (0 < options.time_limit < math.inf, "give seconds, more than 0"),
        "seed": (0 <= options.seed <= LARGEST_SEED, f"give 0 to {LARGEST_SEED}"),
        "support": (0 <= options.support <= 1, "give a share of the base, 0 to 1"),
        "resolution": (
            unit is None or float(finest) <= unit <= min(sides),
            f"give {finest} to {min(sides):g}, a bin's shortest side",
        ),
    }
    for name, (fine, advice) in allowed.items():
        if not fine:
            raise UserError(f"{called(name)} {getattr(options, name)}: {advice}")


def drawing_policy(job: Job) -> Policy:
    """The shipped policy that draws orders and orientations for jobs of this dimension."""
    return load_policy(f"bin-aware-{job.dimension}d-turned")


def solution(job: Job, options: SolveOptions, found: Progress, least_cost: float) -> Solution:
    """What the search found, checked once more.

    Raises:
        InvalidPlanError: never, unless this program is wrong.
    """
    units = units_of(job, options.resolution)
    slack = 0.0 if units.exact else float(units.length)
    check_plan(job, found.plan, options.support, True, slack)
    return Solution(
        job=job,
        plan=found.plan,
        figures=plan_figures(job, found.plan),
        bound=found.bound,
        least_cost=least_cost,
        unpacked=_unpacked(job, found.plan, units),
        rounding=_rounding(job, units),
        seconds=found.seconds,
        packings=found.packings,
        limited_by=found.limited_by,
    )


def least_cost(job: Job, bound: int) -> float:
    """A cost below that of every plan that has `bound` bins or more."""
    alike = _one_price(job)
    return bound * job.bins[0].price if alike else cost_bound(job)  # which takes a while


def relative_gap(job: Job, bins: int, cost: float, bound: int, least_cost: float) -> float:
    """What the bins, or their cost where they differ in it, are above the bound, as a share."""
    if _one_price(job):
        return bins / max(bound, 1) - 1
    if least_cost:
        return cost / least_cost - 1
    return math.inf if cost else 0.0


def _one_price(job: Job) -> bool:
    return len({kind.price for kind in job.bins}) == 1


def _unpacked(job: Job, plan: Plan, units: Units) -> int:
    """How many of the items that are left out fit some bin."""
    left = tuple(job.items[item] for item in plan.left_out)
    if not left:
        return 0
    return sum(1 for ways in fitting_ways(replace(job, items=left), units) if ways)


def _job(items: Any, bins: Any) -> Job:
    if isinstance(items, Job):
        if bins is not None:
            raise UserError("bins: a job has its bins already; give none beside it")
        return items
    paths = str | PathLike
    if not isinstance(items, paths):
        if bins is None or isinstance(bins, paths):
            raise UserError("bins: give a table of them, as the items are one")
        return job_from_columns(items, bins)
    if bins is not None and not isinstance(bins, paths):
        raise UserError("bins: give the path of a file, as the items are in one")
    jobs = read_job(Path(items), None if bins is None else Path(bins))
    if len(jobs) > 1:
        what = f"{items}: {len(jobs)} orders, one is solved at a time"
        raise UserError(f"{what}: give one of read_job('{items}')")
    return jobs[0]


def _rounding(job: Job, units: Units) -> float:
    """The share by which rounding up adds to the items' volume."""
    if units.exact:
        return 0.0
    axes = (0, 2) if job.dimension == 2 else (0, 1, 2)
    before = after = 0.0
    for item in job.items:
        sides = [item.size[axis] for axis in axes]
        rounded = in_units(sides, units.length, up=True).astype(float) * float(units.length)
        before += item.copies * math.prod(sides)
        after += item.copies * float(rounded.prod())
    return after / before - 1
