"""What to do about items that no bin holds, and about sizes that look like another unit."""

import math
from collections import defaultdict
from collections.abc import Iterable

from jaxpack.model.job import FLAT_TURNED, ORIENTATIONS, BinType, ItemType, Job

FACTORS = {  # between two units of length -> which they may be
    10.0: ("mm", "cm"),
    25.4: ("mm", "inches"),
    100.0: ("cm", "m"),
    1000.0: ("mm", "m"),
}
TINY = 0.01  # of one bin: less than that all items together seldom fill


def unfit_message(job: Job, unfit: list[int], skipped: bool) -> str:
    """The one line about items, by index in `job.items`, that no bin can hold.

    Args:
        job: the job.
        unfit: the items; the first one is named.
        skipped: whether such items are left out where others fit.
    """
    first = job.items[unfit[0]]
    called = f" ({first.name})" if first.name else ""
    others = f" and {len(unfit) - 1} more" if len(unfit) > 1 else ""
    sides = " x ".join(f"{first.size[axis]:.13g}" for axis in job.axes)
    wrong = f"no bin can hold {sides} in an orientation that is allowed"
    rooms = [kind for kind in job.bins if kind.copies != 0]
    able = [kind for kind in rooms if first.weight <= kind.max_weight]
    advice = scale_hint(job) or unfit_hint(job, unfit[0])
    if any(_fits(first, way, able) for way in first.orientations):
        where = " on the floor" if first.limits.floor else ""
        wrong = f"no bin has room for {sides}{where} beside its obstacles"
        advice = "give a bin with fewer of them"
    elif any(_fits(first, way, rooms) for way in first.orientations):
        wrong = f"weight {first.weight:.13g} is over the limit of every bin that has room for it"
    if not skipped:
        or_else = " Or" if advice.endswith("?") else "; or"
        advice += f"{or_else} leave such items out with --skip-unfit"
    return f"{first.where or f'item {unfit[0]}'}{called}{others}: {wrong}; {advice}"


def apart_message(job: Job) -> str | None:
    """The one line about items that have to be apart and are more than there are bins, or None."""
    copies = [kind.copies for kind in job.bins]
    if None in copies:
        return None
    most = sum(count or 0 for count in copies)
    for name, items in apart_items(job).items():
        if (count := sum(item.copies for item in items)) > most:
            what = f"{count} items that are to be apart '{name}', and {most} bin{'s' * (most != 1)}"
            where = items[0].where or f"item {job.items.index(items[0])}"
            return f"{where}: {what}: give more, or leave out the column APART with --ignore"
    return None


def apart_items(job: Job) -> dict[str, list[ItemType]]:
    """The items of which no two may be in one bin, by what their limits say."""
    found = defaultdict[str, list[ItemType]](list)
    for item in job.items:
        if item.limits.apart:
            found[item.limits.apart].append(item)
    return found


def unfit_hint(job: Job, item: int) -> str:
    """What would make an item fit: to allow an orientation, a higher limit, or a larger bin.

    Args:
        job: the job.
        item: index in `job.items` of one that no bin can hold as it may be turned.
    """
    kind = job.items[item]
    bins = [one for one in job.bins if one.copies != 0]
    if not bins:
        return "give bins that there are: the COPIES of all are 0"
    able = [one for one in bins if kind.weight <= one.max_weight]
    if not any(_fits(kind, way, bins) for way in kind.orientations):
        if able:
            known = FLAT_TURNED if job.dimension == 2 else tuple(ORIENTATIONS)
            ways = [way for way in known if _fits(kind, way, able)]
            if ways and job.dimension == 2:
                return "it would fit turned: allow that with ORIENTED 0"
            if ways:
                return f"it would fit turned: allow ROTATION_{ways[0]}"
        return "give a larger bin"
    bands = ", or last limit of BANDS," * any(one.tariff for one in bins)
    return f"give a bin with a higher MAXIMUM_WEIGHT{bands} that has room for it"


def scale_hint(job: Job) -> str | None:
    """The one line that says that the items seem to be in another unit than the bins, or None.

    They do where none fits and all would at a tenth, a hundredth, ... of their sides, and where
    all together fill less than 1 % of the smallest bin and would still fit ten times as long.
    """
    items = [item for item in job.items if item.copies]
    bins = [one for one in job.bins if one.copies != 0]
    if not items or not bins:
        return None
    if not any(_scaled_fits(job, item, bins, 1.0) for item in items):
        for factor, (small, large) in FACTORS.items():
            if all(_scaled_fits(job, item, bins, 1 / factor) for item in items):
                what = f"all items are too large, and would fit {factor:g} times smaller"
                return f"{what}: are they in {small} and the bins in {large}?"
        return None
    least = min(math.prod(one.size) for one in bins)
    if least == math.inf:
        return None
    share = math.fsum(item.copies * math.prod(item.size) for item in items) / least
    for factor in (1000.0, 10.0):
        if share < TINY and all(_scaled_fits(job, item, bins, factor) for item in items):
            small, large = FACTORS[factor]
            what = f"all items together fill {100 * share:.2g} % of a bin"
            return f"{what}: are they in {large} and the bins in {small}?"
    return None


def _fits(item: ItemType, way: str, bins: Iterable[BinType]) -> bool:
    extent = item.turned(way)
    return any(all(a <= b for a, b in zip(extent, one.size, strict=True)) for one in bins)


def _scaled_fits(job: Job, item: ItemType, bins: Iterable[BinType], factor: float) -> bool:
    """Whether some bin holds it, turned anyhow, when its sides are times that factor."""
    sides = sorted(item.size[axis] * factor * (1 - 1e-12) for axis in job.axes)
    rooms = (sorted(one.size[axis] for axis in job.axes) for one in bins)
    return any(all(a <= b for a, b in zip(sides, room, strict=True)) for room in rooms)
