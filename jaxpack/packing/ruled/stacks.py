"""So many items lie on top of each other at most."""

import numpy as np

from jaxpack.model.asked import ANY
from jaxpack.model.encoding import Loading
from jaxpack.packing.ruled.load import BoxRule, Load
from jaxpack.packing.ruled.places import Places


class Stacks(BoxRule):
    """See `ItemLimits.most_in_stack`."""

    def __init__(self, load: Load) -> None:
        super().__init__(load)
        size = len(load.rest)
        self.depth = np.zeros(size, np.int64)  # items from the floor up to it
        self.more = np.full(size, ANY)  # that may lie on it, one on the other

    @staticmethod
    def asked(loading: Loading) -> bool:
        """Where an item has a limit."""
        return bool((loading.asked.most_in_stack < ANY).any())

    def allows(self, at: Places, needed: int) -> np.ndarray:
        """Whether neither it nor anything below it is in too high a stack."""
        depth, more = self._with(at)
        return (depth <= self.load.asked.most_in_stack[at.item]) & (more >= 0)

    def add(self, at: Places) -> None:
        """One more on those below."""
        n, most = self.load.count, int(self.load.asked.most_in_stack[at.item])
        depth, more = self._with(at)
        self.depth[n], self.more[n] = depth[0], min(more[0], most - depth[0])

    def _with(self, at: Places) -> tuple[np.ndarray, np.ndarray]:
        """(items from the floor up to it, how many more those below it allow), int64 [C] both."""
        lies = at.area > 0
        depth = 1 + np.where(lies, self.depth[at.under], 0).max(1, initial=0)
        return depth, np.where(lies, self.more[at.under], ANY).min(1, initial=ANY) - 1
