"""`python -m jaxpack.check`: is a plan, of whomever, possible? Its violations, or one line."""

import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from jaxpack.cli import parse_options, run_door
from jaxpack.errors import UserError
from jaxpack.io.notes import Say
from jaxpack.io.plans import plan_rules
from jaxpack.io.tables import write_table
from jaxpack.io.texts import json_line, json_lines, write_text
from jaxpack.model.job import Job, Plan
from jaxpack.model.objectives import objective_of
from jaxpack.model.plan_check import plan_violations
from jaxpack.model.rules import Rules
from jaxpack.model.violations import Violation, sentence
from jaxpack.plan_files import SUFFIXES, PlanFiles, check_output, read_plans
from jaxpack.plan_tables import Screen, counted, say
from jaxpack.rule_flags import RuleFlags, flag

SHOWN = 20  # violations on the terminal


@dataclass(frozen=True)
class CommandOptions(PlanFiles, RuleFlags):
    """Check a loading plan: exit code 0 if it is valid, 1 if it breaks a rule."""

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


def rules_of(options: CommandOptions, tell: Say) -> Rules:
    """The rules of the options; where these are the usual ones, those that a plan says.

    Raises:
        UserError: where one of them is none.
    """
    rules, known = options.rules, Rules()
    said = plan_rules(options.plan) if options.plan.suffix.lower() == ".json" else {}
    taken = {
        name: one for name, one in said.items() if getattr(rules, name) == getattr(known, name)
    }
    if taken:
        what = ", ".join(f"{name} {one}" for name, one in taken.items())
        tell(f"{options.plan}: checked by the rules that it says it was made by: {what}")
    return replace(rules, **taken)


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
    options.rules.checked(flag)
    if options.out is not None:
        if options.out.suffix.lower() not in SUFFIXES:
            raise UserError(f"--out {options.out}: end it with {' or '.join(SUFFIXES)}")
        check_output("--out", options.out, options)
    tell = partial(say, Screen(stderr=True))
    rules = rules_of(options, tell)
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
