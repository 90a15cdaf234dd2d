"""Is a plan possible? An independent check in the user's own units, exact to the last decimal.

It shares no code with what makes plans: it compares the items of a bin pair by pair, as boxes.
An item is lowered straight onto its place when its turn in the loading order comes, so no item
that was loaded earlier, and stands over the same part of the floor, may reach higher than where
it rests. Lengths become whole numbers of the finest decimal that occurs, so nothing is rounded.
"""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain, islice

import numpy as np

from jaxpack.loading.exact import common_scale, exact
from jaxpack.loading.job import ORIENTATIONS, BinType, Job, PackedBin, Plan

WEIGHT_TOLERANCE = 1e-9  # relative: a sum of floats
SHOWN = 5  # violations in one message


class InvalidPlanError(Exception):
    """A plan breaks a rule. One line: which bin, which item, which rule."""


def check_plan(
    job: Job, plan: Plan, support: float = 0.5, inclusive: bool = True, slack: float = 0.0
) -> None:
    """Raises InvalidPlanError naming the first violations, if there are any.

    Args:
        job: items and bins.
        plan: bins, each with its items in loading order.
        support: share of an item's footprint that has to lie on what is directly under it.
        inclusive: exactly that share is enough; otherwise it has to be more.
        slack: a length; the plan's coordinates are read no more strictly than this. For plans
            made on a coarser unit than the job's; well below the items' sides. 0 is exact.
    """
    found = list(islice(plan_violations(job, plan, support, inclusive, slack), SHOWN))
    if found:
        raise InvalidPlanError("; ".join(found))


def plan_violations(
    job: Job, plan: Plan, support: float = 0.5, inclusive: bool = True, slack: float = 0.0
) -> Iterator[str]:
    """Every broken rule, one line each; nothing if the plan is valid. See `check_plan`.

    Bins are numbered as in the plan; an item by its index in the job and its place in the order.
    """
    unreadable = list(_unreadable(job, plan))
    yield from unreadable
    if unreadable:  # the other rules read what these entries name
        return
    yield from _miscounted(job, plan)
    lengths = [*(item.size for item in job.items), *(kind.size for kind in job.bins)]
    lengths += [put.corner for packed in plan.bins for put in packed.placements]
    scale = common_scale([slack, *chain.from_iterable(lengths)])
    for number, packed in enumerate(plan.bins):
        names = [
            f"bin {number} item {put.item} (loaded as number {turn})"
            for turn, put in enumerate(packed.placements)
        ]
        for put, name in zip(packed.placements, names, strict=True):
            if put.orientation not in job.items[put.item].orientations:
                yield f"{name}: orientation {put.orientation} is not allowed"
        kind = job.bins[packed.bin]
        weight = math.fsum(job.items[put.item].weight for put in packed.placements)
        if weight > kind.max_weight * (1 + WEIGHT_TOLERANCE):
            heaviest = max(packed.placements, key=lambda put: job.items[put.item].weight).item
            yield (
                f"bin {number}: its items weigh {weight:.12g}, more than {kind.max_weight:.12g}; "
                f"the heaviest is item {heaviest}"
            )
        if packed.placements:
            boxes = _boxes(job, packed, kind, scale, slack)
            for turn, rule in _misplaced(boxes, exact(support), inclusive):
                yield f"{names[turn]}: {rule}"


def _unreadable(job: Job, plan: Plan) -> Iterator[str]:
    """Entries that name nothing."""
    for number, packed in enumerate(plan.bins):
        if not 0 <= packed.bin < len(job.bins):
            yield f"bin {number}: there is no bin type {packed.bin}"
        for put in packed.placements:
            name = f"bin {number} item {put.item}"
            if not 0 <= put.item < len(job.items):
                yield f"{name}: there is no such item"
            if put.orientation not in ORIENTATIONS:
                yield f"{name}: there is no orientation {put.orientation}"
            if not all(math.isfinite(side) for side in put.corner):
                yield f"{name}: its corner {put.corner} is no position"
    for item in plan.left_out:
        if not 0 <= item < len(job.items):
            yield f"left out item {item}: there is no such item"


