"""The judge without a grid once more, in NumPy: plans that are there before the search is compiled.

The same placements as `pack_exact` to the unit, at a thousandth of its speed.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpack.loading.local_search import Best, Genes, cost_of
from jaxpack.loading.stock import Loading, first_genes
from jaxpack.packing.first_fit_exact import SLACK, ExactRules
from jaxpack.packing.problem import area_needed
from jaxpack.packing.top_faces import NOWHERE

LANES = (0, 4, 9)  # of the first genes: by volume as given, by area lying flat, by height turned
TABLE = 2**21  # numbers that a table of places may have

Place = tuple[int, int, int]


class Rows(NamedTuple):
    """Items in packing order, turned as they are to be packed, and bins in theirs, in units."""

    size: np.ndarray  # int [N, 3]
    weight: np.ndarray  # int [N]
    bins: np.ndarray  # int [S, 3]
    limit: np.ndarray  # int [S]


def quick_plan(loading: Loading, seed: int, lane: int, stop: Callable[[], bool]) -> Best | None:
    """One of the sorts, such as one of LANES; None if `stop` said so before it was packed."""
    genes = first_genes(loading, np.random.default_rng(seed), lane + 1)
    chosen: Genes = jax.tree.map(lambda leaf: leaf[lane], genes)
    order, turn, pool = map(np.asarray, chosen)
    stock = jax.tree.map(np.asarray, loading.stock)
    items = order[stock.mask[order]]
    size, weight = stock.sizes[items, turn[items]], stock.weight[items]
    rows = Rows(size, weight, stock.bins[pool], stock.limit[pool])
    packed = pack_quickly(loading.rules, rows, stop)
    if packed is None:
        return None
    slot = np.full(len(order), -1, np.int32)
    slot[items] = np.where(packed[0] >= 0, pool[packed[0]], -1)
    corner = np.zeros((len(order), 3), np.int32)
    corner[items] = packed[1]
    bin = jnp.asarray(slot)
    return Best(chosen, bin, jnp.asarray(corner), cost_of(loading.stock, bin[None])[0])


def pack_quickly(
    rules: ExactRules, rows: Rows, stop: Callable[[], bool]
) -> tuple[np.ndarray, np.ndarray] | None:
    """(bin int32 [N], -1 for what was not packed, corner int32 [N, 3]) by row.

    Args:
        rules: those of `pack_exact`.
        rows: what is to be packed.
        stop: asked before every placement; there is no packing if it says so.
    """
    count = len(rows.size)
    needed = np.asarray(
        area_needed(rules.support, rules.inclusive, rows.size[:, 0] * rows.size[:, 1])
    )
    volume = rows.size.astype(np.float32).prod(1, dtype=np.float32)
    bin, corner = np.full(count, -1, np.int32), np.zeros((count, 3), np.int32)
    waiting = list(range(count))
    for slot, room in enumerate(rows.bins):
        if not waiting:
            break
        free = room.astype(np.float32).prod(dtype=np.float32) * np.float32(SLACK)
        weight, left = rows.limit[slot], []
        tops = np.zeros((0, 5), np.int64)  # near x, far x, near y, far y, top
        # Least height, by footprint, of what found no place: nothing higher will before the next.
        refused: dict[tuple[int, int], int] = {}
        for item in waiting:
            if stop():
                return None
            size, place = rows.size[item], None
            length, width, height = map(int, size)
            lower = height < refused.get((length, width), NOWHERE)
            light = rows.weight[item] <= weight and volume[item] <= free
            if len(tops) < rules.most and light and lower:
                place = _lowest(rules, tops, size, needed[item], room)
                if place is None:
                    refused[length, width] = height
            if place is None:
                left.append(item)
                continue
            refused.clear()
            bin[item], corner[item] = slot, place
            x, y, z = place
            face = [x, x + size[0], y, y + size[1], z + size[2]]
            tops = np.concatenate([tops, [face]])
            weight, free = weight - rows.weight[item], free - volume[item]
        waiting = left
    return bin, corner


def _lowest(
    rules: ExactRules, tops: np.ndarray, size: np.ndarray, needed: int, room: np.ndarray
) -> Place | None:
    """Minimum z, then y, then x, of the places where the item may stand; None if there is none."""
    near_x, far_x, near_y, far_y, top = tops.T
    xs = np.unique(np.append(far_x, 0))
    ys = np.zeros(1, np.int64) if rules.flat else np.unique(np.append(far_y, 0))
    xs, ys = xs[xs <= room[0] - size[0]], ys[ys <= room[1] - size[1]]
    if not len(xs) or not len(ys) or size[2] > room[2]:
        return None
    over_x = np.minimum(xs[:, None] + size[0], far_x) - np.maximum(xs[:, None], near_x)
    over_y = np.minimum(ys[:, None] + size[1], far_y) - np.maximum(ys[:, None], near_y)
    best = None
    rows = max(1, TABLE // max(over_x.size, 1))
    for first in range(0, len(ys), rows):
        beside = np.maximum(over_y[first : first + rows], 0)
        area = beside[:, None] * np.maximum(over_x, 0)  # [Y, X, faces]
        under = np.where(area > 0, top, 0)
        z = under.max(2, initial=0)
        carried = np.where(under == z[:, :, None], area, 0).sum(2)
        carried = np.where(z == 0, size[0] * size[1], carried)  # the floor
        z = np.where((carried >= needed) & (z <= room[2] - size[2]), z, NOWHERE)
        row, column = divmod(int(z.argmin()), len(xs))  # the first of the lowest: by y, then by x
        lowest = int(z[row, column])
        if lowest < (NOWHERE if best is None else best[2]):
            best = int(xs[column]), int(ys[first + row]), lowest
    return best
