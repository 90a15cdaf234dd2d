"""First fit that obeys every rule: for jobs of which more is asked than that items are carried.

Bins are filled one after the other. Items of later stops come first, then they come as the genes
say. Items that have to be in one bin are loaded together, or not into this one.
"""

from collections.abc import Callable

import numpy as np

from jaxpack.model.encoding import Genes, Loading, most_together
from jaxpack.packing.ruled import asked_rules
from jaxpack.packing.ruled.balance import Balance
from jaxpack.packing.ruled.load import Load

Stop = Callable[[], bool]


def pack_by_rules(
    loading: Loading, genes: Genes, stop: Stop, whole: bool
) -> tuple[Genes, np.ndarray, np.ndarray]:
    """(the genes in the order of loading, bin int32 [N], -1 for what was not packed, corner int32
    [N, 3]) by row of the stock.

    Args:
        loading: what is to be packed.
        genes: of one lane.
        stop: asked before every placement.
        whole: whether all is packed once it stops, as it comes: a bin is full then when an item
            finds no place. Otherwise what follows is not packed.
    """
    packing = _Packing(loading, genes, stop, whole)
    bin, corner = np.full(len(genes.order), -1, np.int32), np.zeros((len(genes.order), 3), np.int32)
    order, barren = [], set[int]()
    for slot in genes.pool.tolist():
        kind = int(loading.bins[slot])
        if kind in barren:  # what waits has not changed since nothing of it fitted such a bin
            continue
        if not len(packing.waiting) or (stop() and not whole):
            break
        rows, corners = packing.fill(slot)
        barren = barren | {kind} if not len(rows) else set()
        bin[rows], corner[rows] = slot, corners
        order.append(rows)
    rows = np.concatenate([*order, packing.waiting]).astype(np.int32)
    return genes._replace(order=rows), bin, corner


class _Packing:
    """What waits to be packed, and how one bin after the other is filled with it."""

    def __init__(self, loading: Loading, genes: Genes, stop: Stop, whole: bool) -> None:
        self.loading, self.turn, self.stop, self.whole = loading, genes.turn, stop, whole
        self.rules, self.most = asked_rules(loading), len(genes.order)
        if not loading.asked.overhang:
            self.most = most_together(loading.stock)
        stop_of = loading.asked.stop[loading.items[genes.order]]
        self.waiting = genes.order[np.argsort(-stop_of, kind="stable")]
        lies = loading.stock.sizes[np.arange(len(genes.turn)), genes.turn]
        self.volume = lies.astype(np.float64).prod(1)

    def fill(self, slot: int) -> tuple[np.ndarray, np.ndarray]:
        """(rows of the stock, corners) of what comes into that bin, in the order of loading."""
        rows, corners = self._filled(slot)
        self.waiting = self.waiting[~np.isin(self.waiting, rows)]
        return rows, corners

    def _filled(self, slot: int) -> tuple[np.ndarray, np.ndarray]:
        load = self._loaded(slot, balanced=False)
        if self.loading.rules.balance is None or not load.rows:
            return np.array(load.rows, np.int64), load.corners
        for _ in range(2):
            balance, some = Balance(load), np.arange(load.fixed, load.count)
            by = balance.shift(some)
            if by is not None and (not by.any() or self._holds(load, some, by)):
                break
            load = self._loaded(slot, balanced=True)
        balance, some = Balance(load), np.arange(load.fixed, load.count)
        while len(some):
            by = balance.shift(some)
            if by is not None and (not by.any() or self._holds(load, some, by)):
                rows = np.array(load.rows, np.int64)[some - load.fixed]
                return rows, load.low[:, some].T + by
            some = some[some != balance.worst(some)]
        return np.zeros(0, np.int64), np.zeros((0, 3), np.int64)

    def _holds(self, load: Load, some: np.ndarray, by: np.ndarray) -> bool:
        """Whether these boxes of a load obey the rules when they are shifted."""
        if load.fixed == 1 and not load.asked.overhang:
            return True  # nothing there is tied to a place
        other = Load(self.loading, load.slot, self.rules, len(some))
        for box in some.tolist():
            row = load.rows[box - load.fixed]
            if not other.put(row, int(self.turn[row]), load.low[:, box] + by):
                return False
        return True

    def _loaded(self, slot: int, balanced: bool) -> Load:
        load = Load(self.loading, slot, self.rules, min(self.most, len(self.waiting)))
        if balanced:
            load.prefer = Balance(load).off
        stock, asked, items = self.loading.stock, self.loading.asked, self.loading.items
        no_limit = np.iinfo(stock.limit.dtype).max
        limit, most = int(stock.limit[slot]), int(asked.most_items[load.kind])
        left = np.inf if limit == no_limit else limit
        free = float((load.far - load.near).prod() * load.room[2]) * (1 + 1e-9)
        apart, in_vain = set[int](), dict[tuple[int, int], int]()
        for row in self.waiting.tolist():
            if len(load.rows) >= most or (self.stop() and not self.whole):
                break
            item, turn = int(items[row]), int(self.turn[row])
            weight, volume, code = int(stock.weight[row]), self.volume[row], int(asked.apart[item])
            if weight > left or volume > free or code in apart:
                continue
            if in_vain.get((item, turn)) == load.count:
                continue
            at = load.first(row, turn)
            if at is None:
                in_vain[item, turn] = load.count
                if load.rows and self.stop():
                    break
                continue
            load.add(at, row)
            left, free = left - weight, free - volume
            if code >= 0:
                apart.add(code)
        return load
