"""Is a plan possible? An independent check in the user's own units.

It shares no code with what makes plans; `jaxpack.model.box_check` has the geometry,
`jaxpack.model.rule_check` the rules of loads. A job is exact, and so is what is asked of a plan:
nothing is forgiven but the noise of floats.
"""

import math
from collections import Counter
from collections.abc import Iterator
from fractions import Fraction
from itertools import islice
from numbers import Integral, Real

import numpy as np

from jaxpack.model.box_check import RANK, Boxes, Rule, misplaced
from jaxpack.model.exact import exact
from jaxpack.model.job import ORIENTATIONS, Job, Plan
from jaxpack.model.limits import WEIGHT_DECIMALS
from jaxpack.model.numbers import show
from jaxpack.model.plan_boxes import laid_out
from jaxpack.model.rule_check import rule_violations
from jaxpack.model.rules import Rules
from jaxpack.model.tipping import tipping_violations
from jaxpack.model.violations import Violation, sentence

SHOWN = 5  # violations in one message


class InvalidPlanError(Exception):
    """A plan breaks a rule. One line: which bin, which item, which rule."""


def check_plan(job: Job, plan: Plan, rules: Rules = Rules()) -> None:
    """Raises InvalidPlanError naming the first violations, if there are any.

    Args:
        job: items and bins.
        plan: bins, each with its items in loading order. Positions count to the 13th digit of the
            bin's longest side; one that misses a whole number of the job's units by less than
            1e-12 of that side is on it.
        rules: which of them hold; where the share of support is 0 any touch is enough.

    Raises:
        InvalidPlanError: the plan breaks a rule.
        UserError: a rule is none, such as a support that is not from 0 to 1.
    """
    found = list(islice(plan_violations(job, plan, rules), SHOWN))
    if found:
        raise InvalidPlanError("; ".join(sentence(violation) for violation in found))


def plan_violations(job: Job, plan: Plan, rules: Rules = Rules()) -> Iterator[Violation]:
    """Every broken rule, first those of the whole plan, then bin by bin; see `check_plan`.

    An item is named once for each rule that it breaks (once for each axis if it is outside), with
    the first loaded of the items in its way. If entries name nothing that there is, only these
    are reported: the other rules read what they name.

    Raises:
        UserError: a rule is none, such as a support that is not from 0 to 1.
    """
    rules = rules.checked(dimension=job.dimension)
    found = list(_unknown(job, plan))
    if not found:
        found += _miscounted(job, plan)
        found += _too_heavy(job, plan)
        found += _misturned(job, plan)
        found += _misplaced(job, plan, rules)
    yield from sorted(found, key=lambda one: (-1 if one.bin is None else one.bin, RANK[one.rule]))


def _unknown(job: Job, plan: Plan) -> Iterator[Violation]:
    """Entries that name nothing."""
    for number, packed in enumerate(plan.bins):
        if not _is_index(packed.bin, len(job.bins)):
            yield Violation(Rule.UNKNOWN, number, what=f"bin type {show(packed.bin)}")
        for turn, put in enumerate(packed.placements):
            if not _is_index(put.item, len(job.items)):
                yield Violation(Rule.UNKNOWN, number, turn=turn, what=f"item {show(put.item)}")
            elif put.orientation not in ORIENTATIONS:
                what = f"orientation {show(put.orientation)}"
                yield Violation(Rule.UNKNOWN, number, put.item, turn, what=what)
            elif not _is_position(put.corner):
                what = f"position {show(put.corner)}"
                yield Violation(Rule.UNKNOWN, number, put.item, turn, what=what)
    for item in plan.left_out:
        if not _is_index(item, len(job.items)):
            yield Violation(Rule.UNKNOWN, what=f"item {show(item)}, which is left out")


def _is_index(value: object, count: int) -> bool:
    return isinstance(value, int | Integral) and 0 <= int(value) < count


def _is_position(corner: object) -> bool:
    if not isinstance(corner, tuple | list | np.ndarray) or len(corner) != 3:
        return False
    try:
        return all(isinstance(side, float | int | Real) and math.isfinite(side) for side in corner)
    except OverflowError:  # a whole number that has no float
        return False


def _miscounted(job: Job, plan: Plan) -> Iterator[Violation]:
    """Bins and items that occur too often or not often enough."""
    used: Counter[int] = Counter()
    for number, packed in enumerate(plan.bins):
        used[packed.bin] += 1
        copies, count = job.bins[packed.bin].copies, used[packed.bin]
        if copies is not None and count > copies:
            what = f"bin type {packed.bin}"
            yield Violation(
                Rule.COPIES, number, what=what, found=count, allowed=copies, amount=count - copies
            )
        if not packed.placements:
            yield Violation(Rule.EMPTY_BIN, number)
    loaded = Counter(put.item for packed in plan.bins for put in packed.placements)
    left = Counter(plan.left_out)
    missed = {
        index: loaded[index] + left[index] - item.copies
        for index, item in enumerate(job.items)
        if loaded[index] + left[index] != item.copies
    }
    places: dict[int, dict[int, None]] = {item: {} for item in missed}
    for number, packed in enumerate(plan.bins if missed else ()):
        for put in packed.placements:
            if put.item in missed and len(places[put.item]) <= SHOWN:
                places[put.item][number] = None
    for item, amount in missed.items():
        numbers = ", ".join(map(str, list(places[item])[:SHOWN]))
        where = f"bins {numbers}{', ...' * (len(places[item]) > SHOWN)}" if numbers else None
        found, allowed = loaded[item], job.items[item].copies
        yield Violation(
            Rule.COUNT, item=item, what=where, found=found, allowed=allowed, amount=amount
        )


