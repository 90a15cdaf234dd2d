"""`python -m jaxpack.check`: is a plan, of whomever, possible? Its violations, or one line."""

import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tyro.conf import FlagCreatePairsOff, Positional, UseAppendAction

from jaxpack.cli import parse_options, run_door
from jaxpack.errors import UserError
from jaxpack.io.atomic import check_writable
from jaxpack.io.certificates import read_certificate
from jaxpack.io.notes import Say
from jaxpack.io.packing_plans import is_packing_plans, read_packing_plans
from jaxpack.io.plans import plan_objective, read_plan_json
from jaxpack.io.tables import write_table
from jaxpack.io.texts import json_line, json_lines, write_text
from jaxpack.model.job import MOST_ITEMS, Job, Plan
from jaxpack.model.objectives import objective_of
from jaxpack.model.plan_check import plan_violations
from jaxpack.model.violations import Violation, sentence
from jaxpack.orders import read_orders
from jaxpack.plan_tables import Screen, counted, say
from jaxpack.rule_flags import RuleFlags, flag

SHOWN = 20  # violations on the terminal
SUFFIXES = (".csv", ".json")


@dataclass(frozen=True)
class CommandOptions(RuleFlags):
    """Check a loading plan: exit code 0 if it is valid, 1 if it breaks a rule."""

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
    out: Path | None = None
    """Write the violations, a record for each: .csv or .json."""


@dataclass(frozen=True)
class Verdict:
    """What the check says of one plan."""

    job: Job
    plan: Plan
    violations: tuple[Violation, ...]

    def line(self) -> str:
        """What a valid plan amounts to."""
        job, plan = self.job, self.plan
        loaded = [put.item for packed in plan.bins for put in packed.placements]
        room = sum(math.prod(job.room(packed)) for packed in plan.bins)
        parts = [counted(len(plan.bins), "bin"), counted(len(loaded), "item")]
        if room:
            share = sum(math.prod(job.items[item].size) for item in loaded) / room
            parts.append(f"fill {share * 100:.1f} %")
        if figure := objective_of(job).figure:
            parts.append(f"{figure} {objective_of(job).measure(job, plan):,.10g}")
        if plan.left_out:
            parts.append(f"{counted(len(plan.left_out), 'item')} left out")
        return f"valid: {', '.join(parts)}"


def read_plans(options: CommandOptions, tell: Say) -> list[tuple[Job, Plan]]:
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
    )
    if kind == ".json" and is_packing_plans(options.plan):
        plans = read_packing_plans(options.plan, jobs)
    elif len(jobs) > 1:
        what = f"{options.items}: {len(jobs)} orders, and a plan of one"
        raise UserError(f"{what}: say which with --order")
    else:
        read = read_certificate if kind == ".csv" else read_plan_json
        plans = [(jobs[0], read(options.plan, jobs[0]))]
    for _, plan in plans:
        loaded = sum(len(packed.placements) for packed in plan.bins)
        if loaded > MOST_ITEMS:
            what = f"{loaded:,} items, a job has at most {MOST_ITEMS:,}"
            raise UserError(f"{options.plan}: {what}: is it of another job?")
    return plans


def check_output(options: CommandOptions) -> None:
    """Raises UserError where the records cannot be written, or would take a file's place."""
    path = options.out
    if path is None:
        return
    if path.suffix.lower() not in SUFFIXES:
        raise UserError(f"--out {path}: end it with {' or '.join(SUFFIXES)}")
    try:
        check_writable(path)
    except UserError as error:
        raise UserError(f"--out {error}") from None
    if path.resolve() in {p.resolve() for p in (options.plan, options.items, options.bins) if p}:
        raise UserError(f"--out {path}: it is read; name another")


def write_records(path: Path, verdicts: Iterable[Verdict]) -> None:
    """Writes a record per violation: its order, its fields and the sentence.

    Raises:
        UserError: the file cannot be written.
    """
    records = [
        {"order": verdict.job.name, **one._asdict(), "sentence": sentence(one)}
        for verdict in verdicts
        for one in verdict.violations
    ]
    if path.suffix.lower() == ".json":
        write_text(path, f"{json_lines(map(json_line, records), ' ')}\n")
        return
    header = ("order", *Violation._fields, "sentence")
    write_table(path, [[name.upper() for name in header], *(list(r.values()) for r in records)])


def _lines(verdicts: Sequence[Verdict]) -> Iterator[str]:
    """What is said of each, with the order's name where there are several."""
    for verdict in verdicts:
        order = f"{verdict.job.name}: " if len(verdicts) > 1 else ""
        if not verdict.violations:
            yield f"{order}{verdict.line()}"
        for violation in verdict.violations[:SHOWN]:
            yield f"{order}{sentence(violation, verdict.job)}"
        if (more := len(verdict.violations) - SHOWN) > 0:
            yield f"{order}and {counted(more, 'violation')} more"


def main(argv: Sequence[str]) -> None:
    """Reads, checks, writes, prints; exits 1 if a rule is broken."""
    options = parse_options(CommandOptions, "check", argv)
    rules = options.rules.checked(flag)
    check_output(options)
    tell = partial(say, Screen(stderr=True))
    verdicts = [
        Verdict(
            job,
            plan,
            tuple(plan_violations(job, plan, rules)),
        )
        for job, plan in read_plans(options, tell)
    ]
    console = Screen()
    for line in _lines(verdicts):
        say(console, line)
    if options.out is not None:
        write_records(options.out, verdicts)
    if any(verdict.violations for verdict in verdicts):
        sys.exit(1)


if __name__ == "__main__":
    run_door(main, computes=False)
