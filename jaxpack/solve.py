"""`python -m jaxpack.solve`: a list of items and bins in, a checked loading plan out."""

import math
import re
import sys
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType

from rich.console import Console
from rich.live import Live
from tyro.conf import FlagCreatePairsOff, Positional

from jaxpack.cli import parse_options, run_door
from jaxpack.errors import UserError
from jaxpack.flags import HowToPack, interrupts
from jaxpack.io.arrow import arrow, write_columns
from jaxpack.io.atomic import check_writable
from jaxpack.io.bed_bpp import write_bed_bpp
from jaxpack.io.certificates import check_scale
from jaxpack.io.notes import Say
from jaxpack.many import tables_of, timed
from jaxpack.model.job import Job
from jaxpack.model.numbers import as_whole
from jaxpack.model.plan_check import InvalidPlanError
from jaxpack.orders import read_orders
from jaxpack.plan_tables import (
    NAMED,
    Screen,
    live_figures,
    plain_text,
    print_solutions,
    say,
)
from jaxpack.rule_flags import flag
from jaxpack.search.online_orders import pack_online
from jaxpack.search.portfolio import SolveOptions, solve_job
from jaxpack.search.record import Progress
from jaxpack.solution import Solution, Status, checked_options, solution, solve
from jaxpack.waves import pack_all, say_results

TICK = 0.1  # seconds between two states of the live line

SUFFIXES = {
    "out": (".csv", ".json"),
    "steps": (".csv",),
    "html": (".html", ".htm"),
    "png": (".png",),
    "bed_bpp": (".json",),
    "placements": (".csv", ".parquet"),
    "figures": (".csv", ".parquet"),
}
"""Option -> what its file may end with."""
OF_ALL = ("bed_bpp", "placements", "figures")
"""Of these there is one file for all orders."""


@dataclass(frozen=True)
class CommandOptions(HowToPack):
    """Pack items into as few bins as can be found in the time, or into the cheapest."""

    items: Positional[Path]
    """The items: .csv, .xlsx, .parquet, .ins2D, or the orders of BED-BPP, .json. Of a table with a
    column ORDER every order is packed by itself."""
    bins: Positional[Path | None] = None
    """The bins, .csv. Files .ins2D and .json have bins of their own, which these replace."""
    out: Path | None = None
    """Write the plan: .csv (PackingSolver's certificate) or .json. Several orders get a file each,
    here and below: PLAN-ORDER.csv."""
    steps: Path | None = None
    """Write the loading steps, a row per item: .csv."""
    html: Path | None = None
    """Write a page that shows the plan in 3D and step by step: .html."""
    png: Path | None = None
    """Write a picture of the plan: .png."""
    bed_bpp: Path | None = None
    """Write the plans of all orders as BED-BPP has them, each for its one target: .json. Of items
    that are BED-BPP's, .json."""
    placements: Path | None = None
    """Write one table with a row per item of all orders: .csv or .parquet."""
    figures: Path | None = None
    """Write one table with a row per order: .csv or .parquet."""
    devices: int | None = None
    """JAX's devices, so many of which pack several orders instead: for GPUs."""
    order: str | None = None
    """Solve only the order of that name."""
    online: FlagCreatePairsOff[bool] = False
    """Items come one by one, in the order of the file, copies in a row: print where each goes as it
    comes, into as many bins as it takes. Nothing is searched for."""
    packingsolver: FlagCreatePairsOff[bool] = False
    """Read CSV files exactly as PackingSolver does, where that differs."""


