"""Places that an item may take in a bin, and how it would lie there."""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from jaxpack.packing.ruled.load import Load


class Places:
    """C places of one item, and how it would lie there among the B boxes of a bin, on S of them."""

    def __init__(self, load: "Load", item: int, low: np.ndarray, size: np.ndarray) -> None:
        """Of an item type, with corners [3, C] and sides [3], units."""
        self.load, self.item, self.low = load, item, low
        self.high = low + size[:, None]

    @cached_property
    def along(self) -> np.ndarray:
        """int64 [2, C, B], lengths that footprints share along x and y, less than 0 if apart."""
        load, n = self.load, self.load.count
        ends = np.minimum(self.high[:2, :, None], load.high[:2, None, :n])
        ends -= np.maximum(self.low[:2, :, None], load.low[:2, None, :n])
        return ends

    @cached_property
    def over(self) -> np.ndarray:
        """bool [C, B], whether footprints share area: it stands above all that they do with."""
        along = self.along
        over: np.ndarray = (along[0] > 0) & (along[1] > 0)
        return over

    @cached_property
    def under(self) -> np.ndarray:
        """int [S], ascending, boxes: all that it may lie on at one of the places, few of all."""
        load, n = self.load, self.load.count
        near = (load.rest[:n] >= self.low[2].min()) & (load.rest[:n] <= self.low[2].max())
        for axis in (0, 1):
            near &= load.low[axis, :n] < self.high[axis].max()
            near &= load.high[axis, :n] > self.low[axis].min()
        return np.flatnonzero(near)

    @cached_property
    def area(self) -> np.ndarray:
        """int64 [C, S], of its base that lies on each of those that may be `under` it."""
        load, some = self.load, self.under
        x, y = (
            np.minimum(self.high[axis][:, None], load.high[axis, some])
            - np.maximum(self.low[axis][:, None], load.low[axis, some])
            for axis in (0, 1)
        )
        lies = (x > 0) & (y > 0) & (load.rest[some] == self.low[2][:, None])
        area: np.ndarray = x * y * lies
        return area

    def pick(self, some: slice | np.ndarray) -> "Places":
        """Some of them alone, with what is known of them."""
        picked = Places(self.load, self.item, self.low[:, some], (self.high - self.low)[:, 0])
        known = vars(self)
        for name in ("over", "area"):
            if name in known:
                vars(picked)[name] = known[name][some]
        if "under" in known:
            vars(picked)["under"] = known["under"]
        if "along" in known:
            vars(picked)["along"] = known["along"][:, some]
        return picked
