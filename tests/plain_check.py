"""A second check of plans in plain Python, written from the rules: pairs, fractions and loops."""

import math
from collections import Counter
from fractions import Fraction

from jaxpack.model.box_check import Rule
from jaxpack.model.exact import exact
from jaxpack.model.job import ORIENTATIONS


def plain_check(job, plan, support, inclusive):
    """What `plan_violations` has to report: sorted tuples that begin with rule, bin, item, turn.

    What follows is the other item's turn of OVERLAP and BLOCKED, the axis of OUTSIDE, what is
    found under FLOATING, the share of SUPPORT, the numbers that COUNT, COPIES and WEIGHT compare.
    """
    if unknown := list(_unknown(job, plan)):
        return sorted(unknown)
    found = list(_lists(job, plan))
    for number, packed in enumerate(plan.bins):
        found += _of_bin(job, number, packed, support, inclusive)
    return sorted(found, key=repr)


def _unknown(job, plan):
    for number, packed in enumerate(plan.bins):
        if not 0 <= packed.bin < len(job.bins):
            yield Rule.UNKNOWN, number
        for turn, put in enumerate(packed.placements):
            known = 0 <= put.item < len(job.items) and put.orientation in ORIENTATIONS
            if not known or not all(map(math.isfinite, put.corner)):
                yield Rule.UNKNOWN, number, turn
    for item in plan.left_out:
        if not 0 <= item < len(job.items):
            yield (Rule.UNKNOWN,)


def _lists(job, plan):
    used, packed_items = Counter(), Counter(plan.left_out)
    for number, packed in enumerate(plan.bins):
        used[packed.bin] += 1
        copies = job.bins[packed.bin].copies
        if copies is not None and used[packed.bin] > copies:
            yield Rule.COPIES, number, None, None, used[packed.bin], copies
        if not packed.placements:
            yield Rule.EMPTY_BIN, number, None, None
        packed_items.update(put.item for put in packed.placements)
    for index, item in enumerate(job.items):
        if packed_items[index] != item.copies:
            missed = packed_items[index] - item.copies
            yield Rule.COUNT, None, index, None, missed


def _of_bin(job, number, packed, support, inclusive):
    kind = job.bins[packed.bin]
    weights = [exact(job.items[put.item].weight) for put in packed.placements]
    if kind.max_weight < math.inf and sum(weights) > exact(kind.max_weight):
        yield Rule.WEIGHT, number, float(sum(weights)), kind.max_weight
    boxes = [_box(job, kind, put) for put in packed.placements]
    for turn, (put, (low, high)) in enumerate(zip(packed.placements, boxes, strict=True)):
        name = number, put.item, turn
        if put.orientation not in job.items[put.item].orientations:
            yield Rule.ORIENTATION, *name
        for axis in range(3):
            if low[axis] < 0 or high[axis] > exact(kind.size[axis]):
                yield Rule.OUTSIDE, *name, "xyz"[axis]
        earlier = [
            (other, *box)
            for other, box in enumerate(boxes[:turn])
            if all(_shared((low, high), box, axis) > 0 for axis in (0, 1))
        ]
        overlapped = [other for other, *box in earlier if _shared((low, high), box, 2) > 0]
        over = [other for other, bottom, _ in earlier if bottom[2] >= high[2]]
        if overlapped:
            yield Rule.OVERLAP, *name, overlapped[0]
        if over:
            yield Rule.BLOCKED, *name, over[0]
        if overlapped or over or low[2] <= 0:
            continue
        area = sum(
            _shared((low, high), box, 0) * _shared((low, high), box, 1)
            for _, *box in earlier
            if box[1][2] == low[2]
        )
        share = area / ((high[0] - low[0]) * (high[1] - low[1]))
        if not area:
            under = max([0, *(top[2] for _, _, top in earlier)])
            yield Rule.FLOATING, *name, float(under)
        elif share < support or (share == support and not inclusive and support != 1):
            yield Rule.SUPPORT, *name, float(share)


def _shared(one, other, axis):
    return min(one[1][axis], other[1][axis]) - max(one[0][axis], other[0][axis])


def _box(job, kind, put):
    """(low, high) of an item as it lies."""
    longest = max(kind.size[axis] for axis in job.axes)
    size = [exact(side) for side in job.items[put.item].turned(put.orientation)]
    low = [
        _place(length, longest, job.unit if axis in job.axes else Fraction(1))
        for axis, length in enumerate(put.corner)
    ]
    return low, [start + side for start, side in zip(low, size, strict=True)]


def _place(length, longest, unit):
    """Where a position is: a multiple of the unit, but for noise, or what its 13 digits show."""
    length = Fraction(length)
    multiple = round(length / unit) * unit
    if abs(length - multiple) < Fraction(longest) / 10**12:
        return multiple
    digits = 0  # before the point of the longest side
    while exact(longest) >= Fraction(10) ** digits:
        digits += 1
    while exact(longest) < Fraction(10) ** (digits - 1):
        digits -= 1
    grain = Fraction(10) ** (digits - 13)
    return round(length / grain) * grain
