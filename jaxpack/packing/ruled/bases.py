"""What an item may lie on at all."""

import numpy as np

from jaxpack.model.encoding import Loading
from jaxpack.packing.ruled.load import BoxRule
from jaxpack.packing.ruled.places import Places


class Bases(BoxRule):
    """See `stackable`, `stack_id` and `floor` of `ItemLimits`, and `Rules.heavy_below`."""

    @staticmethod
    def asked(loading: Loading) -> bool:
        """Where one of these is."""
        asked = loading.asked
        some = not asked.stackable.all() or asked.floor.any() or asked.stack_id.any()
        return bool(some) or loading.rules.heavy_below

    def allows(self, at: Places, needed: int) -> np.ndarray:
        """Whether it lies on none that it must not lie on."""
        load, asked = self.load, self.load.asked
        if asked.floor[at.item]:
            on_floor: np.ndarray = at.low[2] == 0
            return on_floor
        items = at.under >= load.fixed
        under = load.item[at.under[items]]
        wrong = ~asked.stackable[under] | (asked.stack_id[under] != asked.stack_id[at.item])
        if load.loading.rules.heavy_below:
            wrong |= asked.weight[under] < asked.weight[at.item]
        return ~np.any((at.area[:, items] > 0) & wrong, axis=1)
