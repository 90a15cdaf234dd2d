"""`python -m jaxpack.simulate`: what moves in a plan of anyone, loaded under gravity?"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from tyro.conf import FlagCreatePairsOff

from jaxpack.cli import parse_options, run_door
from jaxpack.errors import UserError
from jaxpack.io.film import Film
from jaxpack.model.job import Job, Plan
from jaxpack.model.physics import FRICTION, Moved, check_friction, simulate
from jaxpack.plan_files import PlanFiles, check_output, read_plans
from jaxpack.plan_tables import Screen, counted, say

SHOWN = 20  # items on the terminal
CENTIMETRE = {"mm": 10.0, "cm": 1.0, "m": 0.01, "in": 1 / 2.54}
"""How many of a unit it is."""


@dataclass(frozen=True)
class CommandOptions(PlanFiles):
    """Load a plan under gravity: exit code 0 if nothing moves, 1 if something does.

    Items are rigid boxes that come one by one from above, in the order of the plan.
    """

    unit: Literal["mm", "cm", "m", "in"] = "mm"
    """What one unit of length is in the files."""
    moved: float | None = None
    """Items that are displaced by more than this have moved; in the unit of the files. A
    centimetre if not given."""
    friction: float = FRICTION
    """Between items, and between items and the floor, 0 to 1: cardboard on cardboard if not
    given."""
    at_once: FlagCreatePairsOff[bool] = False
    """All items are in their places from the start."""
    walls: FlagCreatePairsOff[bool] = False
    """The bins have walls, which hold what leans on them."""
    html: Path | None = None
    """Write a page on which the loading can be stepped through, for a browser without a network."""


@dataclass(frozen=True)
class Verdict:
    """What became of one plan."""

    job: Job
    plan: Plan
    found: Moved
    least: float  # in the job's unit of length: less is no movement
    unit: str

    @property
    def moved(self) -> np.ndarray:
        """Which rows of `found` have moved: bool [n]."""
        return self.found.distance > self.least

    def lines(self) -> Iterator[str]:
        """A line for each of the first items that moved, and one for all."""
        found, rows = self.found, np.flatnonzero(self.moved)
        for row in rows[:SHOWN].tolist():
            item = int(found.item[row])
            name = self.job.items[item].name
            which = f"bin {found.bin[row]} item {item}{f' {name!r}' if name else ''}"
            by = f"moved by {found.distance[row]:.4g} {self.unit}"
            yield f"{which} (loaded as number {found.turn[row]}): {by}"
        if (more := len(rows) - SHOWN) > 0:
            yield f"and {counted(more, 'item')} more"
        items, bins = len(found.item), len(self.plan.bins)
        what = f"more than {self.least:.4g} {self.unit}"
        if not len(rows):
            yield f"nothing moved by {what}: {counted(items, 'item')} in {counted(bins, 'bin')}"
            return
        where = f"in {len(np.unique(found.bin[rows])):,} of {counted(bins, 'bin')}"
        yield f"{len(rows):,} of {counted(items, 'item')} moved by {what}, {where}"


def least_movement(options: CommandOptions, plans: Sequence[tuple[Job, Plan]]) -> float:
    """The length, in the files' unit, that nothing may move by.

    Raises:
        UserError: it is no length, or one that would be no movement in such bins.
    """
    given = options.moved
    if given is not None and not 0 < given < np.inf:
        raise UserError(f"--moved {given}: give a length above 0")
    least = CENTIMETRE[options.unit] if given is None else given
    longest = max((max(job.room(one)) for job, plan in plans for one in plan.bins), default=np.inf)
    if given is None and longest < 10 * least:
        what = f"a bin is {longest:.4g} {options.unit} long, and a centimetre no small movement"
        raise UserError(f"{what}: say with --unit what one of its units is, or give --moved")
    return least


def main(argv: Sequence[str]) -> None:
    """Reads, simulates, prints, writes; exits 1 if something moved."""
    options = parse_options(CommandOptions, "simulate", argv)
    check_friction("--friction", options.friction)
    if options.html is not None:
        check_output("--html", options.html, options)
    plans = read_plans(options, partial(say, Screen(stderr=True)))
    if options.html is not None and len(plans) > 1:
        raise UserError(f"--html: {len(plans)} plans, and a page of one: say which with --order")
    least = least_movement(options, plans)
    console, moved = Screen(), False
    for job, plan in plans:
        film = None if options.html is None else Film(job, plan, least)
        found = simulate(
            job,
            plan,
            friction=options.friction,
            at_once=options.at_once,
            walls=options.walls,
            seen=None if film is None else film.see,
        )
        verdict = Verdict(job, plan, found, least, options.unit)
        for line in verdict.lines():
            say(console, f"{job.name}: {line}" if len(plans) > 1 else line)
        if options.html is not None and film is not None:
            film.write_html(options.html, found)
        moved |= bool(verdict.moved.any())
    if moved:
        sys.exit(1)


if __name__ == "__main__":
    run_door(main, computes=False)
