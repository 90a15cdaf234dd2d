"""Plans in one pass, for when there is no time: columns of items, side by side.

In a column every item lies wholly on the one below, so that it is carried whatever the rule.
Columns stand in rows along x, one row behind the other along y.
"""

from typing import NamedTuple

import numpy as np

from jaxpack.model.encoding import Genes, Loading

FAR = 2**31  # above every bin
LOOKED_AT = 48  # columns, the last ones, that an item may stand on


class _Kind(NamedTuple):
    """Bins of one type, units."""

    length: int
    width: int
    height: int
    limit: int


class _Columns(NamedTuple):
    """Columns by number; a row of the stock is in one of them, at some height."""

    size: np.ndarray  # int64 [C, 2], of the base
    weight: np.ndarray  # int64 [C]
    rows: np.ndarray  # int64 [n], of the stock, from below
    column: np.ndarray  # int64 [n]
    z: np.ndarray  # int64 [n]


def stand_in_columns(
    loading: Loading,
    genes: Genes,
    bin: np.ndarray,
    corner: np.ndarray,
    height: int = FAR,
) -> Genes:
    """Packs what is not packed yet into bins of its own.

    Args:
        loading: what is packed.
        genes: of one lane; the bins are taken in the sequence of its pool.
        bin, corner: by row of the stock; both are filled in.
        height: up to which columns reach at most, units.

    Returns:
        The genes with these items last, from below.
    """
    stock, used = loading.stock, np.zeros(len(loading.bins), bool)
    used[bin[bin >= 0]] = True
    free = genes.pool[~used[genes.pool]]
    waiting = genes.order[bin[genes.order] < 0]
    order = [genes.order[bin[genes.order] >= 0]]
    no_limit = np.iinfo(stock.limit.dtype).max
    for type_of_bin in dict.fromkeys(loading.bins[free].tolist()):
        slots = free[loading.bins[free] == type_of_bin]
        limit = int(stock.limit[slots[0]])
        x, y, z = stock.bins[slots[0]].tolist()
        z = min(z, height)
        kind = _Kind(x, y, z, 2**62 if limit == no_limit else limit)
        size = stock.sizes[waiting, genes.turn[waiting]]
        fits = (size <= kind[:3]).all(1) & (stock.weight[waiting] <= kind.limit)
        if not fits.any():
            continue
        columns = _columns(loading, genes, waiting[fits], kind)
        place = _side_by_side(columns, kind, len(slots), int(stock.step))
        x, y, slot = place[columns.column].T
        there = slot >= 0
        rows = columns.rows[there]
        bin[rows] = slots[slot[there]]
        corner[rows] = np.stack([x[there], y[there], columns.z[there]], 1)
        order.append(rows)
        waiting = waiting[bin[waiting] < 0]
    return genes._replace(order=np.concatenate([*order, waiting]).astype(np.int32))


def _columns(loading: Loading, genes: Genes, waiting: np.ndarray, kind: _Kind) -> _Columns:
    """Every item on the first of the last columns that carries it, those with large bases first."""
    stock = loading.stock
    size = stock.sizes[waiting, genes.turn[waiting]].astype(np.int64)
    alike = loading.items[waiting] * 8 + genes.turn[waiting]
    by_base = np.lexsort((alike, -size[:, 2], -size[:, 0] * size[:, 1]))
    waiting, alike = waiting[by_base], alike[by_base]
    starts = np.flatnonzero(np.diff(alike, prepend=-1))
    base, top = (
        list[tuple[int, int]](),
        list[tuple[int, int]](),
    )  # of columns; what carries the next
    left, weights = list[int](), list[int]()  # height that is left
    column, z = list[int](), list[int]()  # of items
    groups = zip(
        size[by_base[starts]].tolist(), stock.weight[waiting[starts]].tolist(),
        np.diff(np.append(starts, len(waiting))).tolist(), strict=True,
    )  # fmt: skip
    for (length, width, height), weight, copies in groups:
        tried = iter(range(max(0, len(base) - LOOKED_AT), len(base)))
        while copies:
            number = next(tried, len(base))
            if number == len(base):
                base.append((length, width))
                top.append((length, width))
                left.append(kind.height)
                weights.append(0)
            elif top[number][0] < length or top[number][1] < width:
                continue
            some = min(copies, left[number] // height)
            if weight:
                some = min(some, (kind.limit - weights[number]) // weight)
            if not some:
                continue
            bottom = kind.height - left[number]
            column += [number] * some
            z += range(bottom, bottom + some * height, height)
            left[number] -= some * height
            weights[number] += some * weight
            top[number] = length, width
            copies -= some
    return _Columns(np.array(base), np.array(weights), waiting, np.array(column), np.array(z))


def _side_by_side(columns: _Columns, kind: _Kind, bins: int, step: int) -> np.ndarray:
    """x, y and number of the bin of every column, -1 beyond the last bin: int64 [C, 3]."""
    place = np.full((len(columns.size), 3), -1, np.int64)
    pitch = -(-columns.size // step) * step
    order = np.lexsort((-pitch[:, 0], -pitch[:, 1]))
    number, x, y, depth, left = 0, 0, 0, 0, kind.limit
    rows = zip(
        columns.size[order].tolist(), pitch[order].tolist(), columns.weight[order].tolist(),
        strict=True,
    )  # fmt: skip
    places = []
    for (length, width), (across, behind), weight in rows:
        if x + length > kind.length:
            x, y, depth = 0, y + depth, 0
        if y + width > kind.width or weight > left:
            number, x, y, depth, left = number + 1, 0, 0, 0, kind.limit
        if number == bins:
            break
        places.append((x, y, number))
        x, depth, left = x + across, max(depth, behind), left - weight
    place[order[: len(places)]] = places
    return place
