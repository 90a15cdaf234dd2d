"""The centre of mass of what is in a bin lies in the middle of its floor."""

import numpy as np

from jaxpack.model.encoding import Loading
from jaxpack.packing.ruled.load import BoxRule, Load
from jaxpack.packing.ruled.places import Places

NOISE = 1e-12  # of a side


class Balance(BoxRule):
    """See `Rules.balance`: the load of one bin is shifted, or loses items, until it holds."""

    def __init__(self, load: Load) -> None:
        super().__init__(load)
        share = load.loading.rules.balance
        assert share is not None
        axes = [0] if load.loading.flat else [0, 1]
        self.axes, self.middle = axes, load.room[axes] / 2
        self.most = self.middle * (share - NOISE)

    @staticmethod
    def asked(loading: Loading) -> bool:
        """Not while a bin is filled, if it need not be."""
        return False

    def allows(self, at: Places, needed: int) -> np.ndarray:
        """Whether the load is in balance with the item."""
        return self.off(at) == 0

    def off(self, at: Places) -> np.ndarray:
        """float64 [C], how far outside the centre is with the item at each place, 1 for as much as
        is allowed.
        """
        load = self.load
        mass = load.asked.mass[load.item[load.fixed : load.count]]
        ends = (load.low + load.high)[self.axes, load.fixed : load.count] / 2
        own = max(float(load.asked.mass[at.item]), 1e-300)
        centre = ends @ mass
        centres = (centre[:, None] + own * (at.low + at.high)[self.axes] / 2) / (mass.sum() + own)
        beyond = abs(centres - self.middle[:, None]) / np.maximum(self.most, 1e-9)[:, None]
        off: np.ndarray = np.maximum(beyond - 1, 0).sum(0)
        return off

    def shift(self, some: np.ndarray) -> np.ndarray | None:
        """By how much, int64 [3], these boxes are shifted at least to be in balance; None if there
        is no room for that.
        """
        load, by = self.load, np.zeros(3, np.int64)
        off = self._off(some)
        for number, axis in enumerate(self.axes):
            low = load.near[axis] - load.low[axis, some].min()
            high = load.far[axis] - load.high[axis, some].max()
            least, most = -off[number] - self.most[number], -off[number] + self.most[number]
            step = load.step
            at_least = max(-(-low // step), int(np.ceil(least / step))) * step
            at_most = min(high // step, int(np.floor(most / step))) * step
            if at_least > at_most:
                return None
            by[axis] = min(max(0, at_least), at_most)
        return by

    def worst(self, some: np.ndarray) -> int:
        """Which of these boxes has to go: the last one on the heavy side with nothing on it."""
        load, off = self.load, self._off(some)
        number = int((abs(off) - self.most).argmax())
        axis, sign = self.axes[number], np.sign(off[number])
        top = np.array([not self._carries(box, some) for box in some.tolist()])
        far = sign * ((load.low + load.high)[axis, some] / 2 - self.middle[number])
        heavy = some[top & (far > 0)]
        return int(heavy[-1]) if len(heavy) else int(some[top][-1])

    def _off(self, some: np.ndarray) -> np.ndarray:
        """float64 [axes], where the centre of mass is, from the middle."""
        load = self.load
        mass = load.asked.mass[load.item[some]]
        if not mass.any():
            mass = (load.high - load.low)[:, some].prod(0).astype(float)
        centre: np.ndarray = (load.low + load.high)[self.axes][:, some] / 2 @ mass / mass.sum()
        return centre - self.middle

    def _carries(self, box: int, some: np.ndarray) -> bool:
        low, high = self.load.low, self.load.high
        above = (low[:2, some] < high[:2, [box]]) & (high[:2, some] > low[:2, [box]])
        return bool((above.all(0) & (low[2, some] >= high[2, box])).any())