def plan_files(options: CommandOptions, jobs: Sequence[Job]) -> list[dict[str, Path]]:
    """Which files to write of every job, by option; the one for all of them is not among them.

    Raises:
        UserError: naming an option whose file cannot be written, or would take another's place.
    """
    claims: list[tuple[str, Path]] = []
    files: list[dict[str, Path]] = [{} for _ in jobs]
    for option, suffixes in SUFFIXES.items():
        path: Path | None = getattr(options, option)
        if path is None:
            continue
        if path.suffix.lower() not in suffixes:
            raise UserError(f"{flag(option)} {path}: end it with {' or '.join(suffixes)}")
        if option == "bed_bpp" and options.items.suffix.lower() != ".json":
            raise UserError(f"--bed-bpp {path}: {options.items} is no file of BED-BPP orders")
        if option in OF_ALL:
            if path.suffix.lower() == ".parquet":
                arrow()
            claims.append((option, path))
            continue
        for job, own in zip(jobs, files, strict=True):
            own[option] = path if len(jobs) == 1 else _of_order(path, job)
            if option == "out" and path.suffix.lower() == ".csv":
                check_scale(own[option], job)
            claims.append((option, own[option]))
    taken = {
        path.resolve(): "the job is read from it"
        for path in (options.items, options.bins, options.obstacles)
        if path
    }
    for option, path in claims:
        try:
            check_writable(path)
        except UserError as error:
            raise UserError(f"{flag(option)} {error}") from None
        if (reason := taken.get(path.resolve())) is not None:
            raise UserError(f"{flag(option)} {path}: {reason}; name another")
        taken[path.resolve()] = f"{flag(option)} is written to it"
    return files


def _of_order(path: Path, job: Job) -> Path:
    order = re.sub(r"[^\w.-]", "_", job.name)  # nothing in it leads to another folder
    return path.with_name(f"{path.stem}-{order}{path.suffix}")


def search(
    job: Job, options: SolveOptions, interrupted: Sequence[int], console: Console
) -> Solution:
    """The best plan, with a live line until then."""
    begun, figures, drawn = time.perf_counter(), "no plan yet", 0.0
    live = Live(console=console, auto_refresh=False, transient=True)

    def stop() -> bool:
        nonlocal drawn
        now = time.perf_counter()
        if live.is_started and now - drawn > TICK:
            drawn, left = now, max(0.0, options.seconds - (now - begun))
            clock = f"{left:.0f} s left" if left < math.inf else f"{now - begun:.0f} s"
            live.update(plain_text(f"{figures}, {clock}"), refresh=True)
        return bool(interrupted)

    def progress(better: Progress) -> None:
        nonlocal figures
        if figures != (figures := live_figures(better)) and not live.is_started:
            say(console, f"{better.seconds:.1f} s: {figures}")

    with live if console.is_terminal else nullcontext():
        return solution(job, solve_job(job, options, stop, progress), options.rules)


def write_files(found: Solution, files: dict[str, Path], tell: Say) -> None:
    """Writes a plan in every form that is asked for, the pictures, which take longest, last."""
    for option, path in files.items():
        if option == "out":
            json = path.suffix.lower() == ".json"
            found.write_json(path) if json else found.write_csv(path, tell)
        else:
            getattr(found, f"write_{option}")(path)


def solve_one(
    job: Job,
    how: SolveOptions,
    source: Path,
    interrupted: Sequence[int],
    status: Screen,
) -> dict[str, Solution | str | None]:
    """The solution of the one order there is, by its name.

    Raises:
        UserError: where it cannot be packed.
    """
    try:
        return {job.name: search(job, how, interrupted, status)}
    except UserError as error:
        raise UserError(f"{source}: {error}") from None


def solve_online(
    job: Job, how: SolveOptions, source: Path, interrupted: Sequence[int], console: Console
) -> dict[str, Solution | str | None]:
    """The solution of the one order there is, by its name, its items packed as they come.

    Raises:
        UserError: where it cannot be packed.
    """

    def told(item: int, orientation: str, number: int, corner: tuple[float, ...]) -> None:
        name = job.items[item].name or f"item {item}"
        place = ", ".join(f"{corner[axis]:g}" for axis in job.axes)
        where = f"bin {number}, {orientation} at {place}" if number >= 0 else "left out"
        console.print(plain_text(f"{name}: {where}"), soft_wrap=True)

    if how.time_limit is not None or how.packings is not None:
        raise UserError("--online: nothing is searched for; leave out --time-limit and --packings")
    try:
        found = pack_online(job, how, told, lambda: bool(interrupted))
    except UserError as error:
        raise UserError(f"{source}: {error}") from None
    return {job.name: solution(job, found, how.rules)}


