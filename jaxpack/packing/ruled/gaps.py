"""Items are some way apart: beside each other, and in 2D above each other too."""

import numpy as np

from jaxpack.model.encoding import Loading
from jaxpack.packing.ruled.load import BoxRule
from jaxpack.packing.ruled.places import Places


class Gaps(BoxRule):
    """See `Rules.gap`. Nothing is asked at walls and obstacles."""

    @staticmethod
    def asked(loading: Loading) -> bool:
        """Where there is a gap."""
        return loading.asked.gap > 0

    def allows(self, at: Places, needed: int) -> np.ndarray:
        """Whether no item is too near along all axes."""
        load, gap = self.load, self.load.asked.gap
        items = slice(load.fixed, load.count)
        above = gap if load.loading.flat else 0
        near = (at.along[:, :, items] > -gap).all(0)
        near &= at.low[2][:, None] < load.high[2, items] + above
        near &= at.high[2][:, None] + above > load.low[2, items]
        return ~near.any(1)
