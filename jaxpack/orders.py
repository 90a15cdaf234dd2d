"""What `solve` and `check` share: the orders that a command names, read as its options say."""

from collections.abc import Sequence
from pathlib import Path

from jaxpack.errors import UserError
from jaxpack.io.jobs import read_job
from jaxpack.io.notes import Say
from jaxpack.model.job import Job
from jaxpack.plan_tables import NAMED


def read_orders(
    items: Path,
    bins: Path | None,
    order: str | None,
    ignore: Sequence[str],
    packingsolver: bool,
    objective: str,
    say: Say,
) -> list[Job]:
    """All jobs of a file, or the one of that name.

    Args:
        items, bins, ignore, packingsolver, objective: see `read_job`.
        order: a name, or None for all.
        say: takes a line for everything that was assumed, once all has been read.

    Raises:
        UserError: naming what is wrong in a file, or the orders that there are.
    """
    notes: list[str] = []
    jobs = read_job(
        items,
        bins,
        ignore=ignore,
        packingsolver=packingsolver,
        objective=objective,
        say=notes.append,
    )
    for note in notes:
        say(note)
    if order is None:
        return jobs
    named = [job for job in jobs if job.name == order]
    if not named:
        there = ", ".join(job.name for job in jobs[:NAMED])
        more = f" and {len(jobs) - NAMED} more" if len(jobs) > NAMED else ""
        raise UserError(f"--order '{order}': {items} has {there}{more}")
    return named
