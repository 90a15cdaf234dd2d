"""Jobs with tariffs as jobs whose bins cost the same, or nearly so, whatever is in them."""

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

from jaxpack.model.exact import exact
from jaxpack.model.job import BinType, Job


def by_band(job: Job) -> tuple[Job, tuple[int, ...]]:
    """The job with a type of bins for every band of its tariffs, as light as that asks for.

    A type of which there are few is one still, as its bands would share the copies.

    Returns:
        The job, and which of `job.bins` each of its types is.
    """
    weights = [exact(item.weight) for item in job.items if item.copies]
    lightest, total = min(weights), _weight(job)
    kinds = list[tuple[int, BinType]]()
    for number, kind in enumerate(job.bins):
        few = kind.copies is not None and kind.copies < job.count
        bands = [*_useful(kind, lightest, total)] if kind.tariff and not few else []
        kinds += [(number, one) for one in bands or [kind]]
    whose, types = zip(*kinds, strict=True)
    return replace(job, bins=types), whose


def _useful(kind: BinType, lightest: Fraction, total: Fraction) -> Iterator[BinType]:
    """The type by each of its bands that hold an item, up to the one that holds what it may."""
    assert kind.tariff
    most = total if total <= kind.max_weight else exact(kind.max_weight)
    for band in kind.tariff.bands:
        limit = exact(band[0])
        if limit >= kind.tariff.billed(lightest, kind.size):
            yield replace(kind, tariff=replace(kind.tariff, bands=(band,)))
        if limit >= kind.tariff.billed(most, kind.size):
            return


def least_prices(job: Job) -> list[tuple[Job, Fraction]]:
    """Jobs of which each says that no plan with all items is cheaper than so many of its bins, if
    they are as dear as they are empty, and what all items add to that.
    """
    split, _ = by_band(job)
    rate = least_rate(job)
    if not rate:
        return [(split, rate)]
    # What is billed is no less than the weight, and no less than the dimensional weight.
    plain = tuple(
        replace(kind, tariff=replace(kind.tariff, divisor=None)) if kind.tariff else kind
        for kind in split.bins
    )
    by_weight = replace(split, bins=plain), rate * _weight(job)
    return [by_weight] if plain == split.bins else [(split, Fraction(0)), by_weight]


def least_rate(job: Job) -> Fraction:
    """What a unit of weight costs in every bin, whatever else is in it."""
    return exact(min(kind.tariff.per_weight if kind.tariff else 0.0 for kind in job.bins))


def _weight(job: Job) -> Fraction:
    """Of all items."""
    return sum((exact(item.weight) * item.copies for item in job.items), Fraction(0))
