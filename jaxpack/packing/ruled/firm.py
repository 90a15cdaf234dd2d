"""An item's centre lies over what stands firm: `stability` is ``centre`` or ``static``.

Of the firm part of a top only a rectangle counts: in every quadrant around the centre of an item
there is a firm contact that reaches out beyond it, and the rectangle that all four span with their
far corners is firm.
"""

import numpy as np

from jaxpack.model.encoding import Loading
from jaxpack.model.rules import MARGIN
from jaxpack.packing.ruled.load import BoxRule, Load
from jaxpack.packing.ruled.places import Places


class Firm(BoxRule):
    """Keeps of every box the firm rectangle of its top."""

    def __init__(self, load: Load) -> None:
        super().__init__(load)
        self.low, self.high = load.low[:2].copy(), load.high[:2].copy()

    @staticmethod
    def asked(loading: Loading) -> bool:
        """Where more than a share of the base is."""
        return loading.rules.firm

    def allows(self, at: Places, needed: int) -> np.ndarray:
        """Whether every quadrant has its contact."""
        quadrants = (self._products(at)[0] > 0).any(3)
        return np.logical_and.reduce(quadrants.reshape(4, -1))

    def add(self, at: Places) -> None:
        """With the largest contact of each quadrant."""
        product, reach = self._products(at)
        best = product[:, :, 0].argmax(2)  # [2, 2]: west and east, south and north
        ends = np.take_along_axis(reach[:, :, :, 0], best[None, :, :, None], 3)[..., 0]
        double = (at.low + at.high)[:2, 0]
        n = self.load.count
        near, far = np.array([(ends[0].min(1)), (ends[1].min(0))]).T
        self.low[:, n], self.high[:, n] = (double - near) // 2, (double + far) // 2

    def _products(self, at: Places) -> tuple[np.ndarray, np.ndarray]:
        """Of every quadrant: reach along x times reach along y of every box, float64
        [2, 2, C, B], 0 if it is not enough; and both, int64 [2 axes, 2, 2, C, B], in half units.
        Of boxes only those that one of the places is on.
        """
        double, lies = (at.low + at.high)[:2, :, None], at.area > 0
        some, lies = at.under[lies.any(0)], lies[:, lies.any(0)]
        low = np.maximum(at.low[:2, :, None], self.low[:, None, some])
        high = np.minimum(at.high[:2, :, None], self.high[:, None, some])
        lies &= (low < high).all(0)
        sides = (at.high - at.low)[:2, :, None]
        reach = np.stack([double - 2 * low, 2 * high - double])  # [far ends, axes, C, B]
        enough = (reach * (MARGIN // 2) >= sides) & lies
        x, y = reach[:, None, 0], reach[None, :, 1]
        product = np.where(enough[:, None, 0] & enough[None, :, 1], x * y.astype(float), 0)
        return product, np.stack(np.broadcast_arrays(x, y))
