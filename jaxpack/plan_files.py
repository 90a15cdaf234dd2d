"""What commands that read a plan share: the options that name it, and how it is read."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import FlagCreatePairsOff, Positional, UseAppendAction

from jaxpack.errors import UserError
from jaxpack.io.atomic import check_writable
from jaxpack.io.certificates import read_certificate
from jaxpack.io.notes import Say
from jaxpack.io.packing_plans import is_packing_plans, read_packing_plans
from jaxpack.io.plans import plan_objective, read_plan_json, with_plan_obstacles
from jaxpack.model.job import MOST_ITEMS, Job, Plan
from jaxpack.orders import read_orders
from jaxpack.rule_flags import ObstaclesFile

SUFFIXES = (".csv", ".json")


@dataclass(frozen=True)
class PlanFiles(ObstaclesFile):
    """Options of commands."""

    plan: Positional[Path]
    """The plan: .json as `solve` writes it or as BED-BPP has it, or PackingSolver's certificate,
    .csv."""
    items: Positional[Path]
    """The items: .csv, .ins2D, or the orders of BED-BPP, .json."""
    bins: Positional[Path | None] = None
    """The bins, .csv. Files .ins2D and .json have bins of their own, which these replace."""
    objective: str = ""
    """What the plan is for: see `solve`. Not given, what the plan says, if it does."""
    order: str | None = None
    """Of several orders the one that the plan is of. BED-BPP's packing plans are of all of them."""
    ignore: UseAppendAction[tuple[str, ...]] = ()
    """A column of the files that need not be obeyed; may be given several times."""
    packingsolver: FlagCreatePairsOff[bool] = False
    """Read CSV files exactly as PackingSolver does, where that differs."""


def read_plans(options: PlanFiles, tell: Say) -> list[tuple[Job, Plan]]:
    """The plan with its job, or of BED-BPP's packing plans all of them.

    Raises:
        UserError: naming the file and what is wrong in it.
    """
    kind = options.plan.suffix.lower()
    if kind not in SUFFIXES:
        raise UserError(f"{options.plan}: plans '{kind}' are not known: give .csv or .json")
    jobs = read_orders(
        options.items,
        options.bins,
        options.order,
        options.ignore,
        options.packingsolver,
        options.objective or (plan_objective(options.plan) if kind == ".json" else ""),
        tell,
        obstacles=options.obstacles,
    )
    if kind == ".json" and is_packing_plans(options.plan):
        plans = read_packing_plans(options.plan, jobs)
    elif len(jobs) > 1:
        what = f"{options.items}: {len(jobs)} orders, and a plan of one"
        raise UserError(f"{what}: say which with --order")
    else:
        job, read = jobs[0], read_certificate if kind == ".csv" else read_plan_json
        if kind == ".json" and options.obstacles is None:
            job = with_plan_obstacles(options.plan, job)
            if any(one.limits.obstacles for one in job.bins):
                tell(f"{options.plan}: its bins have the obstacles that it says they have")
        plans = [(job, read(options.plan, job))]
    for _, plan in plans:
        loaded = sum(len(packed.placements) for packed in plan.bins)
        if loaded > MOST_ITEMS:
            what = f"{loaded:,} items, a job has at most {MOST_ITEMS:,}"
            raise UserError(f"{options.plan}: {what}: is it of another job?")
    return plans


def check_output(option: str, path: Path, files: PlanFiles) -> None:
    """Raises UserError where a file cannot be written, or would take the place of one that is read.

    Args:
        option: that names it.
        path: of it.
        files: those that are read.
    """
    try:
        check_writable(path)
    except UserError as error:
        raise UserError(f"{option} {error}") from None
    read = files.plan, files.items, files.bins, files.obstacles
    if path.resolve() in {p.resolve() for p in read if p}:
        raise UserError(f"{option} {path}: it is read; name another")
