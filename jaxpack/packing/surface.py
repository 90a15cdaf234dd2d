"""What a bin looks like from above: the three functions that every surface has.

A surface is a frozen value, static under jit; what lies in the bins it describes is a state, a
pytree with a trailing batch axis B. `HeightMap` knows cells, `TopFaces` edges in whole units.
"""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.packing.rules import Rule
from jaxpack.xla.programs import largest_of

Triple = tuple[Array, Array, Array]
"""Along x, y and z. Three arrays and not one of [3, *batch]: where a loop slices them from a
stacked array, XLA fuses the slicing into what uses it and runs 60 times slower."""


class Candidates(Protocol):
    """Where one item of every batch member could stand."""

    def first(self, rule: Rule) -> tuple[Triple, Array]:
        """((x, y, z) [B] each, fits bool [B]): the allowed position that the rule prefers."""


class Surface(Protocol):
    """Bins seen from above."""

    @property
    def dtype(self) -> np.dtype:
        """Of lengths."""

    @property
    def flat(self) -> bool:
        """2D: nothing ever lies behind anything."""

    @property
    def most(self) -> int | None:
        """How many items a bin can hold; None: any number."""

    def empty(self, room: Triple) -> Any:
        """The state of empty bins of these sides [B]."""

    def candidates(
        self, state: Any, size: Triple, needed: Array, room: Triple, wanted: Array
    ) -> tuple[Candidates, Any]:
        """Where items of these sides [B] could stand, and the state, which means the same.

        Args:
            state: what lies in the bins.
            size: no larger than the bins.
            needed: [B], area of the footprint that must lie at the resting height.
            room: sides of the bins [B].
            wanted: bool [B], False where nobody looks at the answer.
        """

    def place(
        self, state: Any, size: Triple, corner: Triple, fits: Array, room: Triple, opens: Array
    ) -> Any:
        """The state once the items lie at their corners where they fit; where `opens`, that of an
        empty bin instead.
        """


def least_first(
    keys: Sequence[Array], allowed: Array | None, least: Callable[[Array], Array]
) -> list[Array]:
    """Of the allowed rows the least first key, of those with it the least second, ...: [B] each.

    The largest number of a key's type where none is allowed.

    Args:
        keys: [..., B].
        allowed: bool [..., B]; None: what is not has the largest first key.
        least: array -> its minimum over all axes but the last.
    """
    found: list[Array] = []
    for key in keys:
        none = np.array(largest_of(key.dtype), key.dtype)
        found.append(least(key if allowed is None else jnp.where(allowed, key, none)))
        here = key == found[-1]
        allowed = here if allowed is None else allowed & here
    return found


def before(keys: Sequence[Array], others: Sequence[Array]) -> Array:
    """Whether the first of these keys that differs is less: bool, of their common shape."""
    (one, other), *rest = zip(keys, others, strict=True)
    if not rest:
        return one < other
    return (one < other) | ((one == other) & before(*zip(*rest, strict=True)))
