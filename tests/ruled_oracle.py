"""The rules of loads in plain Python, written from their definition: pairs, fractions, loops."""

import math
from collections import Counter, defaultdict
from fractions import Fraction
from itertools import combinations

from jaxpack.model.exact import exact
from jaxpack.model.job import Job, Plan
from jaxpack.model.rules import Rules


def broken(job: Job, plan: Plan, rules: Rules) -> list[str]:
    """What of a plan breaks which rule; positions of items are exact, or the nearest decimals."""
    found = _counts(job, plan)
    for number, packed in enumerate(plan.bins):
        found += [f"bin {number}: {what}" for what in _Bin(job, packed, rules).broken()]
    return found


def _counts(job, plan):
    there = Counter(put.item for packed in plan.bins for put in packed.placements)
    there.update(plan.left_out)
    if there != Counter({n: item.copies for n, item in enumerate(job.items) if item.copies}):
        found = [f"counts {dict(there)}"]
    else:
        found = []
    used = Counter(packed.bin for packed in plan.bins)
    for kind, count in used.items():
        copies = job.bins[kind].copies
        if copies is not None and count > copies:
            found.append(f"{count} bins of type {kind}")
    return found


def groups_in(job, plan):
    """Of every group in how many bins it is."""
    bins = defaultdict(set)
    for number, packed in enumerate(plan.bins):
        for put in packed.placements:
            if group := job.items[put.item].limits.group:
                bins[group].add(number)
    return {group: len(some) for group, some in bins.items()}


class _Box:
    def __init__(self, low, size, item=None, name=""):
        self.low = [Fraction(side) for side in low]
        self.high = [a + b for a, b in zip(self.low, size, strict=True)]
        self.item, self.name = item, name
        self.firm = None

    def shared(self, other, axis):
        return min(self.high[axis], other.high[axis]) - max(self.low[axis], other.low[axis])

    def area(self, other):
        return max(self.shared(other, 0), 0) * max(self.shared(other, 1), 0)


