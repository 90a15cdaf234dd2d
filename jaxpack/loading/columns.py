"""Plans in one pass, for when there is no time: columns of items, side by side.

In a column every item lies wholly on the one below, so that it is carried whatever the rule.
Columns stand in rows along x, one row behind the other along y.
"""

from typing import NamedTuple

import numpy as np

from jaxpack.loading.stock import Genes, Loading


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


def stand_in_columns(loading: Loading, genes: Genes, bin: np.ndarray, corner: np.ndarray) -> Genes:
    """Packs what is not packed yet into bins of its own.

    Args:
        loading: what is packed.
        genes: of one lane; the bins are taken in the sequence of its pool.
        bin, corner: by row of the stock; both are filled in.

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
    """Every item on the smallest base that carries it, those with the largest bases first."""
    stock = loading.stock
    size = stock.sizes[waiting, genes.turn[waiting]].astype(np.int64)
    alike = loading.items[waiting] * 8 + genes.turn[waiting]
    waiting = waiting[np.lexsort((alike, -size[:, 2], -size[:, 0] * size[:, 1]))]
    alike = loading.items[waiting] * 8 + genes.turn[waiting]
    base, weights = np.zeros((0, 2), np.int64), np.zeros(0, np.int64)
    top, left = base, np.zeros(0, np.int64)  # what carries the next one, height that is left
    found = []
    for rows in np.split(waiting, np.flatnonzero(np.diff(alike)) + 1):
        *footprint, height = stock.sizes[rows[0], genes.turn[rows[0]]].tolist()
        weight = int(stock.weight[rows[0]])
        there = np.flatnonzero((top >= footprint).all(1) & (left >= height))
        there = there[np.argsort(top[there].prod(1), kind="stable")]
        room = left[there] // height
        if weight:
            room = np.minimum(room, (kind.limit - weights[there]) // weight)
        taken = np.diff(np.minimum(np.cumsum(room), len(rows)), prepend=0)
        rest = len(rows) - int(taken.sum())
        high = min(kind.height // height, kind.limit // weight if weight else rest) if rest else 1
        new = -(-rest // high)
        number = np.concatenate([there, np.arange(len(base), len(base) + new)])
        taken = np.concatenate([taken, np.full(new, high)])
        if new:
            taken[-1] = rest - (new - 1) * high
        base = np.concatenate([base, np.tile(footprint, (new, 1))])
        top = np.concatenate([top, np.tile(footprint, (new, 1))])
        left = np.concatenate([left, np.full(new, kind.height)])
        weights = np.concatenate([weights, np.zeros(new, np.int64)])
        number, taken = number[taken > 0], taken[taken > 0]
        column = np.repeat(number, taken)
        level = np.arange(len(rows)) - np.repeat(np.cumsum(taken) - taken, taken)
        found.append((rows, column, kind.height - left[column] + level * height))
        left[number] -= taken * height
        weights[number] += taken * weight
        top[number] = footprint
    return _Columns(base, weights, *map(np.concatenate, zip(*found, strict=True)))


def _side_by_side(columns: _Columns, kind: _Kind, bins: int, step: int) -> np.ndarray:
    """x, y and number of the bin of every column, -1 beyond the last bin: int64 [C, 3]."""
    place = np.full((len(columns.size), 3), -1, np.int64)
    pitch = -(-columns.size // step) * step
    order = np.lexsort((-pitch[:, 0], -pitch[:, 1]))
    number, x, y, depth, left = 0, 0, 0, 0, kind.limit
    for column in order.tolist():
        length, width = columns.size[column].tolist()
        if x + length > kind.length:
            x, y, depth = 0, y + depth, 0
        if y + width > kind.width or columns.weight[column] > left:
            number, x, y, depth, left = number + 1, 0, 0, 0, kind.limit
        if number == bins:
            break
        place[column] = x, y, number
        x, depth = x + int(pitch[column, 0]), max(depth, int(pitch[column, 1]))
        left -= int(columns.weight[column])
    return place
