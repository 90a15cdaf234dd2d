"""A list of items to load and the bins there are, in the user's own units, and a plan for it.

Plain Python and NumPy: what files are read into and written from. Lengths are along x (length),
y (width) and z (height), in any unit, the same for all; 2D is 3D with width 1: x is the WIDTH of
a two-dimensional file and z its HEIGHT.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property

from jaxpack.errors import UserError

Sides = tuple[float, float, float]

ORIENTATIONS = {
    "XYZ": (0, 1, 2),
    "YXZ": (1, 0, 2),
    "ZYX": (2, 1, 0),
    "YZX": (1, 2, 0),
    "XZY": (0, 2, 1),
    "ZXY": (2, 0, 1),
}
"""Name -> which of the item's own sides lies along x, y and z of the bin."""

UPRIGHT = ("XYZ", "YXZ")
FLAT_TURNED = ("XYZ", "ZYX")  # all that 2D has: as given, and by a quarter


@dataclass(frozen=True)
class ItemType:
    """Items of one kind."""

    size: Sides
    copies: int = 1
    weight: float = 0.0  # of one of them
    orientations: tuple[str, ...] = ("XYZ",)  # those that are allowed, keys of ORIENTATIONS
    name: str = ""
    where: str = field(default="", compare=False)  # in its file, such as "row 2"

    def turned(self, orientation: str) -> Sides:
        """Its extent along x, y and z in that orientation."""
        x, y, z = (self.size[side] for side in ORIENTATIONS[orientation])
        return x, y, z


@dataclass(frozen=True)
class BinType:
    """Bins of one kind."""

    size: Sides
    cost: float | None = None  # of one that is used; its volume if not given
    copies: int | None = None  # how many there are; any number if not given
    max_weight: float = math.inf
    name: str = ""

    @property
    def price(self) -> float:
        """What one of them costs."""
        return math.prod(self.size) if self.cost is None else self.cost


@dataclass(frozen=True)
class Job:
    """What has to be packed into what.

    Raises:
        UserError: without items or bins, or in 2D for one whose width is not 1.
    """

    items: tuple[ItemType, ...]
    bins: tuple[BinType, ...]
    dimension: int = 3  # 2 or 3
    name: str = ""

    def __post_init__(self) -> None:
        if not self.items or not self.bins:
            what = "items" if not self.items else "bins"
            raise UserError(f"{self.name or 'the job'} has no {what}: give at least one")
        if self.dimension == 2:
            for size in [entry.size for entry in self.items] + [entry.size for entry in self.bins]:
                if size[1] != 1:
                    raise UserError(f"size {size} in 2D: give width (the second) as 1")

    @cached_property
    def count(self) -> int:
        """All copies of all items."""
        return sum(item.copies for item in self.items)


@dataclass(frozen=True)
class Placement:
    """One item in its bin."""

    item: int  # index in Job.items
    orientation: str  # key of ORIENTATIONS
    corner: Sides  # x, y, z of the front-bottom-left corner


@dataclass(frozen=True)
class PackedBin:
    """One bin that is used."""

    bin: int  # index in Job.bins
    placements: tuple[Placement, ...]  # in loading order: each rests on earlier ones or the floor


@dataclass(frozen=True)
class Plan:
    """A packing of a job."""

    bins: tuple[PackedBin, ...]
    left_out: tuple[int, ...] = ()  # index in Job.items of every copy that was not packed
