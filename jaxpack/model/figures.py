"""What a plan amounts to: bins, fill, weight, cost, exactly."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache

import numpy as np

from jaxpack.model.exact import exact, volume, whole
from jaxpack.model.job import BinType, ItemType, Job, PackedBin, Plan

NOTHING = Fraction(0)


@dataclass(frozen=True)
class PlanFigures:
    """The figures of one plan, in the units of its job."""

    bins: int
    utilisation: float  # volume of the items / volume of the bins; 0 without bins
    weight: float  # of all packed items
    cost: float  # of all used bins; see `BinType.price_of`
    left_out: int  # items that were not packed


def plan_figures(job: Job, plan: Plan) -> PlanFigures:
    """The figures of a valid plan: `check_plan` is not repeated here."""
    items = Counter(put.item for packed in plan.bins for put in packed.placements)
    return PlanFigures(
        bins=len(plan.bins),
        utilisation=_share(job, items, _used(plan)),
        weight=math.fsum(job.items[item].weight * copies for item, copies in items.items()),
        cost=total_cost(job, plan),
        left_out=len(plan.left_out),
    )


def levelled(job: Job, plan: Plan) -> Job:
    """The job with its bins as high as those of the plan, where they are open or that is less."""
    heights = {packed.bin: job.room(packed) for packed in plan.bins}
    sizes = [heights.get(number, kind.size) for number, kind in enumerate(job.bins)]
    if sizes == [kind.size for kind in job.bins]:
        return job
    kinds = (
        replace(kind, size=size, limits=kind.limits.within(size))
        for kind, size in zip(job.bins, sizes, strict=True)
    )
    return replace(job, bins=tuple(kinds))


def fill(job: Job, packed: PackedBin) -> float:
    """Volume of the items in a bin / volume of the bin."""
    return _share(job, Counter(put.item for put in packed.placements), {packed.bin: 1})


def total_cost(job: Job, plan: Plan) -> float:
    """What the used bins cost together; those without a cost their volume."""
    return float(bins_worth(("cost",), job, plan)[1])


def profit_of(item: ItemType) -> Fraction:
    """What one of them is worth: its volume, in 2D its area, if nothing is given."""
    return volume(item.size) if item.profit is None else exact(item.profit)


def plan_profit(job: Job, plan: Plan) -> Fraction:
    """What all packed items are worth."""
    items = Counter(put.item for packed in plan.bins for put in packed.placements)
    return sum((profit_of(job.items[item]) * n for item, n in items.items()), Fraction(0))


@lru_cache(1024)
def parts_of(kind: BinType, load: Fraction = NOTHING) -> dict[str, Fraction]:
    """What can count of a bin that is used, with so much weight in it."""
    return {"cost": kind.price_of(load), "bins": Fraction(1), "volume": volume(kind.size)}


def load_of(job: Job, packed: PackedBin) -> Fraction:
    """The weight of what is in a bin."""
    items = Counter(put.item for put in packed.placements)
    return sum((exact(job.items[item].weight) * n for item, n in items.items()), NOTHING)


def bins_worth(parts: tuple[str, ...], job: Job, plan: Plan) -> tuple[Fraction | int, ...]:
    """Copies left out, then what the used bins come to in each of the parts of `parts_of`."""
    alike = Counter(
        (one.bin, load_of(job, one) if job.bins[one.bin].tariff else NOTHING) for one in plan.bins
    )
    used = [(parts_of(job.bins[kind], load), copies) for (kind, load), copies in alike.items()]
    sums = (sum((each[part] * n for each, n in used), Fraction(0)) for part in parts)
    return len(plan.left_out), *sums


def _used(plan: Plan) -> Counter[int]:
    """How many bins of each kind."""
    return Counter(packed.bin for packed in plan.bins)


def _share(job: Job, items: Mapping[int, int], bins: Mapping[int, int]) -> float:
    """Volume of the items / volume of the bins, each with its copies; 0 without bins."""
    if not bins:
        return 0.0
    sizes = [*(job.items[item].size for item in items), *(job.bins[kind].size for kind in bins)]
    sides, _ = whole(np.array(sizes, float)[:, job.axes])
    volumes = [math.prod(row) for row in sides.tolist()]
    packed = sum(map(math.prod, zip(volumes, items.values(), strict=False)))
    room = sum(map(math.prod, zip(volumes[len(items) :], bins.values(), strict=True)))
    return packed / room
