"""What a job may ask of single items and bins beside their sizes and weights; off if not given."""

import math
from dataclasses import dataclass

Sides = tuple[float, float, float]


@dataclass(frozen=True)
class ItemLimits:
    """What is asked of every copy of an item. `Job` checks them.

    One item lies on another if its base is at that one's top, with an area in common.
    """

    weight_above: float = math.inf  # that may rest on it, passed on by area of contact
    stackable: bool = True  # whether anything may lie on it
    most_in_stack: int | None = None  # items in a stack that it is in, itself included
    stack_id: int = 0  # it lies only on items of the same
    group: str = ""  # those of one are in one bin if they fit one
    apart: str = ""  # no two of one are in one bin, be they copies of one item
    stop: int | None = None  # where it is unloaded, from 1; after all others if not given
    floor: bool = False  # whether it has to stand on the floor


@dataclass(frozen=True)
class Obstacle:
    """A part of a bin that is taken. Items may lie on it."""

    corner: Sides  # the one nearest to the origin
    size: Sides


@dataclass(frozen=True)
class BinLimits:
    """What is asked of every bin of a type. `Job` checks them."""

    most_items: int | None = None  # in one of them
    obstacles: tuple[Obstacle, ...] = ()