def write_all(
    options: CommandOptions,
    found: dict[str, Solution | str | None],
    files: dict[str, dict[str, Path]],
    tell: Say,
) -> None:
    """Writes what is asked for of every order, and the tables of all of them."""
    solutions = {name: one for name, one in found.items() if isinstance(one, Solution)}
    for name, one in solutions.items():
        write_files(one, files[name], tell)
    if options.bed_bpp and solutions:
        orders = [one.job for one in solutions.values()]
        write_bed_bpp(options.bed_bpp, orders, [one.plan for one in solutions.values()], tell)
    for path, table in zip(
        (options.placements, options.figures), tables_of([*found.items()]), strict=True
    ):
        if path:
            write_columns(path, table)
    written = [path for name in solutions for path in files[name].values()]
    written += [path for option in OF_ALL if (path := getattr(options, option))]
    if written:
        more = f" and {len(written) - NAMED} more" if len(written) > NAMED else ""
        tell(f"written: {', '.join(map(str, written[:NAMED]))}{more}")


def main(argv: Sequence[str]) -> None:
    """Parses, packs, writes, prints."""
    options = parse_options(CommandOptions, "solve", argv)
    console, status = Screen(), Screen(stderr=True)
    tell = partial(say, status)
    wrong: dict[str, UserError] = {}
    jobs = read_orders(
        options.items,
        options.bins,
        options.order,
        options.ignore,
        options.packingsolver,
        options.objective,
        tell,
        wrong.__setitem__,
        options.obstacles,
    )
    how = options.how
    for job in jobs[:1] if how.resolution is None else jobs:
        how = checked_options(how, job, flag)
    if options.devices is not None:
        as_whole(options.devices, "--devices", 1)
    several = len(jobs) + len(wrong) > 1
    files = dict(zip([job.name for job in jobs], plan_files(options, jobs), strict=True))
    if options.online and several:
        what = f"{options.items}: {len(jobs) + len(wrong)} orders"
        raise UserError(f"{what}: --online packs one; name it with --order")
    with interrupts() as interrupted:
        try:
            if options.online:
                found = solve_online(jobs[0], how, options.items, interrupted, console)
            elif several:
                how = timed(how, len(jobs))
                packed = pack_all(jobs, how, options.workers, options.devices, interrupted, status)
                found = dict(zip(files, packed, strict=True))
            else:
                found = solve_one(jobs[0], how, options.items, interrupted, status)
        except InvalidPlanError as error:  # a fault of this program
            what = f"{options.items}: no valid plan, nothing is written: {error}"
            raise SystemExit(f"error: {what}") from None
        found |= {name: str(error) for name, error in wrong.items()}
        write_all(options, found, files, tell)
        say_results(found, options.items, several, status)
        solutions = [one for one in found.values() if isinstance(one, Solution)]
        if solutions:
            print_solutions(console, solutions, several)
    complete = len(solutions) == len(found)
    complete = complete and all(one.status is not Status.INFEASIBLE for one in solutions)
    code = 0 if complete else 2
    if interrupted:
        code = 128 + interrupted[0]
        what = "this is the best plan so far"
        if several:
            what = f"{len(solutions)} of {len(found)} orders are packed"
        say(status, f"interrupted: {what}")
    sys.exit(code)


class _Callable(ModuleType):
    """`jaxpack.solve` is a function until this module is imported, and can be called after it."""

    __call__ = staticmethod(solve)


if __name__ == "__main__":
    run_door(main, computes=False)
else:
    sys.modules[__name__].__class__ = _Callable
