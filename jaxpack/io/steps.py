"""The loading steps of a plan: items in the order in which they go into the bins."""

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from jaxpack.io.tables import write_table
from jaxpack.model.job import ItemType, Job, Placement, Plan, Sides
from jaxpack.model.numbers import plain

_COLUMNS = ("STEP", "BIN", "ITEM", "NAME", "X", "Y", "Z", "LX", "LY", "LZ", "ROTATION", "WEIGHT")


class Step(NamedTuple):
    """An item on its way into a bin."""

    number: int  # from 1, through all bins
    bin: int  # index in Plan.bins
    item: ItemType
    placement: Placement

    @property
    def extent(self) -> Sides:
        """Its sides along x, y and z as it lies."""
        return self.item.turned(self.placement.orientation)

    @property
    def volume(self) -> float:
        """Of the item."""
        return math.prod(self.item.size)


def steps_of(job: Job, plan: Plan) -> Iterator[Step]:
    """All steps of a plan."""
    loads = [(bin, one) for bin, packed in enumerate(plan.bins) for one in packed.placements]
    for number, (bin, placement) in enumerate(loads, 1):
        yield Step(number, bin, job.items[placement.item], placement)


def sides_of(sides: Sides, axes: Iterable[int] = (0, 1, 2)) -> list[int | float]:
    """The sides along those axes as they are written."""
    return [plain(sides[axis]) for axis in axes]


def write_steps(path: Path, job: Job, plan: Plan) -> None:
    """Writes a CSV with a row per item in loading order; X, Y, Z is its front-bottom-left corner.

    LX, LY, LZ are its extents as it lies and ROTATION the orientation, a key of ORIENTATIONS.
    """
    rows: list[Sequence[object]] = [_COLUMNS]
    for step in steps_of(job, plan):
        box = *sides_of(step.placement.corner), *sides_of(step.extent)
        last = step.placement.orientation, plain(step.item.weight)
        rows.append([step.number, step.bin, step.placement.item, step.item.name, *box, *last])
    write_table(path, rows)
