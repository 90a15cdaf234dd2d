"""What is packed, under which rules, and what comes out: the types and the glossary.

Axes, used in every docstring of the package:

| letter  | axis                                                             |
|---------|------------------------------------------------------------------|
| B       | batch of instances                                               |
| S       | samples or seeds                                                 |
| N       | items of an instance, padding included                           |
| P       | population of a genetic algorithm                                |
| L, W, H | cells of the bin along x (length), y (width) and z (height)      |
| D       | features of a network                                            |

Lengths are whole cells, or whole units such as millimetres where `Problem.surface` is ``faces``.
2D is 3D with ``W = 1``: an item is ``(l, 1, h)``. A bin slot is one of N places for the bins of a
packing: N items never need more than N bins.
"""

import reprlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from numbers import Real
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxpack.errors import UserError

MOST_CELLS = 1 << 20
"""Of a height map."""
MOST_UNITS = 2**14 - 2
"""A side of a bin without a grid, of which sums fit int16."""


@dataclass(frozen=True)
class Problem:
    """The rules that stay fixed while a program runs: hashable, a static argument of ``jit``.

    Attributes:
        bin: (L, W, H) in cells, the height map's extent, or in units. An instance may use a
            smaller bin.
        largest: (length, width) in cells of the largest item; larger items never fit. A tight
            bound makes placement faster. None: as large as the bin.
        support: share of an item's footprint that must rest at the item's own height, 0 to 1.
        inclusive: whether exactly that share is enough ("at least") or not ("more than").
        stability: what else carries an item, see `Rules.stability`: ``share``, nothing, or, of
            faces, ``centre``.
        rule: which of the allowed positions an item takes, a name in `jaxpack.packing.rules`.
        surface: ``cells``, a height map, or ``faces``, without a grid: what a packing costs depends
            on the number of items and not on that of units.
        most: of faces, how many items a bin takes at most.

    Raises:
        UserError: where a side is not whole, there are too many cells or units, the share is none,
            the surface or the stability is not known, or `most` is missing.
    """

    bin: tuple[int, int, int]
    largest: tuple[int, int] | None = None
    support: float = 0.5
    inclusive: bool = True
    rule: str = "lowest"
    surface: str = "cells"
    most: int | None = None
    stability: str = "share"

    def __post_init__(self) -> None:
        check_bin(self.bin, self.surface)
        if self.surface == "faces" and not (type(self.most) is int and self.most >= 1):
            raise UserError(f"most {self.most}: give the most items that a bin takes, at least 1")
        if self.largest is not None and not _whole_sides(self.largest, 2):
            raise UserError(f"largest {self.largest}: give a whole length and width, or None")
        if not 0 <= self.support <= 1:
            raise UserError(f"support {self.support}: give a share from 0 to 1")
        known = ("share", "centre") if self.surface == "faces" else ("share",)
        if self.stability not in known:
            where = f"of {self.surface} there is {' and '.join(known)}"
            raise UserError(f"stability {self.stability!r}: {where}")

    @property
    def window(self) -> tuple[int, int]:
        """(length, width) in cells of the largest footprint that the kernel looks under."""
        largest = self.largest or self.bin[:2]
        return min(largest[0], self.bin[0]), min(largest[1], self.bin[1])

    @property
    def axes(self) -> tuple[int, ...]:
        """The axes in which items differ: those along which the bin has more than one cell."""
        return tuple(axis for axis in range(3) if self.bin[axis] > 1)

    def resized(self, bin: tuple[int, int, int], high: int) -> "Problem":
        """The same rules for a bin (flat axes stay flat) and items with sides up to `high`."""
        sides = [side if axis in self.axes else 1 for axis, side in enumerate(bin)]
        if any(sides[axis] < 2 for axis in self.axes):
            raise UserError(f"bin {tuple(sides)}: give a side of at least 2 cells")
        largest = [high if axis in self.axes else 1 for axis in range(2)]
        return replace(self, bin=(sides[0], sides[1], sides[2]), largest=(largest[0], largest[1]))

    def cells_needed(self, area: Array) -> Array:
        """Cells that must support a footprint of ``area`` cells; see `area_needed`."""
        return area_needed(self.support, self.inclusive, area)


