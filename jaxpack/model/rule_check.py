"""Does a plan keep to the rules of loads? Each is checked from what it says alone.

What lies on what, what is over what and what is too near are found as in `jaxpack.model.box_check`.
Everything is exact but the weight that rests on an item, which is handed down by shares.
"""

from collections import defaultdict
from collections.abc import Iterator
from fractions import Fraction
from functools import cached_property
from operator import mul

import numpy as np

from jaxpack.model.box_check import Ranked, Rule
from jaxpack.model.exact import exact
from jaxpack.model.job import ItemType, Job, Plan
from jaxpack.model.limits import ItemLimits
from jaxpack.model.plan_boxes import Laid
from jaxpack.model.rules import Rules
from jaxpack.model.shelves import fits_one_bin
from jaxpack.model.violations import Violation

ROUNDING = 1e-9  # of a weight that rests on an item, relatively

Pairs = tuple[np.ndarray, np.ndarray]


def rule_violations(job: Job, plan: Plan, rules: Rules, laid: Laid) -> Iterator[Violation]:
    """Every rule of loads that is broken; an item is named once for each that it breaks.

    Args:
        job: items and bins.
        plan: of it, all whose entries name something.
        rules: what holds for every item.
        laid: the boxes of the plan.
    """
    check = _Check(job, plan, rules, laid)
    asked = {name for item in job.items for name in _asked(item.limits)}
    for names, broken in (
        ({"floor"}, check.off_the_floor),
        ({"stackable"}, check.on_what_carries_nothing),
        ({"stack_id"}, check.on_another_stack),
        ({"most_in_stack"}, check.in_high_stacks),
        ({"weight_above"}, check.overloaded),
        ({"stop"}, check.in_the_way),
        ({"apart"}, check.together),
        ({"group"}, check.parted),
    ):
        if names & asked:
            yield from broken()
    yield from check.crowded()
    if rules.gap:
        yield from check.too_near()
    if rules.heavy_below:
        yield from check.on_lighter()
    if rules.balance is not None:
        yield from check.unbalanced(exact(rules.balance))


_NO_LIMITS = vars(ItemLimits())


def _asked(limits: ItemLimits) -> Iterator[str]:
    return (name for name, value in vars(limits).items() if value != _NO_LIMITS[name])


