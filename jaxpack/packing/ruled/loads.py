"""What rests on an item weighs no more than it carries; weights go down by area of contact."""

import numpy as np

from jaxpack.model.encoding import Loading
from jaxpack.packing.ruled.load import BoxRule, Load
from jaxpack.packing.ruled.places import Places

NOISE = 1e-10  # of a limit, that sums of shares may be above it


class Loads(BoxRule):
    """See `ItemLimits.weight_above`."""

    def __init__(self, load: Load) -> None:
        super().__init__(load)
        # Row i: what each box carries of a weight that is put on i, the whole of it on i itself.
        self.carried = np.eye(2 * load.fixed)
        self.left = np.full(len(load.rest), np.inf)  # what each may carry besides, of `known` boxes
        self.known = load.fixed

    @staticmethod
    def asked(loading: Loading) -> bool:
        """Where an item has a limit."""
        return bool(np.isfinite(loading.asked.above).any())

    def allows(self, at: Places, needed: int) -> np.ndarray:
        """Whether nothing below it has to carry too much."""
        if self.known != self.load.count:  # some were taken out
            self._count_anew()
        more = self.load.asked.weight[at.item] * self._passed_on(at)
        allowed: np.ndarray = (more <= self.left[: self.known]).all(1)
        return allowed

    def add(self, at: Places) -> None:
        """It passes on what it gets."""
        n = self.load.count
        if n == len(self.carried):
            wider = np.eye(2 * n)
            wider[:n, :n] = self.carried
            self.carried = wider
        self.carried[n, : n + 1] = np.append(self._passed_on(at)[0], 1)
        if self.known == n:
            self._count(n, at.item)

    def _count_anew(self) -> None:
        load = self.load
        self.left[: load.fixed] = np.inf
        for box in range(load.fixed, load.count):
            self._count(box, int(load.item[box]))
        self.known = load.count

    def _count(self, box: int, item: int) -> None:
        """That box lies on what is below it."""
        asked = self.load.asked
        self.left[:box] -= asked.weight[item] * self.carried[box, :box]
        self.left[box] = asked.above[item] * (1 + NOISE)
        self.known = box + 1

    def _passed_on(self, at: Places) -> np.ndarray:
        """float64 [C, B], the share of its weight that each box would carry."""
        passed: np.ndarray = _shares(at) @ self.carried[at.under, : self.load.count]
        return passed


def _shares(at: Places) -> np.ndarray:
    """float64 [C, S], of its weight that lies on each of the boxes `under` it."""
    whole = np.maximum(at.area.sum(1, keepdims=True), 1)
    shares: np.ndarray = at.area / whole
    return shares
