"""What the check of a plan finds: records, and the sentences that a door makes of them."""

from typing import NamedTuple

from jaxpack.model.box_check import Rule
from jaxpack.model.job import Job


class Violation(NamedTuple):
    """A broken rule: where, and by how much. What does not apply is None.

    Lengths and weights are in the units of the job, shares of a base from 0 to 1.
    """

    rule: Rule
    bin: int | None = None  # its number in the plan
    item: int | None = None  # index in the job; of WEIGHT the heaviest one
    turn: int | None = None  # how many items its bin held when it was loaded
    other: int | None = None  # the turn of the item in the way
    what: str | None = None  # axis, orientation, bins, name of a thing or "more than", "at least"
    found: float | None = None  # what the plan has
    allowed: float | None = None  # what the rule asks for
    amount: float | None = None  # by how much it is missed


def sentence(violation: Violation, job: Job | None = None) -> str:
    """A violation in words, in one line unless a name breaks it.

    Args:
        violation: of a plan.
        job: its items' names are said too, as they are in their file.
    """
    bin, item, turn = violation.bin, violation.item, violation.turn
    place = [] if bin is None else [f"bin {bin}"]
    if item is not None and violation.rule is not Rule.WEIGHT:
        place.append(_called(item, job))
    if turn is not None:
        place.append(f"(loaded as number {turn})")
    told = _told(violation, job)
    return f"{' '.join(place)}: {told}" if place else told


def _called(item: int, job: Job | None) -> str:
    name = job.items[item].name if job else ""
    return f"item {item} '{name}'" if name else f"item {item}"


def _told(violation: Violation, job: Job | None) -> str:
    """What is wrong, without where."""
    rule, _, item, _, other, what, found, allowed, amount = violation
    match rule:
        case Rule.UNKNOWN | Rule.ORDER:
            return f"there is no {what}"
        case Rule.COUNT:
            left = (amount or 0) + (allowed or 0) - (found or 0)
            where = f" ({what})" if what else ""
            return f"{allowed} to pack, but {found} packed{where} and {left} left out"
        case Rule.COPIES:
            return f"there are only {allowed} of {what}"
        case Rule.EMPTY_BIN:
            return "it holds no item"
        case Rule.ORIENTATION:
            return f"orientation {what} is not allowed"
        case Rule.WEIGHT:
            weighs = f"its items weigh {_number(found)}, more than {_number(allowed)}"
            return f"{weighs}; the heaviest is {_called(item or 0, job)}"
        case Rule.OUTSIDE if allowed:
            ends = f"it reaches to {_number(found)}, the bin to {_number(allowed)}"
            return f"outside the bin: along {what} {ends}"
        case Rule.OUTSIDE:
            return f"outside the bin: along {what} it begins at {_number(found)}, the bin at 0"
        case Rule.OVERLAP:
            much = f"by {_number(amount)} along {what}"
            return f"overlaps the item loaded as number {other} {much}"
        case Rule.BLOCKED:
            return f"the item loaded as number {other} is over it: not reachable from above"
        case Rule.FLOATING:
            bottom = f"its bottom is at {_number(found)}"
            return f"floats: {bottom}, but what it can rest on at {_number(allowed)}"
        case Rule.SUPPORT:
            wanted = f"{what} {_percent(allowed)}"
            return f"{_percent(found)} of its footprint is supported, not {wanted}"
        case Rule.CENTRE:
            wrong = "its centre is not inside what carries it"
            out = f"it is {_number(amount)} too far out along {what}"
            return f"{wrong}: {out if what else 'nothing firm is under it'}"
        case Rule.STATIC:
            return f"its stack is not in equilibrium: it would tip along {what}"


def _number(value: float | None) -> str:
    return f"{value or 0:.13g}"


def _percent(share: float | None) -> str:
    return f"{100 * (share or 0):.9g} %"