class _Check:
    def __init__(self, job: Job, plan: Plan, rules: Rules, laid: Laid) -> None:
        self.job, self.plan, self.rules, self.laid = job, plan, rules, laid
        self.item, self.boxes = laid.item, laid.boxes
        self.rows = np.flatnonzero(self.item >= 0)  # those of items

    def of_items(self, what: list, obstacles: object = 0) -> np.ndarray:
        """What every item has, by row; that of obstacles."""
        return np.array([*what, obstacles])[self.item]

    def limit(self, name: str, obstacles: object = 0) -> np.ndarray:
        """A limit of every row."""
        return self.of_items([getattr(item.limits, name) for item in self.job.items], obstacles)

    @cached_property
    def weight(self) -> np.ndarray:
        """Of every row: float [n], 0 of an obstacle."""
        return self.of_items([item.weight for item in self.job.items], 0.0)

    @cached_property
    def ranked(self) -> Ranked:
        """The rows with what is to be free over each."""
        return Ranked(self.laid.carrying)

    @cached_property
    def contacts(self) -> Pairs:
        """(rows of items, what each lies on); from the lowest to the highest."""
        found = [(self.rows[of], under) for of, under in self.ranked.touching(self.rows, False)]
        if not found:
            return np.empty(0, int), np.empty(0, int)
        on, under = (np.concatenate(some) for some in zip(*found, strict=True))
        order = np.lexsort((under, on, self.ranked.bottom[on]))
        return on[order], under[order]

    @cached_property
    def item_contacts(self) -> Pairs:
        """The same of items on items."""
        on, under = self.contacts
        of_items = self.item[under] >= 0
        return on[of_items], under[of_items]

    def levels(self, on: np.ndarray) -> list[np.ndarray]:
        """Places in contacts of rows at one height each, from the lowest to the highest."""
        steps = np.flatnonzero(np.diff(self.ranked.bottom[on])) + 1
        return np.split(np.arange(len(on)), steps)

    def violation(self, rule: Rule, row: int, other: int | None = None, **of: object) -> Violation:
        """A record about an item."""
        turn, bin = int(self.laid.turn[row]), int(self.boxes.bin[row])
        at = None if other is None else int(self.laid.turn[other])
        return Violation(rule, bin, int(self.item[row]), turn, at, **of)  # type: ignore[arg-type]

    def lying(self, rule: Rule, broken: np.ndarray) -> Iterator[Violation]:
        """A record of every item that lies on one that it must not, by `item_contacts`."""
        on, under = (rows[broken] for rows in self.item_contacts)
        order = np.lexsort((under, on))
        rows, first = np.unique(on[order], return_index=True)
        for row, other in zip(rows.tolist(), under[order][first].tolist(), strict=True):
            yield self.violation(rule, row, other)

    def off_the_floor(self) -> Iterator[Violation]:
        """What stands higher than the floor and must not."""
        low = self.boxes.low[:, 2]
        for row in np.flatnonzero(self.limit("floor", False) & (low != 0).astype(bool)).tolist():
            found = float(int(low[row]) * self.laid.units[2])
            yield self.violation(Rule.ON_FLOOR, row, found=found, allowed=0.0, amount=abs(found))

    def on_what_carries_nothing(self) -> Iterator[Violation]:
        """What lies on an item that nothing may lie on."""
        _, under = self.item_contacts
        return self.lying(Rule.STACKABLE, ~self.limit("stackable", True)[under])

    def on_another_stack(self) -> Iterator[Violation]:
        """What lies on an item of another stack id."""
        on, under = self.item_contacts
        ids = [item.limits.stack_id for item in self.job.items]
        known = {one: number for number, one in enumerate(dict.fromkeys(ids))}
        stack = self.of_items([known[one] for one in ids])
        return self.lying(Rule.STACK_ID, stack[on] != stack[under])

    def on_lighter(self) -> Iterator[Violation]:
        """What lies on a lighter item."""
        on, under = self.item_contacts
        for one in self.lying(Rule.HEAVY_BELOW, self.weight[on] > self.weight[under]):
            assert one.bin is not None
            below = self.plan.bins[one.bin].placements[one.other or 0].item
            found, allowed = (self.job.items[n].weight for n in (one.item or 0, below))
            yield one._replace(found=found, allowed=allowed, amount=found - allowed)

    def in_high_stacks(self) -> Iterator[Violation]:
        """What is in a chain of too many items, each lying on the next."""
        on, under = self.item_contacts
        below, above = np.ones(len(self.item), int), np.ones(len(self.item), int)
        levels = self.levels(on)
        for part in levels:
            np.maximum.at(below, on[part], below[under[part]] + 1)
        for part in reversed(levels):
            np.maximum.at(above, under[part], above[on[part]] + 1)
        most = [item.limits.most_in_stack or self.job.count for item in self.job.items]
        limit = self.of_items(most, len(self.item) + 1)
        stack = below + above - 1
        for row in np.flatnonzero(stack > limit).tolist():
            found, allowed = int(stack[row]), int(limit[row])
            amount = found - allowed
            yield self.violation(Rule.STACK, row, found=found, allowed=allowed, amount=amount)

    def overloaded(self) -> Iterator[Violation]:
        """What more rests on than may, by shares of the area of contact."""
        on, under = self.contacts
        low, high = (leaf[:, :2].astype(float) for leaf in (self.boxes.low, self.boxes.high))
        shared = np.minimum(high[on], high[under]) - np.maximum(low[on], low[under])
        area = shared[:, 0] * shared[:, 1]
        share = area / np.bincount(on, area, len(self.item))[on]
        load = np.zeros(len(self.item))
        for part in reversed(self.levels(on)):
            passed = share[part] * (self.weight[on[part]] + load[on[part]])
            np.add.at(load, under[part], passed)
        limit = self.limit("weight_above", np.inf)
        for row in np.flatnonzero(load > limit * (1 + ROUNDING)).tolist():
            found, allowed = float(load[row]), float(limit[row])
            amount = found - allowed
            yield self.violation(
                Rule.WEIGHT_ABOVE, row, found=found, allowed=allowed, amount=amount
            )

    def in_the_way(self) -> Iterator[Violation]:
        """What is unloaded before something over it, or between it and the door."""
        stops = [item.limits.stop for item in self.job.items]
        order = sorted({stop for stop in stops if stop})
        places: dict[int | None, int] = {stop: place for place, stop in enumerate(order)}
        rank = self.of_items([places.get(stop, len(order)) for stop in stops], -1)
        rank = rank.astype(np.int32)
        asked = np.flatnonzero((rank >= 0) & (rank < len(order)))
        ranked = Ranked(self.boxes)
        later = rank, rank
        over = ranked.first(asked, [*ranked.plane, (ranked.top - 1, ranked.bottom), later], False)
        if self.rules.door:
            beside = ranked.first(asked, [*ranked.beyond, later], False)
            over = np.where(over < 0, beside, over)
        met = over >= 0
        for row, other in zip(asked[met].tolist(), over[met].tolist(), strict=True):
            found, allowed = stops[self.item[row]], stops[self.item[other]]
            yield self.violation(Rule.STOP, row, other, found=found, allowed=allowed)

    def too_near(self) -> Iterator[Violation]:
        """What is nearer than the gap to an item that was loaded earlier, and shares no room."""
        some = self.boxes._replace(
            **{name: leaf[self.rows] for name, leaf in self.boxes._asdict().items()}
        )
        spacing = np.array(self.laid.spacing)
        wide = Ranked(some._replace(high=some.high + spacing))
        others = wide.first(np.arange(len(self.rows)), [*wide.plane, *wide.level])
        for row in np.flatnonzero(others >= 0).tolist():
            other = int(others[row])
            between = np.maximum(some.low[row] - some.high[other], some.low[other] - some.high[row])
            if (between < 0).all():
                continue
            axes = [axis for axis in range(3) if spacing[axis]]
            axis = max(axes, key=lambda axis: between[axis])
            found = max(0.0, float(int(between[axis]) * self.laid.units[axis]))
            yield self.violation(
                Rule.GAP,
                int(self.rows[row]),
                int(self.rows[other]),
                what="xyz"[axis],
                found=found,
                allowed=self.rules.gap,
                amount=self.rules.gap - found,
            )

    def crowded(self) -> Iterator[Violation]:
        """Bins with more items than they take."""
        for number, packed in enumerate(self.plan.bins):
            most, found = self.job.bins[packed.bin].limits.most_items, len(packed.placements)
            if most is not None and found > most:
                yield Violation(Rule.ITEMS, number, found=found, allowed=most, amount=found - most)

    def together(self) -> Iterator[Violation]:
        """Items that are to be apart and in one bin."""
        for number, packed in enumerate(self.plan.bins):
            first = dict[str, int]()
            for turn, put in enumerate(packed.placements):
                name = self.job.items[put.item].limits.apart
                if name and (other := first.setdefault(name, turn)) != turn:
                    yield Violation(Rule.APART, number, put.item, turn, other, name)

    def parted(self) -> Iterator[Violation]:
        """Groups that are in several bins and fit one."""
        bins = defaultdict[str, dict[int, None]](dict)
        for number, packed in enumerate(self.plan.bins):
            for put in packed.placements:
                if group := self.job.items[put.item].limits.group:
                    bins[group][number] = None
        items = defaultdict[str, list[int]](list)
        for n, item in enumerate(self.job.items):
            items[item.limits.group].append(n)
        kinds = [kind for kind in self.job.bins if kind.copies != 0]
        for group, several in bins.items():
            found = len(several)
            if found > 1 and any(
                fits_one_bin(self.job, items[group], kind, self.rules) for kind in kinds
            ):
                yield Violation(Rule.GROUP, what=group, found=found, allowed=1, amount=found - 1)

    def unbalanced(self, share: Fraction) -> Iterator[Violation]:
        """Bins whose load's centre of mass is not over the middle share of the floor."""
        mass, bins = self._masses(), self.boxes.bin[self.rows]
        for rows in np.split(self.rows, np.flatnonzero(np.diff(bins)) + 1):
            number = int(self.boxes.bin[rows[0]])
            masses = [mass[item] for item in self.item[rows].tolist()]
            if not (total := sum(masses, Fraction(0))):
                continue
            for axis in self.job.axes[:-1]:
                side = exact(self.job.bins[self.plan.bins[number].bin].size[axis])
                ends = (self.boxes.low + self.boxes.high)[rows, axis].tolist()
                moment = sum(map(mul, masses, ends), Fraction(0))
                found = moment * self.laid.units[axis] / total / 2
                if abs(2 * found - side) > share * side:
                    allowed = side * (1 + (share if 2 * found > side else -share)) / 2
                    figures = float(found), float(allowed), float(abs(found - allowed))
                    yield Violation(Rule.BALANCE, number, None, None, None, "xyz"[axis], *figures)

    def _masses(self) -> list[Fraction]:
        """Of every item type: its weight, or its volume where nothing has one."""
        items = self.job.items
        if any(item.weight for item in items):
            return [exact(item.weight) for item in items]
        return [_volume(item) for item in items]


def _volume(item: ItemType) -> Fraction:
    x, y, z = map(exact, item.size)
    return x * y * z
