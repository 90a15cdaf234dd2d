"""So much of an item's base is carried by what is directly under it."""

import numpy as np

from jaxpack.model.encoding import Loading
from jaxpack.packing.ruled.load import BoxRule
from jaxpack.packing.ruled.places import Places


class Support(BoxRule):
    """See `Rules.support`; and nothing floats."""

    @staticmethod
    def asked(loading: Loading) -> bool:
        """Always."""
        return True

    def allows(self, at: Places, needed: int) -> np.ndarray:
        """By the area of contact."""
        carried: np.ndarray = at.area.sum(1) >= needed
        return carried
