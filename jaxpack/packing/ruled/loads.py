"""What rests on an item weighs no more than it carries; weights go down by area of contact."""

import numpy as np

from jaxpack.model.encoding import Loading
from jaxpack.packing.ruled.load import BoxRule, Load, Places

NOISE = 1e-10  # of a limit, that sums of shares may be above it


class Loads(BoxRule):
    """See `ItemLimits.weight_above`."""

    def __init__(self, load: Load) -> None:
        super().__init__(load)
        # Row i: what each box carries of a weight that is put on i, the whole of it on i itself.
        self.carried = np.eye(2 * load.fixed)

    @staticmethod
    def asked(loading: Loading) -> bool:
        """Where an item has a limit."""
        return bool(np.isfinite(loading.asked.above).any())

    def allows(self, at: Places, needed: int) -> np.ndarray:
        """Whether nothing below it has to carry too much."""
        load, asked, n = self.load, self.load.asked, self.load.count
        item = load.item[load.fixed : n]
        bounded = np.flatnonzero(np.isfinite(asked.above[item]))
        if not len(bounded):
            return np.ones(at.low.shape[1], bool)
        above, column = asked.above[item[bounded]], load.fixed + bounded
        table = self.carried[:n, column]
        weight = asked.weight[item]
        now = weight @ table[load.fixed :] - weight[bounded]
        more = asked.weight[at.item] * (_shares(at) @ table[at.under])
        allowed: np.ndarray = (now + more <= above * (1 + NOISE)).all(1)
        return allowed

    def add(self, at: Places) -> None:
        """It passes on what it gets."""
        n = self.load.count
        if n == len(self.carried):
            wider = np.eye(2 * n)
            wider[:n, :n] = self.carried
            self.carried = wider
        self.carried[n, : n + 1] = np.append(_shares(at)[0] @ self.carried[at.under, :n], 1)


def _shares(at: Places) -> np.ndarray:
    """float64 [C, S], of its weight that lies on each of the boxes `under` it."""
    whole = np.maximum(at.area.sum(1, keepdims=True), 1)
    shares: np.ndarray = at.area / whole
    return shares