def _too_heavy(job: Job, plan: Plan) -> Iterator[Violation]:
    """Bins over their limit, exactly."""
    known: dict[float, int] = {}

    def billionths(weight: float) -> int:
        if weight not in known:
            top, bottom = exact(weight).as_integer_ratio()
            known[weight] = top * 10**WEIGHT_DECIMALS // bottom
        return known[weight]

    for number, packed in enumerate(plan.bins):
        limit = job.bins[packed.bin].max_weight
        if limit == math.inf or not packed.placements:
            continue
        items = [put.item for put in packed.placements]
        weights = [billionths(job.items[item].weight) for item in items]
        total, most = sum(weights), billionths(limit)
        if total > most:
            found, over = (w / 10**WEIGHT_DECIMALS for w in (total, total - most))
            heaviest = items[weights.index(max(weights))]
            yield Violation(Rule.WEIGHT, number, heaviest, found=found, allowed=limit, amount=over)


def _misturned(job: Job, plan: Plan) -> Iterator[Violation]:
    allowed = [frozenset(item.orientations) for item in job.items]
    for number, packed in enumerate(plan.bins):
        for turn, put in enumerate(packed.placements):
            if put.orientation not in allowed[put.item]:
                what = put.orientation
                yield Violation(Rule.ORIENTATION, number, put.item, turn, what=what)


def _misplaced(job: Job, plan: Plan, rules: Rules) -> Iterator[Violation]:
    """What the boxes tell."""
    if not any(packed.placements for packed in plan.bins):
        return
    laid = laid_out(job, plan, rules)
    boxes, carrying, units = laid.boxes, laid.carrying, laid.units
    share, inclusive = exact(rules.support), rules.inclusive

    def length(leaf: np.ndarray, row: int, axis: int) -> Fraction:
        return int(leaf[row, axis]) * units[axis]

    astray = set()
    found_ones = misplaced(carrying, share, inclusive, laid.reach, bool(rules.door))
    for rule, row, other, axis, held in found_ones:
        item = int(laid.item[row])
        apart = rule is Rule.OVERLAP and not _overlap(boxes, row, other)
        if item < 0 or (apart and boxes.low[other, 2] < boxes.high[row, 2]):
            continue  # an obstacle; or too near only, which is said elsewhere
        if apart:
            rule = Rule.BLOCKED
        if rule in (Rule.OVERLAP, Rule.BLOCKED, Rule.FLOATING):
            astray.add(row)
        at = int(laid.turn[other]) if rule in (Rule.OVERLAP, Rule.BLOCKED) else None
        what: str | None = None
        found, allowed = length(boxes.low, row, axis), Fraction(0)
        if rule is Rule.OUTSIDE:
            what, reach = "xyz"[axis], laid.reach[axis] * units[axis]
            found, allowed = found, -reach
            if found >= -reach:
                found = length(boxes.high, row, axis)
                allowed = length(boxes.room, row, axis) + reach
        elif rule is Rule.OVERLAP:  # out along the axis on which that takes least
            depths = {
                "xyz"[axis]: min(
                    length(boxes.high, row, axis) - length(boxes.low, other, axis),
                    length(boxes.high, other, axis) - length(boxes.low, row, axis),
                )
                for axis in job.axes
            }
            what = min(depths, key=lambda name: depths[name])
            found = depths[what]
        elif rule is Rule.SUPPORT:
            what = "at least" if inclusive or share == 1 else "more than"
            found, allowed = held, share
        elif rule is Rule.BLOCKED and rules.door:
            what = "x"
            found, allowed = length(boxes.high, row, 0), length(boxes.low, other, 0)
        elif other >= 0:  # BLOCKED by it, or FLOATING over it
            allowed = max(length(carrying.high, other, axis), Fraction(0))
        figures = float(found), float(allowed), float(abs(found - allowed))
        bin, turn = int(boxes.bin[row]), int(laid.turn[row])
        yield Violation(rule, bin, item, turn, at, what, *figures)
    if job.limited or not rules.plain:
        yield from rule_violations(job, plan, rules, laid)
    yield from tipping_violations(job, rules, laid, astray)


def _overlap(boxes: Boxes, row: int, other: int) -> bool:
    low, high = boxes.low, boxes.high
    return bool(((low[row] < high[other]) & (low[other] < high[row])).all())
