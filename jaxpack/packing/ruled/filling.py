"""A bin that is being filled: what lies where, and what all of it together may be."""

from collections.abc import Callable, Sequence

import numpy as np

from jaxpack.model.encoding import Loading
from jaxpack.model.shelves import shelved
from jaxpack.model.units import in_units
from jaxpack.packing.ruled import asked_rules
from jaxpack.packing.ruled.balance import Balance
from jaxpack.packing.ruled.load import BoxRule, Load
from jaxpack.packing.ruled.points import Points

MANY = 2**16  # places that are looked at for one item; where there are more, corner points are


class RuledBin:
    """Takes items where its rules allow them, while it has not too many of them."""

    def __init__(
        self,
        loading: Loading,
        slot: int,
        rules: list[type[BoxRule]],
        turn: np.ndarray,
        most: int,
        hurry: Callable[[], bool] = lambda: False,
    ) -> None:
        """An empty one.

        Args:
            loading: what is packed.
            slot: of the bin.
            rules: of boxes that the job asks for.
            turn: int [N], orientations by row of the stock; `take_shelved` changes them.
            most: items there are at most.
            hurry: whether there is no time to look for places everywhere. From then on items
                begin at the corner `points` of the load, as they do where there are too many.
        """
        self.loading, self.rules, self.turn, self.hurry = loading, rules, turn, hurry
        self.load = load = Load(loading, slot, rules, most)
        stock = loading.stock
        limit = int(stock.limit[slot])
        self.limit = limit if limit < np.iinfo(stock.limit.dtype).max else np.inf
        self.most = int(loading.asked.most_items[load.kind])
        self.space = float((load.far - load.near).prod() * load.room[2]) * (1 + 1e-9)
        self.in_vain = dict[tuple[int, int, bool], int]()
        self.cut(0)

    def cut(self, items: int) -> None:
        """Takes all out again but the first."""
        rows, loading = self.load.rows, self.loading
        if items < len(rows):
            self.load.cut(items)
            self.in_vain.clear()
        self.apart = set(loading.asked.apart[loading.items[rows]].tolist()) - {-1}
        self.left = self.limit - int(loading.stock.weight[rows].sum())
        self.free = self.space - sum(map(self._volume, rows))

    def take(self, row: int, everywhere: bool = False) -> bool:
        """Puts an item at its first place; False if it has none.

        Args:
            row: of the stock.
            everywhere: whether it is looked for at more than the `points` of the load.
        """
        load, loading, turn = self.load, self.loading, int(self.turn[row])
        item = int(loading.items[row])
        weight, code = int(loading.stock.weight[row]), int(loading.asked.apart[item])
        if weight > self.left or self._volume(row) > self.free or code in self.apart:
            return False
        offer = item, turn, everywhere
        if len(load.rows) >= self.most or self.in_vain.get(offer) == load.count:
            return False
        if not load.points and (load.crossings > MANY or self.hurry()):
            load.points = Points(load)
        if not self._first(row, turn, everywhere):
            self.in_vain[offer] = load.count
            return False
        self.left, self.free = self.left - weight, self.free - self._volume(row)
        if code >= 0:
            self.apart.add(code)
        return True

    def _first(self, row: int, turn: int, everywhere: bool) -> bool:
        """At the first of all places. In an empty bin it is turned if it has to be: it might never
        find a place otherwise.
        """
        load = self.load
        for way in (turn, *range(int(self.loading.stock.ways[row]) * (not load.rows))):
            if at := load.first(row, way, everywhere):
                self.turn[row] = way
                load.add(at, row)
                return True
        return False

    def take_all(self, rows: Sequence[int], everywhere: bool = False) -> bool:
        """Puts all of them, or none."""
        before = len(self.load.rows)
        if all(self.take(row, everywhere) for row in rows):
            return True
        group, at_points = not before and len(rows) > 1, bool(self.load.points)
        if len(self.load.rows) > before:
            self.cut(before)
        # A group that fits a bin has to come into an empty one, however long that takes.
        if group and at_points and not everywhere:
            return self.take_all(rows, everywhere=True)
        return group and self.take_shelved(rows)

    def take_shelved(self, rows: Sequence[int]) -> bool:
        """Puts all copies of some items into the empty bin as `shelved` has them, if it has."""
        load, loading = self.load, self.loading
        left, job, items = list(rows), loading.job, loading.items
        kinds = sorted(set(items[left].tolist()))
        if sum(job.items[n].copies for n in kinds) > len(left):
            return False
        for put in shelved(job, kinds, job.bins[load.kind], loading.rules) or ():
            row = next(row for row in left if items[row] == put.item)
            size = job.items[put.item].turned(put.orientation)
            sizes = [job.items[put.item].turned(way) for way in loading.ways[put.item]]
            self.turn[row] = sizes.index(size)
            corner = in_units(put.corner, loading.units.length)
            if not load.put(row, int(self.turn[row]), corner):
                self.cut(0)
                return False
            left.remove(row)
        self.cut(len(load.rows))
        return not left

    def in_balance(self, whole: bool) -> tuple[np.ndarray, np.ndarray]:
        """(rows of the stock, corners) of what is in the bin, shifted so that its centre of mass is
        where it has to be. What is at fault is left out; all is, if the load has to be `whole`.
        """
        load, balance = self.load, Balance(self.load)
        some = np.arange(load.fixed, load.count)
        while len(some):
            by = balance.shift(some)
            if by is not None and (not by.any() or self._holds(some, by)):
                rows = np.array(load.rows, np.int64)[some - load.fixed]
                return rows, load.low[:, some].T + by
            if whole:
                break
            some = some[some != balance.worst(some)]
        return np.zeros(0, np.int64), np.zeros((0, 3), np.int64)

    def _holds(self, some: np.ndarray, by: np.ndarray) -> bool:
        """Whether these boxes obey the rules when they are shifted."""
        load = self.load
        if load.fixed == 1 and not load.asked.overhang:
            return True  # nothing there is tied to a place
        rows = np.array(load.rows)[some - load.fixed]
        corner = np.zeros((len(self.turn), 3), np.int64)
        corner[rows] = load.low[:, some].T + by
        return holds(self.loading, load.slot, rows, self.turn, corner)

    def _volume(self, row: int) -> float:
        x, y, z = self.loading.stock.sizes[row, 0].tolist()
        return float(x * y * z)


def holds(
    loading: Loading, slot: int, rows: np.ndarray, turn: np.ndarray, corner: np.ndarray
) -> bool:
    """Whether items that fit a bin may be where they are in another one, by all of its rules.

    Args:
        loading: what is packed.
        slot: of that other one.
        rows: of the stock, in loading order.
        turn, corner: by row of the stock.
    """
    load = Load(loading, slot, asked_rules(loading), len(rows))
    for row in rows.tolist():
        if not load.put(row, int(turn[row]), corner[row].astype(np.int64)):
            return False
    if len(rows) > loading.asked.most_items[load.kind]:
        return False
    if loading.rules.balance is None:
        return True
    by = Balance(load).shift(np.arange(load.fixed, load.count))
    return by is not None and not by.any()
