"""Items come in through a door at the far end of x, straight along it."""

import numpy as np

from jaxpack.model.encoding import Loading
from jaxpack.packing.ruled.load import BoxRule
from jaxpack.packing.ruled.places import Places


def before_door(at: Places) -> np.ndarray:
    """bool [C, B], whether the y-z faces of an item and of a box share area."""
    load, n = at.load, at.load.count
    shared = at.along[1] > 0
    shared &= at.low[2][:, None] < load.high[2, :n]
    shared &= at.high[2][:, None] > load.low[2, :n]
    return shared


class Door(BoxRule):
    """See `Rules.door`."""

    @staticmethod
    def asked(loading: Loading) -> bool:
        """Where there is one."""
        return loading.rules.door == "x"

    def allows(self, at: Places, needed: int) -> np.ndarray:
        """Whether nothing stands between its place and the door, nor an item over it."""
        load, n = self.load, self.load.count
        beyond = load.low[0, :n] >= at.high[0][:, None]
        there = at.over & (load.rest[:n] > at.low[2][:, None])
        there[:, : load.fixed] &= load.low[2, : load.fixed] < at.high[2][:, None]
        return ~(before_door(at) & beyond | there).any(1)
