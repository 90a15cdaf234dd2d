"""What a policy can see of a bin: where every choice would stand, and what it would touch there.

A view is to `env` what a surface is to `decode`. It is a frozen value, static under jit; what lies
in the bins is a state, a pytree with a trailing batch axis B. K rows are looked at side by side:
what could be placed next, every kind in every orientation. `Table` sees a height map, `SurfaceView`
any surface. Lengths are cells or units, whichever the surface has.
"""

from typing import Any, NamedTuple, Protocol

import numpy as np
from jax import Array

from jaxpack.packing.surface import Triple

LEVELS = 10
"""Into so many the height of a bin is divided."""


class Surroundings(NamedTuple):
    """What lies under and beside an item at rest: numbers [K, B]."""

    under: Array  # sum of the height map under the footprint
    left: Array  # sum of the height map along each side, a wall counts as the bin's height
    right: Array
    front: Array
    back: Array
    gap_left: Array  # along the row or column of the corner until something higher than z
    gap_right: Array
    gap_front: Array
    gap_back: Array


class Candidates(NamedTuple):
    """Where the position rule puts an item of every row, above the ceiling too.

    Where there is no position at all, z is the largest number of its type.
    """

    fits: Array  # bool [K, B], there is a position for it under the ceiling
    corner: Triple  # [K, B] each, of the surface's type
    supported: Array  # [K, B], area of the footprint at height z
    level: Array  # [K, B], area of the bin that is as high as the item's top
    around: Surroundings


class Outline(NamedTuple):
    """The current bin from above."""

    highest: Array  # [B]
    volume: Array  # [B], sum of the height map
    levels: Array  # [LEVELS, B], area by tenths of the bin's height; what is full up is in none


class Places(NamedTuple):
    """All positions for one item of every batch member."""

    x: Array  # [X, 1, B], of the corner
    y: Array  # [1, Y, B]
    z: Array  # [X, Y, B], where the item comes to rest
    allowed: Array  # bool [X, Y, B], inside the bin and supported there


class View(Protocol):
    """A surface and a position rule as `env` needs them. Bins are int32 [3, B]: their sides."""

    @property
    def dtype(self) -> np.dtype:
        """Of lengths."""

    @property
    def lanes(self) -> int:
        """How many batch members a CPU should work on at once."""

    @property
    def rules(self) -> int:
        """How many position rules there are to choose among; the first is the problem's."""

    @property
    def cells(self) -> tuple[int, int, int] | None:
        """The most units along each axis where these are few enough to count through."""

    def largest(self, bins: Array) -> Array:
        """Sides of the largest item that can be placed: int32 [3, B]."""

    def empty(self, bins: Array) -> Any:
        """The state of empty bins."""

    def corners(self, state: Any, bins: Array, sides: Triple) -> tuple[Triple, Array]:
        """`corner` and `fits` of the candidates of rows [K, B], by the first rule."""

    def look(self, state: Any, bins: Array, sides: Triple, rule: int = 0) -> Candidates:
        """The candidates of rows with these sides [K, B] each; 0 for padding. By that rule."""

    def outline(self, state: Any, bins: Array) -> Outline:
        """What all rows have in common."""

    def places(self, state: Any, bins: Array, size: Triple) -> Places:
        """All positions, whatever the rule, for an item with these sides [B] each."""

    def place(self, state: Any, bins: Array, size: Triple, corner: Triple, fits: Array) -> Any:
        """The state once items with these sides [B] lie at these corners, where `fits`."""
