"""Which types of bins to take for a packing, once it is known what is in each."""

import numpy as np

from jaxpack.model.encoding import Loading
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
    kinds, prices = loading.bins[first].tolist(), stock.price[first].tolist()
    limits = stock.limit[first]
    fits = (reach[:, None] <= stock.bins[first]).all(2)  # [slots, kinds]
    fits &= (limits == np.iinfo(limits.dtype).max) | (weight[:, None] <= limits)
    if loading.ruled:
        fits = _holding(loading, turn, bin, corner, rows if order is None else order, fits)
    left = {kind: job.bins[kind].copies for kind in kinds}
    chosen = {}
    # The dearest bins choose first: they have the most to save.
    for n in np.argsort(-stock.price[slots], kind="stable").tolist():
        able = [
            (price, kind != own[n], kind)
            for price, kind, fit in zip(prices, kinds, fits[n].tolist(), strict=True)
            if fit and left[kind] != 0
        ]
        if not able:  # another one took the copy it had
            return as_packed
        kind = min(able)[2]
        chosen[int(slots[n])] = kind
        copies = left[kind]
        left[kind] = None if copies is None else copies - 1
    return chosen


def _holding(
    loading: Loading,
    turn: np.ndarray,
    bin: np.ndarray,
    corner: np.ndarray,
    order: np.ndarray,
    fits: np.ndarray,
) -> np.ndarray:
    """bool [slots, kinds], which bins may be of which cheaper types by all rules, or stay."""
    slots, price = np.unique(bin[bin >= 0]), loading.stock.price[loading.first]
    holding = loading.bins[slots][:, None] == loading.bins[loading.first]
    cheaper = fits & (price < loading.stock.price[slots][:, None])
    for n, kind in np.argwhere(cheaper).tolist():
        rows = order[bin[order] == slots[n]]
        holding[n, kind] = holds(loading, int(loading.first[kind]), rows, turn, corner)
    return holding