def _miscounted(job: Job, plan: Plan) -> Iterator[str]:
    """Bins and items that occur too often or not often enough."""
    used: Counter[int] = Counter()
    for number, packed in enumerate(plan.bins):
        used[packed.bin] += 1
        copies = job.bins[packed.bin].copies
        if copies is not None and used[packed.bin] > copies:
            yield f"bin {number}: there are only {copies} of bin type {packed.bin}"
        if not packed.placements:
            yield f"bin {number}: it holds no item"
    places: dict[int, list[int]] = {}
    for number, packed in enumerate(plan.bins):
        for put in packed.placements:
            places.setdefault(put.item, []).append(number)
    left = Counter(plan.left_out)
    for index, item in enumerate(job.items):
        bins = places.get(index, [])
        if len(bins) + left[index] != item.copies:
            where = f" (bins {', '.join(map(str, sorted(set(bins))))})" if bins else ""
            yield (
                f"item {index}: {item.copies} to pack, but {len(bins)} packed{where} "
                f"and {left[index]} left out"
            )


@dataclass(frozen=True)
class _Boxes:
    """The items of one bin in loading order, in whole numbers of 1 / scale."""

    low: np.ndarray  # [n, 3]
    high: np.ndarray  # [n, 3]
    room: np.ndarray  # [3]
    slack: int
    scale: int

    def shown(self, length: int) -> str:
        """A length in the user's unit."""
        return f"{float(Fraction(int(length), self.scale)):.12g}"


def _boxes(job: Job, packed: PackedBin, kind: BinType, scale: int, slack: float) -> _Boxes:
    def whole(lengths: tuple[float, ...]) -> list[int]:
        return [int(exact(length) * scale) for length in lengths]

    low = [whole(put.corner) for put in packed.placements]
    size = [whole(job.items[put.item].turned(put.orientation)) for put in packed.placements]
    room, tolerance = whole(kind.size), int(exact(slack) * scale)
    # The largest numbers are sums of the areas that n items share with one.
    reach = max(abs(length) for row in (*low, *size, room, [tolerance]) for length in row)
    dtype: type = np.int64 if len(low) * (2 * reach) ** 2 < 2**62 else object
    corner: np.ndarray = np.array(low, dtype)
    return _Boxes(corner, corner + np.array(size, dtype), np.array(room, dtype), tolerance, scale)


def _misplaced(boxes: _Boxes, support: Fraction, inclusive: bool) -> Iterator[tuple[int, str]]:
    """(place in the order, broken rule) of the items of one bin."""
    low, high, slack = boxes.low, boxes.high, boxes.slack
    outside = (low < -slack) | (high > boxes.room + slack)
    for turn, axis in np.argwhere(outside).tolist():
        start, end, room = (boxes.shown(v[axis]) for v in (low[turn], high[turn], boxes.room))
        yield turn, f"outside the bin: {'xyz'[axis]} from {start} to {end} of 0 to {room}"

    # shared[i, j]: how far i and j reach into each other along x, y and z; negative is a gap.
    shared = np.minimum(high[:, None], high[None]) - np.maximum(low[:, None], low[None])
    earlier = np.tri(len(low), k=-1, dtype=bool)  # j was loaded before i
    above = earlier & (shared[..., :2] > slack).all(2)
    z, top = low[:, 2], high[:, 2]
    overlap = above & (shared[..., 2] > slack)
    for turn, other in np.argwhere(overlap).tolist():
        yield turn, f"overlaps the item loaded as number {other}"
    blocked = above & ~overlap & (top[None] > z[:, None] + slack)
    for turn, other in np.argwhere(blocked).tolist():
        yield turn, f"the item loaded as number {other} is over it: not reachable from above"

    # What may be under it and end where it begins: with a slack also what just misses it.
    sides = (high - low)[:, None, :2]
    reach = np.clip(shared[..., :2] + slack, 0, sides)
    area = reach[..., 0] * reach[..., 1]
    contact = earlier & (abs(top[None] - z[:, None]) <= slack) & (area > 0)
    footprint = sides[:, 0, 0] * sides[:, 0, 1]
    placed = ~(overlap | blocked).any(1)  # of the others it is unknown what they would rest on
    for turn in map(int, np.flatnonzero(placed & (abs(z) > slack))):
        if not contact[turn].any():
            bottom, under = boxes.shown(z[turn]), boxes.shown(max(top[above[turn]], default=0))
            yield turn, f"floats: its bottom is at {bottom}, but what it can rest on at {under}"
            continue
        share = Fraction(int(area[turn][contact[turn]].sum()), int(footprint[turn]))
        if share < support or (share == support and not inclusive):
            wanted = f"{'at least' if inclusive else 'more than'} {100 * float(support):.9g} %"
            yield turn, f"{100 * float(share):.9g} % of its footprint is supported, not {wanted}"
