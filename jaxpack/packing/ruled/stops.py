"""What comes out at a later stop is in the way of nothing that comes out before."""

import numpy as np

from jaxpack.model.asked import LAST
from jaxpack.model.encoding import Loading
from jaxpack.packing.ruled.door import before_door
from jaxpack.packing.ruled.load import BoxRule
from jaxpack.packing.ruled.places import Places


class Stops(BoxRule):
    """See `ItemLimits.stop`. What is loaded later is above or nearer to the door."""

    @staticmethod
    def asked(loading: Loading) -> bool:
        """Where there are stops."""
        return bool((loading.asked.stop < LAST).any())

    def allows(self, at: Places, needed: int) -> np.ndarray:
        """Whether it is above nothing, and before nothing, of an earlier stop."""
        load = self.load
        items, stop = slice(load.fixed, load.count), load.asked.stop
        earlier = stop[load.item[items]] < stop[at.item]
        in_the_way = at.over[:, items]
        if load.loading.rules.door:
            behind = load.high[0, items] <= at.low[0][:, None]
            in_the_way = in_the_way | (before_door(at)[:, items] & behind)
        return ~(in_the_way & earlier).any(1)
