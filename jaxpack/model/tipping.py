"""What of a plan does not stand, as violations."""

import math
from collections.abc import Container, Iterator

import numpy as np

from jaxpack.model.box_check import Boxes, Rule
from jaxpack.model.job import Job
from jaxpack.model.plan_boxes import Laid
from jaxpack.model.rules import Rules
from jaxpack.model.stability_check import Tipping, off_centre, unbalanced
from jaxpack.model.violations import Violation


def tipping_violations(
    job: Job, rules: Rules, laid: Laid, astray: Container[int]
) -> Iterator[Violation]:
    """Items that are not stable, see `Rules.stability`.

    Args:
        job: what is packed.
        rules: which of them hold.
        laid: the boxes of a plan.
        astray: rows that are not where they can be loaded, of which nothing more is said.
    """
    if rules.stability == "share":
        return
    boxes = laid.boxes
    for row, axis, missing in _tipping(job, rules, laid):
        if row in astray or laid.item[row] < 0:
            continue
        rule, over = Rule(rules.stability), missing
        if rule is Rule.CENTRE:
            over *= float((boxes.high[row, axis] - boxes.low[row, axis]) * laid.units[axis])
        where = Violation(rule, int(boxes.bin[row]), int(laid.item[row]), int(laid.turn[row]))
        yield where._replace(what="xyz"[axis], amount=over) if math.isfinite(over) else where


def _tipping(job: Job, rules: Rules, laid: Laid) -> Iterator[Tipping]:
    """Items without weights weigh what their volume is."""
    boxes, floors = laid.carrying, 0
    if any(laid.reach):  # the floor ends before the items do: it is a box then
        boxes, floors = _with_floors(boxes)
    fixed = np.concatenate([np.ones(floors, bool), laid.item < 0])
    if rules.stability == "centre":
        found = off_centre(boxes, fixed)
    else:
        weights = np.array([job.items[item].weight if item >= 0 else 0 for item in laid.item])
        if not any(item.weight for item in job.items):
            weights = (boxes.high - boxes.low)[floors:].astype(float).prod(1)
        found = unbalanced(boxes, np.concatenate([np.zeros(floors), weights]), fixed)
    for one in found:
        if one.row >= floors:
            yield one._replace(row=one.row - floors)


def _with_floors(boxes: Boxes) -> tuple[Boxes, int]:
    """All one unit higher, on a floor of one unit in each bin, which come first; how many."""
    bins, first = np.unique(boxes.bin, return_index=True)
    up = np.array([0, 0, 1])
    low, high = 0 * boxes.room[first], boxes.room[first] * [1, 1, 0] + up
    numbers = np.concatenate([bins, boxes.bin])
    lows, highs = np.concatenate([low, boxes.low + up]), np.concatenate([high, boxes.high + up])
    rooms = np.concatenate([boxes.room[first] + up, boxes.room + up])
    return Boxes(numbers, lows, highs, rooms), len(bins)
