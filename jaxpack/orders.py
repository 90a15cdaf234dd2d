"""What commands share: the orders that they name, read as their options say."""

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxpack.errors import UserError
from jaxpack.io.jobs import Bad, read_job
from jaxpack.io.notes import Say
from jaxpack.model.job import Job
from jaxpack.plan_tables import NAMED

if TYPE_CHECKING:
    from jaxpack.model.orders import Orders


def read_orders(
    items: Path,
    bins: Path | None,
    order: str | None,
    ignore: Sequence[str],
    packingsolver: bool,
    objective: str,
    say: Say,
    bad: Bad | None = None,
    obstacles: Path | None = None,
) -> list[Job]:
    """All jobs of a file, or the one of that name.

    Args:
        items, bins, ignore, packingsolver, objective, obstacles: see `read_job`.
        order: a name, or None for all.
        say: takes a line for everything that was assumed, once all has been read.
        bad: takes the name of an order that cannot be read, and why; it is raised if not given, as
            it is where there is no other order.

    Raises:
        UserError: naming what is wrong in a file, or the orders that there are.
    """
    notes: list[str] = []
    wrong: dict[str, UserError] = {}
    jobs = read_job(
        items,
        bins,
        obstacles=obstacles,
        ignore=ignore,
        packingsolver=packingsolver,
        objective=objective,
        by_order=True,
        bad=wrong.setdefault,
        say=notes.append,
    )
    for name, error in wrong.items():
        if bad is None or not jobs:
            raise error
        if order in (None, name):
            bad(name, error)
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


def order_instances(options: Any) -> "Orders | None":
    """The orders of --orders as instances; None without.

    Args:
        options: of `evaluate` or `train`.

    Raises:
        UserError: naming what is wrong in a file, or an option that goes with it alone, or not.
    """
    alone = [
        name for name in ("bins", "bin_type", "ignore", "skip_unfit") if getattr(options, name)
    ]
    if options.orders is None:
        if alone:
            raise UserError(f"--{alone[0].replace('_', '-')}: goes with --orders only")
        return None
    for name in ("items", "bin", "sides"):
        if getattr(options, name) is not None:
            raise UserError(f"--{name}: does not go with --orders, which have their own")
    from jaxpack.io import order_files  # JAX, which the other commands can do without
    from jaxpack.model.orders import OrderFiles

    bins = None if options.bins is None else str(options.bins.absolute())
    files = OrderFiles(
        str(options.orders.absolute()),
        bins,
        options.bin_type,
        tuple(options.ignore),
        options.skip_unfit,
    )
    return order_files.read_orders(files, say=partial(print, file=sys.stderr))
