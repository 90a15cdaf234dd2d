"""Which types of bins to take for a packing, once it is known what is in each."""

from fractions import Fraction
from functools import lru_cache

import numpy as np

from jaxpack.model.encoding import Loading
from jaxpack.model.exact import exact
from jaxpack.model.figures import parts_of
from jaxpack.model.job import BinType
from jaxpack.packing.ruled.filling import holds


def cheapest_types(
    loading: Loading,
    turn: np.ndarray,
    bin: np.ndarray,
    corner: np.ndarray,
    order: np.ndarray | None = None,
) -> dict[int, int]:
    """For every bin that is used the type to take for it: the cheapest one left that can hold it.

    Args:
        loading: what was packed.
        turn, bin, corner: of one lane, by row of the stock.
        order: of loading, where the job has rules of its own.

    Returns:
        Index of `Stock.bins` -> index in Job.bins.
    """
    job, stock = loading.job, loading.stock
    slots, number = np.unique(bin[bin >= 0], return_inverse=True)
    own = loading.bins[slots]
    as_packed = dict(zip(slots.tolist(), own.tolist(), strict=True))
    if len(job.bins) == 1:
        return as_packed
    rows = np.flatnonzero(bin >= 0)
    ends = corner[rows].astype(np.int64) + stock.sizes[rows, turn[rows]]
    reach, weight = np.zeros((len(slots), 3), np.int64), np.zeros(len(slots), np.int64)
    np.maximum.at(reach, number, ends)
    np.add.at(weight, number, stock.weight[rows].astype(np.int64))
    first = loading.first
    kinds, prices = loading.bins[first], _prices(loading, bin)
    limits = stock.limit[first]
    fits = (reach[:, None] <= stock.bins[first]).all(2)  # [slots, kinds]
    fits &= (limits == np.iinfo(limits.dtype).max) | (weight[:, None] <= limits)
    if loading.ruled:
        order = rows if order is None else order
        fits = _holding(loading, turn, bin, corner, order, fits, prices)
    left = {kind: job.bins[kind].copies for kind in kinds.tolist()}
    chosen = {}
    # The dearest bins choose first: they have the most to save.
    paid = prices[np.arange(len(slots)), np.searchsorted(kinds, own)]
    for n in np.argsort(-paid, kind="stable").tolist():
        some = zip(prices[n].tolist(), kinds.tolist(), fits[n].tolist(), strict=True)
        able = [
            (price, kind != own[n], kind) for price, kind, fit in some if fit and left[kind] != 0
        ]
        if not able:  # another one took the copy it had
            return as_packed
        kind = min(able)[2]
        chosen[int(slots[n])] = kind
        copies = left[kind]
        left[kind] = None if copies is None else copies - 1
    return chosen


def _prices(loading: Loading, bin: np.ndarray) -> np.ndarray:
    """int [slots, kinds], how dear a bin that is used is as one of a type, exactly: a rank."""
    job, slots = loading.given, np.unique(bin[bin >= 0])
    kinds = tuple(job.bins[loading.whose[n]] for n in loading.bins[loading.first].tolist())
    loads = [Fraction(0)]
    if loading.by_load:
        weights = np.array([exact(job.items[item].weight) for item in loading.items.tolist()])
        loads = [Fraction(weights[bin == slot].sum()) for slot in slots]
    ranks = _ranks(kinds, tuple(loads), loading.objective.parts)
    return np.broadcast_to(ranks, (len(slots), len(kinds)))


@lru_cache(256)  # the bins of many orders are the same
def _ranks(
    kinds: tuple[BinType, ...], loads: tuple[Fraction, ...], parts: tuple[str, ...]
) -> np.ndarray:
    """How dear bins of each type are with each load in them: int [loads, kinds]."""
    counted = [parts_of(kind, load) for load in loads for kind in kinds]
    worths = [tuple(one[part] for part in parts) for one in counted]
    rank = {worth: number for number, worth in enumerate(sorted(set(worths)))}
    return np.array([rank[worth] for worth in worths]).reshape(-1, len(kinds))


def _holding(
    loading: Loading,
    turn: np.ndarray,
    bin: np.ndarray,
    corner: np.ndarray,
    order: np.ndarray,
    fits: np.ndarray,
    prices: np.ndarray,
) -> np.ndarray:
    """bool [slots, kinds], which bins may be of which cheaper types by all rules, or stay."""
    slots = np.unique(bin[bin >= 0])
    holding = loading.bins[slots][:, None] == loading.bins[loading.first]
    cheaper = fits & (prices < prices[holding][:, None])
    for n, kind in np.argwhere(cheaper).tolist():
        rows = order[bin[order] == slots[n]]
        holding[n, kind] = holds(loading, int(loading.first[kind]), rows, turn, corner)
    return holding
