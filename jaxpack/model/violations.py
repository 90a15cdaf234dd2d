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
    other: int | None = None  # the turn of the item in the way; of obstacles -1, -2, ...
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
        case Rule.OUTSIDE if (allowed or 0) > 0:
            ends = f"it reaches to {_number(found)}, the bin to {_number(allowed)}"
            return f"outside the bin: along {what} {ends}"
        case Rule.OUTSIDE:
            ends = f"it begins at {_number(found)}, the bin at {_number(allowed)}"
            return f"outside the bin: along {what} {ends}"
        case Rule.OVERLAP:
            much = f"by {_number(amount)} along {what}"
            return f"overlaps {_met(other)} {much}"
        case Rule.GAP:
            return f"{_number(found)} from {_met(other)} along {what}, not {_number(allowed)}"
        case Rule.BLOCKED if what:
            return f"{_met(other)} stands between its place and the door"
        case Rule.BLOCKED:
            return f"{_met(other)} is over it: not reachable from above"
        case Rule.FLOATING if not amount:
            return "floats: nothing of it is over the floor"
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
        case _:
            return _told_of_loads(violation)


def _told_of_loads(violation: Violation) -> str:
    """What is wrong with the rules of loads, without where."""
    rule, _, _, _, other, what, found, allowed, _ = violation
    match rule:
        case Rule.ON_FLOOR:
            return f"its bottom is at {_number(found)}, but it has to stand on the floor"
        case Rule.STACKABLE:
            return f"lies on {_met(other)}, on which nothing may lie"
        case Rule.STACK_ID:
            return f"lies on {_met(other)}, which has another stack id"
        case Rule.HEAVY_BELOW:
            weighs = f"weighs {_number(found)}, and that {_number(allowed)}"
            return f"lies on {_met(other)}, which is lighter: it {weighs}"
        case Rule.STACK:
            return f"in a stack of {_number(found)} items, may be in one of {_number(allowed)}"
        case Rule.WEIGHT_ABOVE:
            return f"{_number(found)} rests on it, more than {_number(allowed)}"
        case Rule.STOP:
            last = "with no stop" if allowed is None else f"for stop {_number(allowed)}"
            return f"is for stop {_number(found)}, and {_met(other)}, {last}, is in its way"
        case Rule.ITEMS:
            return f"it holds {found} items, more than {allowed}"
        case Rule.APART:
            return f"shares the bin with {_met(other)}, and both are apart '{what}'"
        case Rule.BALANCE:
            middle = f"beyond {_number(allowed)}, the end of the middle share"
            return f"its centre of mass is at {_number(found)} along {what}, {middle}"
        case Rule.GROUP:
            return f"group '{what}' is in {found} bins, and fits one"
        case _:
            raise AssertionError(f"{rule} has no sentence")


def _met(other: int | None) -> str:
    """Another item, or an obstacle."""
    if other is not None and other < 0:
        return f"obstacle {-1 - other}"
    return f"the item loaded as number {other}"


def _number(value: float | None) -> str:
    return f"{value or 0:.13g}"


def _percent(share: float | None) -> str:
    return f"{100 * (share or 0):.9g} %"
