"""A bin that is being loaded, as a list of boxes: where an item may stand by all of its rules."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator

import numpy as np

from jaxpack.model.asked import ANY
from jaxpack.model.encoding import Loading
from jaxpack.packing.ruled.places import Places
from jaxpack.packing.ruled.points import Points
from jaxpack.packing.rules import RULES, Positions, rule_named

FIRST, MORE = 32, 8  # places that are looked at first, and how many times as many after them
FEW = 48  # points that are looked at, if it is not to be everywhere
PAIRS = 2**19  # places times boxes that are looked at together


class BoxRule(ABC):
    """A rule in one bin: it says where an item may stand, and keeps what it has to know."""

    def __init__(self, load: "Load") -> None:
        self.load = load

    @staticmethod
    @abstractmethod
    def asked(loading: Loading) -> bool:
        """Whether the job asks for it."""

    @abstractmethod
    def allows(self, at: Places, needed: int) -> np.ndarray:
        """bool [C]; `needed` is the area of the base that has to be carried."""

    def add(self, at: Places) -> None:  # noqa: B027, as many rules have nothing to remember
        """Takes note of an item at the one place, which becomes box number `load.count`."""


class Load:
    """What lies in one bin: the floor, the obstacles, then the items as they were loaded."""

    def __init__(self, loading: Loading, slot: int, rules: list[type[BoxRule]], most: int) -> None:
        """An empty bin, the one in that slot, for so many items at most."""
        self.loading, self.asked, self.slot = loading, loading.asked, slot
        self.kind, stock = int(loading.bins[slot]), loading.stock
        self.room = stock.bins[slot].astype(np.int64)
        taken = self.asked.obstacles[self.kind]
        self.fixed = self.count = 1 + len(taken)
        size = self.fixed + most
        self.low, self.high = np.zeros((3, size), np.int64), np.zeros((3, size), np.int64)
        self.rest = np.zeros(size, np.int64)  # where the base is of what lies on it
        self.item = np.full(size, -1)  # item type, -1 for what is none
        self.rows = list[int]()  # of the stock
        self.low[2, 0], self.high[:2, 0] = -1, self.room[:2]
        self.low[:, 1 : self.fixed], self.high[:, 1 : self.fixed] = taken[:, 0].T, taken[:, 1].T
        self.rest[: self.fixed] = self.high[2, : self.fixed]
        over, self.step = self.asked.overhang, int(stock.step)
        self.near = np.array([over // self.step * -self.step] * 2)
        self.far = self.room[:2] + over
        if loading.flat:
            self.near[1], self.far[1] = 0, 1
        hanging = self.low[2, 1 : self.fixed] if loading.rules.door else ()
        self.ceilings = [ANY, *sorted({int(z) for z in hanging if z > 0})]
        self.prefer: Callable[[Places], np.ndarray] | None = None
        """What an item wants of its place next to that it is low; it may stand at far walls too."""
        self.stacking = False
        """Whether an item rather lies on another one than on the floor."""
        self.points: Points | None = None
        """Where items begin once there are any, unless they are to look everywhere."""
        self.rules = [rule(self) for rule in rules]
        self._lines()

    def _lines(self) -> None:
        """Where items may begin along x and y, and which box is lower than which."""
        n, gap = self.count, self.asked.gap
        ends = self.high[:2, 1:n].copy()
        ends[:, self.fixed - 1 :] += gap
        edges = np.hstack([ends, self.low[:2, : self.fixed]])
        starts = np.hstack([-(-edges // self.step) * self.step, self.near[:, None]])
        self.lines = [np.unique(side) for side in starts]
        if self.loading.flat:
            self.lines[1] = np.zeros(1, np.int64)
        self.rising = np.argsort(self.rest[:n], kind="stable")[1:]  # the floor is everywhere

    def first(self, row: int, turn: int, everywhere: bool = False) -> Places | None:
        """The place that an item takes, None if there is none.

        Args:
            row: of the stock.
            turn: number of its orientation.
            everywhere: whether to look at more than the `points` in any case.
        """
        stock = self.loading.stock
        size = stock.sizes[row, turn].astype(np.int64)
        needed = max(1, int(stock.needed[row, turn]))
        for low, u, v in self._candidates(size, everywhere):
            places = Places(self, int(self.loading.items[row]), low, size)
            if low.shape[1] and (found := self._least(places, self._key(places, u, v), needed)):
                return found
        return None

    def _least(self, places: Places, key: np.ndarray, needed: int) -> Places | None:
        """The one with the least key, int64 [C], that every rule allows."""
        for part in _parts(key, max(FIRST, PAIRS // self.count)):
            some = places.pick(part)
            allowed = np.flatnonzero(self.allows(some, needed))
            if len(allowed):
                best = int(allowed[key[part][allowed].argmin()])
                return some.pick(slice(best, best + 1))
        return None

    def _candidates(
        self, size: np.ndarray, everywhere: bool
    ) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """(places int64 [3, C], numbers of their lines along x and along y, int64 [C] both), what
        takes longer after what does not.
        """
        if self.points:
            yield self._at_points(self.points, size, FEW)
            if everywhere:
                yield self._at_points(self.points, size, PAIRS // self.count)
        if everywhere or not self.points:
            yield self._anywhere(size)

    def _anywhere(self, size: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """On any crossing of lines."""
        x, y = (self._starts(axis, int(size[axis])) for axis in (0, 1))
        found = []
        for ceiling in self.ceilings if len(x) and len(y) else ():
            z = self._resting(x, y, size, ceiling).ravel()
            at = np.flatnonzero(z <= min(ceiling, self.room[2]) - size[2])
            found.append((at, z[at]))
        if not found:
            nothing = np.zeros(0, np.int64)
            return np.zeros((3, 0), np.int64), nothing, nothing
        at, z = (np.concatenate(some) for some in zip(*found, strict=True))
        v, u = np.divmod(at, len(x))
        return np.stack([x[u], y[v], z]), u, v

    def _at_points(
        self, points: Points, size: np.ndarray, most: int
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """At so many points."""
        low = points.lowest(size, most)
        low = low[:, self._reached(Places(self, -1, low, size))]
        u, v = (np.unique(low[axis], return_inverse=True)[1] for axis in (0, 1))
        return low, u, v

    def _reached(self, at: Places) -> np.ndarray:
        """bool [C], whether nothing is in the way from above, unless there is a door."""
        if self.loading.rules.door:
            return np.ones(at.low.shape[1], bool)
        higher = self.rest[: self.count] > at.low[2][:, None]
        reached: np.ndarray = ~(higher & at.over).any(1)
        return reached

    def put(self, row: int, turn: int, corner: np.ndarray) -> bool:
        """Puts an item where it is wanted, int64 [3]; False where it may not stand there."""
        stock = self.loading.stock
        size = stock.sizes[row, turn].astype(np.int64)
        at = Places(self, int(self.loading.items[row]), corner[:, None], size)
        inside = (corner[:2] >= self.near).all() and (at.high[:2, 0] <= self.far).all()
        if not inside or at.high[2, 0] > self.room[2] or not self._reached(at)[0]:
            return False
        if not self.allows(at, max(1, int(stock.needed[row, turn])))[0]:
            return False
        self.add(at, row)
        return True

    def allows(self, places: Places, needed: int) -> np.ndarray:
        """bool [C], whether every rule allows it."""
        count = places.low.shape[1]
        left = np.arange(count)
        for rule in self.rules:
            kept = rule.allows(places, needed)
            if not kept.all():
                left = left[kept]
                if not len(left):
                    break
                places = places.pick(kept)
        allowed = np.zeros(count, bool)
        allowed[left] = True
        return allowed

    def add(self, at: Places, row: int) -> None:
        """Puts an item at the one place."""
        n = self.count
        for rule in self.rules:
            rule.add(at)
        self.low[:, n], self.high[:, n] = at.low[:, 0], at.high[:, 0]
        self.rest[n] = at.high[2, 0] + self.asked.gap * self.loading.flat
        self.item[n] = at.item
        self.rows.append(row)
        self.count += 1
        for axis in range(1 if self.loading.flat else 2):
            start = -(-(self.high[axis, n] + self.asked.gap) // self.step) * self.step
            lines = self.lines[axis]
            place = int(lines.searchsorted(start))
            if place == len(lines) or lines[place] != start:
                self.lines[axis] = _with(lines, place, int(start))
        place = int(self.rest[self.rising].searchsorted(self.rest[n], "right"))
        self.rising = _with(self.rising, place, n)
        if self.points:
            self.points.add(n)

    def cut(self, items: int) -> None:
        """Takes all out again but the first."""
        del self.rows[items:]
        self.count = self.fixed + items
        self._lines()
        self.points = Points(self) if self.points and items else None

    @property
    def crossings(self) -> int:
        """How many there are of lines: everywhere, as far as an item is concerned."""
        return len(self.lines[0]) * len(self.lines[1])

    @property
    def corners(self) -> np.ndarray:
        """int64 [items, 3], units."""
        return self.low[:, self.fixed : self.count].T

    def _starts(self, axis: int, side: int) -> np.ndarray:
        lines, far = self.lines[axis], int(self.far[axis]) - side
        two_sided = self.prefer or (self.fixed > 1 and not self.rows)
        if two_sided and not (axis == 1 and self.loading.flat):
            n = self.count
            before = self.low[axis, 1:n] - side
            before[self.fixed - 1 :] -= self.asked.gap
            middle = (int(self.room[axis]) - side) // 2
            before = np.append(before, [far, middle]) // self.step * self.step
            lines = np.unique(np.concatenate([lines, before[before >= self.near[axis]]]))
        return lines[: np.searchsorted(lines, far, "right")]

    def _resting(self, x: np.ndarray, y: np.ndarray, size: np.ndarray, ceiling: int) -> np.ndarray:
        """int64 [Y, X], how high an item comes to rest on what is below a ceiling."""
        z = np.zeros((len(y), len(x)), np.int64)
        boxes = self.rising[self.rest[self.rising] <= ceiling]
        low, high = self.low[:2, boxes], self.high[:2, boxes]
        left, right = np.searchsorted(x, low[0] - size[0], "right"), np.searchsorted(x, high[0])
        front, back = np.searchsorted(y, low[1] - size[1], "right"), np.searchsorted(y, high[1])
        rows = (left, right, front, back, self.rest[boxes])
        for a, b, c, d, top in zip(*(row.tolist() for row in rows), strict=True):
            z[c:d, a:b] = top  # from the lowest on
        return z

    def _key(self, at: Places, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """int64 [C], the less the rather; u and v are the numbers of the lines along x and y."""
        (x, y, z), rule = at.low, rule_named(self.loading.rules.rule)
        if self.prefer:
            return _rank([x, y, self.prefer(at), z])
        if self.stacking:
            return _rank([x, y, z, z == 0])
        if rule is RULES["lowest"]:
            across, behind = int(u.max()) + 1, int(v.max()) + 1
            if self.loading.rules.door:  # wall by wall, from the far end on
                return (u * (self.room[2] + 1) + z) * behind + v
            return (z * behind + v) * across + u
        length, width, height = (at.high - at.low)[:, 0].tolist()
        room = self.room[0], self.room[1], self.room[2]
        size = length, width, height
        positions = Positions(x, y, z, size, room, lambda: _contact(at), lambda: _waste(at))
        keys = (x, y, *reversed(rule(positions)))
        return _rank([np.broadcast_to(key, z.shape) for key in keys])


def _with(values: np.ndarray, place: int, value: int) -> np.ndarray:
    return np.concatenate([values[:place], [value], values[place:]])


def _rank(keys: list[np.ndarray]) -> np.ndarray:
    """int64 [C], places in the order by these keys, the last one first."""
    place = np.empty(len(keys[0]), np.int64)
    place[np.lexsort(keys)] = np.arange(len(place))
    return place


def _parts(key: np.ndarray, most: int) -> Iterator[np.ndarray]:
    """Where the least keys are, then the next ones, more and more together."""
    rest, count = np.arange(len(key)), FIRST
    while len(rest) > count:
        split = np.argpartition(key[rest], count)
        yield rest[split[:count]]
        rest, count = rest[split[count:]], min(count * MORE, most)
    yield rest


def _contact(at: Places) -> np.ndarray:
    """float64 [C], area of an item's sides at walls and at other items, as in `top_map`."""
    load, n = at.load, at.load.count
    sides = (at.high - at.low)[:, 0].astype(float)
    up = np.minimum(at.high[2][:, None], load.high[2, :n])
    up = np.maximum(up - np.maximum(at.low[2][:, None], load.low[2, :n]), 0)
    sums = np.zeros(at.low.shape[1])
    for axis in (0, 1):
        walls = (at.low[axis] == 0) * 1.0 + (at.high[axis] == load.room[axis])
        touch = (load.high[axis, :n] == at.low[axis][:, None]) * 1.0
        touch += load.low[axis, :n] == at.high[axis][:, None]
        sums += walls * sides[1 - axis] * sides[2]
        sums += (touch * up * np.maximum(at.along[1 - axis], 0)).sum(1)
    return sums


def _waste(at: Places) -> np.ndarray:
    """float64 [C], volume below an item that nothing fills, as in `top_map`."""
    load, n = at.load, at.load.count
    sides = (at.high - at.low)[:, 0].astype(float)
    height = (load.high[2, 1:n] - load.low[2, 1:n]) * 1.0
    area = np.maximum(at.along, 0).prod(0)[:, 1:]
    waste: np.ndarray = at.low[2] * sides[0] * sides[1] - area @ height
    return waste