def area_needed(support: float, inclusive: bool, area: Array) -> Array:
    """The least area, in whole units, that is (more than) a share of ``area``: int32 [...].

    Exact, in integers; the share is taken to four digits.
    """
    share = Fraction(support).limit_denominator(10_000)
    # Whole multiples of the denominator apart: area * numerator may not fit 32 bits.
    whole, rest = jnp.divmod(area, share.denominator)
    scaled = rest * share.numerator
    if inclusive:
        return whole * share.numerator - (-scaled // share.denominator)
    return whole * share.numerator + scaled // share.denominator + 1


class Instance(NamedTuple):
    """Items to pack and the bin they go into. Leading batch axes are added by ``vmap``."""

    size: Array  # int32[N, 3], cells: (length, width, height) of each item
    mask: Array  # bool[N], False for padding, which is never placed and never counted
    bin: Array  # int32[3], cells: the bin, no larger than Problem.bin in any side
    # int32[N, O, 3], cells: the item in every orientation that it may have; equal ones count as
    # one. Who packs it chooses, see `in_orientation`. None: it stays as `size` has it.
    turned: Array | None = None


def in_orientation(instance: Instance, orientation: Array) -> Instance:
    """The instance with every item turned as chosen, and no choice left.

    Args:
        orientation: int32 [N], index along O of `Instance.turned`; ignored where it is None.
    """
    if instance.turned is None:
        return instance
    chosen = jnp.take_along_axis(instance.turned, orientation[:, None, None], 1)[:, 0]
    return instance._replace(size=chosen, turned=None)


SIDES = ("length", "width", "height")


class Packing(NamedTuple):
    """Where every item went, and what the metrics need to know of every bin."""

    bin: Array  # int32[N], bin of each item from 0; -1 for padding and for items that fit no bin
    position: Array  # int32[N, 3], cells: (x, y, z) of the front-bottom-left corner
    volume: Array  # int32[N], cells: volume of the items in each bin slot, 0 if the slot is empty
    top: Array  # int32[N], cells: highest point of each bin slot
    shadow: Array  # int32[N], cells: sum of the height map of each bin slot


def check_bin(bin: tuple[int, ...], surface: str = "cells") -> None:
    """Raises UserError where `bin` is not (L, W, H) of which this package can keep count.

    In cells heights are below 2^15 - 1 and the plane has at most 2^20; in units (of faces) a side
    is below 2^14 - 1. The volume is below 2^31: what is summed up over a bin (volumes, the height
    map) is then within int32.
    """
    if surface not in ("cells", "faces"):
        raise UserError(f"surface '{surface}': choose cells or faces")
    if not _whole_sides(bin, 3):
        raise UserError(f"bin {bin}: give three whole sides of at least 1 cell")
    length, width, height = bin
    volume = ("volume", length * width * height, np.iinfo(np.int32).max)
    if surface == "faces":
        limits = [("longest side", max(bin), MOST_UNITS), volume]
    else:
        plane = ("length times width", length * width, MOST_CELLS)
        limits = [("height", height, np.iinfo(np.int16).max - 1), plane, volume]
    what, remedy = ("units", "unit") if surface == "faces" else ("cells", "grid")
    for name, found, most in limits:
        if found > most:
            raise UserError(
                f"bin {bin}: too many {what}, its {name} is {found:,} and may be at most "
                f"{most:,}; use a coarser {remedy}"
            )


def _whole_sides(sides: object, count: int) -> bool:
    return (
        isinstance(sides, tuple)
        and len(sides) == count
        and all(type(side) is int and side >= 1 for side in sides)
    )


def _numbers(table: np.ndarray, axes: Sequence[int]) -> np.ndarray:
    """The table as integers or floats. UserError naming the first item that is something else."""
    if table.dtype.kind in "iuf":
        return table
    numbers = np.empty(table.shape)
    for (item, column), value in np.ndenumerate(table.astype(object)):
        if isinstance(value, bool) or not isinstance(value, Real):
            raise UserError(
                f"item {item}: {SIDES[axes[column]]} {reprlib.repr(value)} is not a number: give "
                "whole numbers of cells"
            )
        try:
            numbers[item, column] = value
        except OverflowError:
            numbers[item, column] = np.inf
    return numbers


def make_instance(problem: Problem, sizes: ArrayLike) -> Instance:
    """An instance without padding from a table of sizes, checked.

    Args:
        problem: the rules; its bin is the instance's bin.
        sizes: whole numbers [N, 3] (length, width, height), or [N, 2] (length, height) in 2D.

    Raises:
        UserError: naming the first item (row) that is not whole, not positive or too large.
    """
    try:
        table = np.asarray(sizes)
    except ValueError:
        raise UserError("sizes: the rows are not all of the same length") from None
    if len(np.atleast_1d(table)) == 0:
        raise UserError("the instance has no items: give at least one")
    columns = len(problem.axes)
    if table.ndim != 2 or table.shape[1] not in (3, columns):
        raise UserError(f"sizes of shape {table.shape}: give one row of {columns} sides per item")
    axes = range(3) if table.shape[1] == 3 else problem.axes
    numbers = _numbers(table, axes)
    full = np.ones((len(table), 3), numbers.dtype)
    full[:, list(axes)] = numbers
    rules = (
        (~np.isfinite(full), "is not a number: give whole cells"),
        (full != np.round(full), "is not whole: round up to the grid's cells"),
        (full < 1, "is not positive: give at least 1 cell"),
        (full > np.asarray(problem.bin), f"is larger than the bin {problem.bin}"),
    )
    for broken, complaint in rules:
        if broken.any():
            item, axis = np.argwhere(broken)[0]
            raise UserError(f"item {item}: {SIDES[axis]} {full[item, axis]} {complaint}")
    if (full[:, :2] > problem.window).any():
        item = int(np.argwhere((full[:, :2] > problem.window).any(1))[0, 0])
        raise UserError(
            f"item {item}: its footprint is larger than Problem.largest {problem.largest}; raise it"
        )
    return Instance(
        size=jnp.asarray(full, jnp.int32),
        mask=jnp.ones(len(full), bool),
        bin=jnp.asarray(problem.bin, jnp.int32),
    )
