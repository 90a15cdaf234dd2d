"""First fit that obeys every rule: for jobs of which more is asked than that items are carried.

Bins are filled one after the other. Items of later stops come first, then they come as the genes
say. Those of a group that fit one bin are loaded together, or not into this one; a larger group
fills bins of its own, until what is left of it fits one.
"""

from collections.abc import Callable, Iterator

import numpy as np

from jaxpack.model.encoding import Genes, Loading, most_together
from jaxpack.packing.ruled import asked_rules
from jaxpack.packing.ruled.balance import Balance
from jaxpack.packing.ruled.filling import RuledBin

FEW = 256  # rows that are looked up together
PATIENCE = 16  # items in a row that find no place when it is late, and a bin is full
Stop = Callable[[], bool]


def pack_by_rules(
    loading: Loading, genes: Genes, stop: Stop, to_end: bool
) -> tuple[Genes, np.ndarray, np.ndarray]:
    """(genes of it, in the order of loading, bin int32 [N], -1 for what was not packed, corner
    int32 [N, 3]) by row of the stock.

    Args:
        loading: what is to be packed.
        genes: of one lane.
        stop: asked before every placement.
        to_end: whether all is packed once it stops, as it comes: at corner points, and a bin is
            full when some items find no place, if there are bins enough. Otherwise what follows is
            not packed.
    """
    packing = Packing(loading, genes, stop, to_end)
    bin, corner = np.full(len(genes.order), -1, np.int32), np.zeros((len(genes.order), 3), np.int32)
    order, barren = list[np.ndarray](), set[int]()
    for number, slot in enumerate(genes.pool.tolist(), 1):
        kind = int(loading.bins[slot])
        if kind in barren:  # what waits has not changed since nothing of it fitted such a bin
            continue
        if not len(packing.waiting) or (stop() and not to_end):
            break
        packing.rest = genes.pool[number:]
        rows, corners = packing.fill(slot)
        packing.take(rows)
        barren = set() if len(rows) else barren | {kind}
        bin[rows], corner[rows] = slot, corners
        order.append(rows)
    rows = np.concatenate([*order, packing.waiting]).astype(np.int32)
    return Genes(rows, packing.turn, genes.pool), bin, corner


class Packing:
    """What waits to be packed, and how one bin after the other is filled with it."""

    def __init__(self, loading: Loading, genes: Genes, stop: Stop, to_end: bool) -> None:
        self.loading, self.turn, self.stop, self.to_end = loading, genes.turn.copy(), stop, to_end
        self.rules, self.most = asked_rules(loading), len(genes.order)
        if not loading.asked.overhang:
            self.most = most_together(loading.stock)
        self.waiting, self.group = genes.order, loading.asked.group[loading.items]
        self.rest = genes.pool[:0]  # bins after this one
        self.stacking = False  # see `Load`
        self.together = set(loading.groups)  # groups of which nothing may be in another bin
        self.arrange(np.arange(len(genes.order)))

    def hurry(self) -> bool:
        """Whether there is no time to look for places everywhere."""
        return self.to_end and self.stop()

    def arrange(self, place: np.ndarray) -> None:
        """Puts what waits in this order, but what is unloaded last before the others.

        Args:
            place: int [n], of `waiting`.
        """
        rows = self.waiting[place]
        stop = self.loading.asked.stop[self.loading.items[rows]]
        self.waiting = rows[np.argsort(-stop, kind="stable")]

    def take(self, rows: np.ndarray) -> None:
        """These rows of the stock do not wait any more."""
        self.waiting = self.waiting[~np.isin(self.waiting, rows)]

    def fill(self, slot: int) -> tuple[np.ndarray, np.ndarray]:
        """(rows of the stock, corners) of what comes into that bin, in the order of loading."""
        full = self._loaded(slot)
        if self.loading.rules.balance is None or not full.load.rows:
            return np.array(full.load.rows, np.int64), full.load.corners
        found = full.in_balance(whole=True)
        if not len(found[0]):
            found = self._loaded(slot, balanced=True).in_balance(whole=False)
        if not len(found[0]):
            found = self._loaded(slot, balanced=True, always=True).in_balance(whole=False)
        return found

    def _loaded(self, slot: int, balanced: bool = False, always: bool = False) -> RuledBin:
        """That bin with what fits it.

        Args:
            slot: of the bin.
            balanced: whether items rather stand where they keep the load in balance.
            always: whether they stand nowhere else.
        """
        most = min(self.most, len(self.waiting))
        bin = RuledBin(self.loading, slot, self.rules, self.turn, most, self.hurry)
        bin.load.stacking = self.stacking
        if balanced:
            bin.load.prefer = Balance(bin.load).off
        if always:
            bin.load.rules.append(Balance(bin.load))
        self._begin(bin)
        in_vain, alike = 0, int((self.loading.bins[self.rest] == bin.load.kind).sum())
        for rows in self._offers(set(bin.load.rows)):
            late = self.stop()
            if late and not self.to_end:
                break
            in_vain = 0 if bin.take_all(rows) else in_vain + 1
            if late and in_vain >= PATIENCE and alike >= len(self.waiting):
                break
        if self.to_end and bin.load.points:
            self._everywhere(bin)
        if not bin.load.rows:  # groups that fitted one bin in another order
            scattered = ~np.isin(self.group[self.waiting], [-1, *self.loading.groups])
            for row in self.waiting[scattered].tolist():
                bin.take(row)
        return bin

    def _everywhere(self, bin: RuledBin) -> None:
        """Once more for what fits no bin after this one: none of it is left out for want of time,
        but where what is packed is chosen by its value.
        """
        stock, loading = self.loading.stock, self.loading
        types = loading.first[np.unique(loading.bins[self.rest])]
        sizes = stock.sizes[self.waiting][:, :, None]
        elsewhere = (sizes <= stock.bins[types]).all(-1).any((1, 2))
        others = {*self.waiting[elsewhere].tolist(), *bin.load.rows}
        for rows in self._offers(set(bin.load.rows)):
            if loading.job.objective == "value" and self.stop():
                return
            if others.isdisjoint(rows):
                bin.take_all(rows, everywhere=True)

    def _offers(self, there: set[int]) -> Iterator[list[int]]:
        """What is loaded together, as it waits, but for these rows and groups that fit no bin."""
        group = self.group[self.waiting]
        if (group < 0).all():
            for start in range(0, len(group), FEW):
                some = self.waiting[start : start + FEW].tolist()
                yield from ([row] for row in some if row not in there)
            return
        seen = {*group.tolist()} - self.together - {-1}
        for row, code in zip(self.waiting.tolist(), group.tolist(), strict=True):
            if row in there or code in seen:
                continue
            if code >= 0:
                seen.add(code)
            yield [row] if code < 0 else self.waiting[group == code].tolist()

    def _begin(self, bin: RuledBin) -> None:
        """Fills the bin from the first group that is more than fits it; of others it is noted that
        what is left of them does fit one bin.
        """
        group = self.group[self.waiting]
        for code in dict.fromkeys(group[group >= 0].tolist()):
            if code in self.together:
                continue
            rows = self.waiting[group == code].tolist()
            taken = 0
            for row in rows:
                if bin.take(row):
                    taken += 1
                elif taken and self.stop():
                    break
            if 0 < taken < len(rows):
                return
            if taken:
                bin.cut(0)
                self.together.add(code)
