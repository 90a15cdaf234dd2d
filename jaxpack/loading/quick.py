"""The judge without a grid once more, in NumPy: plans that are there before anything is compiled.

The same placements as `pack_exact` to the unit, at a thousandth of its speed.
"""

import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpack.loading.local_search import Best, Genes, cost_of
from jaxpack.loading.stock import Loading
from jaxpack.packing.first_fit_exact import SLACK, ExactRules
from jaxpack.packing.problem import area_needed

PLANS = 3  # at most: the compiler needs the cores too
Place = tuple[int, int, int]


class Rows(NamedTuple):
    """Items in packing order, turned as they are to be packed, and bins in theirs, in units."""

    size: np.ndarray  # int [N, 3]
    weight: np.ndarray  # int [N]
    bins: np.ndarray  # int [S, 3]
    limit: np.ndarray  # int [S]


def quick_plans(
    loading: Loading, genes: Genes, compiled: Callable[[], bool], end: float
) -> Iterator[Best]:
    """A few of the sorts, until the search is compiled or it is late; one of them in any case.

    Args:
        loading: the job.
        genes: from `first_genes`.
        compiled: whether the plans are not wanted any more.
        end: when it is late, by `time.perf_counter`.
    """
    stock = jax.tree.map(np.asarray, loading.stock)
    for plan in range(PLANS):
        lane = 4 * plan  # another key, and other sides down
        order, turn, pool = (np.asarray(leaf[lane]) for leaf in genes)
        items = order[stock.mask[order]]
        size, weight = stock.sizes[items, turn[items]], stock.weight[items]
        packed = pack_quickly(
            loading.rules,
            Rows(size, weight, stock.bins[pool], stock.limit[pool]),
            lambda: compiled() or (plan > 0 and time.perf_counter() > end),  # noqa: B023
        )
        if packed is None:
            return
        slot = np.full(len(order), -1, np.int32)
        slot[items] = np.where(packed[0] >= 0, pool[packed[0]], -1)
        corner = np.zeros((len(order), 3), np.int32)
        corner[items] = packed[1]
        bin = jnp.asarray(slot)
        chosen: Genes = jax.tree.map(lambda leaf: leaf[lane], genes)  # noqa: B023
        yield Best(chosen, bin, jnp.asarray(corner), cost_of(loading.stock, bin[None])[0])


def pack_quickly(
    rules: ExactRules, rows: Rows, stop: Callable[[], bool] = lambda: False
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
        for item in waiting:
            if stop():
                return None
            size, place = rows.size[item], None
            if len(tops) < rules.most and rows.weight[item] <= weight and volume[item] <= free:
                place = _lowest(rules, tops, size, needed[item], room)
            if place is None:
                left.append(item)
                continue
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
    area = np.maximum(over_y, 0)[:, None] * np.maximum(over_x, 0)  # [Y, X, faces]
    under = np.where(area > 0, top, 0)
    z = under.max(2, initial=0)
    carried = np.where(under == z[:, :, None], area, 0).sum(2)
    carried = np.where(z == 0, size[0] * size[1], carried)  # the floor
    z = np.where((carried >= needed) & (z <= room[2] - size[2]), z, np.iinfo(np.int64).max)
    row, column = divmod(int(z.argmin()), len(xs))  # the first of the lowest: by y, then by x
    if z[row, column] > room[2]:
        return None
    return int(xs[column]), int(ys[row]), int(z[row, column])