class _Bin:
    def __init__(self, job, packed, rules):
        self.job, self.rules, self.flat = job, rules, job.dimension == 2
        self.kind, self.packed = job.bins[packed.bin], packed
        self.room = [exact(side) for side in job.room(packed)]
        self.gap = exact(rules.gap)
        self.boxes = []
        for turn, put in enumerate(packed.placements):
            item = job.items[put.item]
            low = [Fraction(side).limit_denominator(10**6) for side in put.corner]
            size = [exact(side) for side in item.turned(put.orientation)]
            self.boxes.append(_Box(low, size, item, f"{turn} (item {put.item})"))
        self.taken = [
            _Box([exact(s) for s in one.corner], [exact(s) for s in one.size])
            for one in self.kind.limits.obstacles
        ]
        self.floor = _Box([0, 0, -1], [self.room[0], self.room[1], 1])

    def broken(self):
        for rule in (
            self.outside, self.apart_in_space, self.carried, self.firm, self.reachable,
            self.weights, self.stacks, self.bases, self.stops, self.counts, self.balance,
        ):  # fmt: skip
            for what in rule():
                yield f"{rule.__name__}: {what}"

    def outside(self):
        over = exact(self.rules.overhang)
        for box in self.boxes:
            for axis in range(3):
                more = over if axis == 0 or (axis == 1 and not self.flat) else 0
                if box.low[axis] < -more or box.high[axis] > self.room[axis] + more:
                    yield f"{box.name} along {axis}"

    def apart_in_space(self):
        for one, other in combinations(self.boxes, 2):
            gaps = (self.gap, self.gap, self.gap if self.flat else 0)
            if all(one.shared(other, axis) > -gap for axis, gap in enumerate(gaps)):
                yield f"{one.name} and {other.name}"
        for one in self.boxes:
            for taken in self.taken:
                if all(one.shared(taken, axis) > 0 for axis in range(3)):
                    yield f"{one.name} and an obstacle"

    def under(self, turn):
        """(box, area) of what an item lies on, of those loaded earlier."""
        box = self.boxes[turn]
        for other in [self.floor, *self.taken, *self.boxes[:turn]]:
            gap = self.gap if self.flat and other.item else 0
            if other.high[2] + gap == box.low[2] and box.area(other) > 0:
                yield other, box.area(other)

    def carried(self):
        share = exact(self.rules.support)
        for turn, box in enumerate(self.boxes):
            base = (box.high[0] - box.low[0]) * (box.high[1] - box.low[1])
            area = sum(area for _, area in self.under(turn))
            enough = area >= share * base if self.rules.inclusive else area > share * base
            if not area or not (enough or area == base):
                yield f"{box.name}: {area} of {base}"

    def firm(self):
        """The four points around the centre lie in the hull of the firm contacts."""
        if self.rules.stability == "share":
            return
        for fixed in (self.floor, *self.taken):
            fixed.firm = [
                (fixed.low[0], fixed.low[1]), (fixed.high[0], fixed.low[1]),
                (fixed.high[0], fixed.high[1]), (fixed.low[0], fixed.high[1]),
            ]  # fmt: skip
        for turn, box in enumerate(self.boxes):
            points = []
            for other, _ in self.under(turn):
                x = max(box.low[0], other.low[0]), min(box.high[0], other.high[0])
                y = max(box.low[1], other.low[1]), min(box.high[1], other.high[1])
                points += _clipped(other.firm, x, y)
            box.firm = _hull(points)
            for way_x in (-1, 1):
                for way_y in (-1, 1):
                    point = tuple(
                        (box.low[axis] + box.high[axis]) / 2
                        + way * (box.high[axis] - box.low[axis]) / 64
                        for axis, way in ((0, way_x), (1, way_y))
                    )
                    if not _inside(box.firm, point):
                        yield f"{box.name} at {point}"

    def reachable(self):
        for turn, box in enumerate(self.boxes):
            for other in [*self.taken, *self.boxes[:turn]]:
                if self.rules.door:
                    faces = box.shared(other, 1) > 0 and box.shared(other, 2) > 0
                    if faces and other.low[0] >= box.high[0]:
                        yield f"{box.name} from the door"
                elif box.area(other) > 0 and other.low[2] >= box.high[2]:
                    yield f"{box.name} from above"

    def lies_on(self):
        """(upper, lower, area) of all pairs of items, by turn."""
        for a, one in enumerate(self.boxes):
            for b, other in enumerate(self.boxes):
                gap = self.gap if self.flat else 0
                if a != b and other.high[2] + gap == one.low[2] and one.area(other) > 0:
                    yield a, b, one.area(other)

    def weights(self):
        total = sum(exact(box.item.weight) for box in self.boxes)
        if total > self.kind.max_weight:
            yield "the bin"
        pairs = list(self.lies_on())
        contact = Counter()
        for turn in range(len(self.boxes)):
            contact[turn] = sum(area for _, area in self.under(turn))
        load = Counter()
        for turn in sorted(range(len(self.boxes)), key=lambda n: -self.boxes[n].low[2]):
            for upper, lower, area in pairs:
                if upper == turn:
                    weight = exact(self.boxes[turn].item.weight) + load[turn]
                    load[lower] += weight * area / contact[turn]
        for turn, box in enumerate(self.boxes):
            if load[turn] > box.item.limits.weight_above * (1 + 1e-9):
                yield f"{box.name} carries {float(load[turn])}"

    def stacks(self):
        pairs = list(self.lies_on())

        def longest(turn, way):
            others = [(b, a)[way] for a, b, _ in pairs if (a, b)[way] == turn]
            return 1 + max((longest(other, way) for other in others), default=0)

        for turn, box in enumerate(self.boxes):
            most = box.item.limits.most_in_stack
            if most is not None and longest(turn, 0) + longest(turn, 1) - 1 > most:
                yield f"{box.name} in a stack of {longest(turn, 0) + longest(turn, 1) - 1}"

    def bases(self):
        for upper, lower, _ in self.lies_on():
            one, other = self.boxes[upper].item, self.boxes[lower].item
            if not other.limits.stackable:
                yield f"on {self.boxes[lower].name}"
            if one.limits.stack_id != other.limits.stack_id:
                yield f"{self.boxes[upper].name} on another stack"
            if self.rules.heavy_below and one.weight > other.weight:
                yield f"{self.boxes[upper].name} on a lighter one"
        for box in self.boxes:
            if box.item.limits.floor and box.low[2] != 0:
                yield f"{box.name} not on the floor"

    def stops(self):
        def stop(box):
            return math.inf if box.item.limits.stop is None else box.item.limits.stop

        for one in self.boxes:
            for other in self.boxes:
                if stop(one) >= stop(other):
                    continue
                if one.area(other) > 0 and other.low[2] >= one.high[2]:
                    yield f"{other.name} on {one.name}"
                faces = one.shared(other, 1) > 0 and one.shared(other, 2) > 0
                if self.rules.door and faces and other.low[0] >= one.high[0]:
                    yield f"{other.name} before {one.name}"

    def counts(self):
        most = self.kind.limits.most_items
        if most is not None and len(self.boxes) > most:
            yield f"{len(self.boxes)} items"
        apart = Counter(box.item.limits.apart for box in self.boxes if box.item.limits.apart)
        if any(count > 1 for count in apart.values()):
            yield f"apart {apart}"

    def balance(self):
        if self.rules.balance is None:
            return
        mass = [exact(box.item.weight) for box in self.boxes]
        if not any(mass):
            mass = [
                math.prod(b - a for a, b in zip(box.low, box.high, strict=True))
                for box in self.boxes
            ]
        for axis in (0,) if self.flat else (0, 1):
            centres = [(box.low[axis] + box.high[axis]) / 2 for box in self.boxes]
            centre = sum(a * b for a, b in zip(centres, mass, strict=True)) / sum(mass)
            if abs(centre - self.room[axis] / 2) > exact(self.rules.balance) * self.room[axis] / 2:
                yield f"centre along {axis} at {float(centre)}"


def _cross(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _hull(points):
    points = sorted(set(points))
    if len(points) < 3:
        return points
    hull = []
    for some in (points, points[::-1]):
        part = []
        for point in some:
            while len(part) > 1 and _cross(part[-2], part[-1], point) <= 0:
                part.pop()
            part.append(point)
        hull += part[:-1]
    return hull


def _inside(polygon, point):
    if len(polygon) < 3:
        return False
    return all(_cross(a, b, point) >= 0 for a, b in zip(polygon, polygon[1:] + polygon[:1]))  # noqa: B905


def _clipped(polygon, x, y):
    """The corners of a convex polygon's part within a rectangle."""
    for axis, end, way in ((0, x[0], 1), (0, x[1], -1), (1, y[0], 1), (1, y[1], -1)):
        new = []
        for a, b in zip(polygon, polygon[1:] + polygon[:1]):  # noqa: B905
            if way * (a[axis] - end) >= 0:
                new.append(a)
            if (a[axis] - end) * (b[axis] - end) < 0:
                part = (end - a[axis]) / (b[axis] - a[axis])
                new.append(tuple(p + part * (q - p) for p, q in zip(a, b, strict=True)))
        polygon = new
        if not polygon:
            return []
    return polygon
