"""Puts one block into a bin of every lane: which ones there are to choose from, and what each is
worth.
"""

from typing import Any

import numpy as np

from jaxpack.model.rules import before_centre
from jaxpack.search.block_policy import Judge, Offer, features
from jaxpack.search.filling import SHORTER, Axes, Block, Filling, Goods, Space, rows_of, some_lanes
from jaxpack.search.spaces import next_space, without


def step(
    xp: Any, axes: Axes, goods: Goods, now: Filling, nth: Any = None, judge: Judge | None = None
) -> Filling:
    """Puts one block into every lane, or puts its space to sleep.

    Args:
        xp: `numpy` or `jax.numpy`.
        axes: orders in which a block grows along the axes, where copies run short; static.
        nth: int32 [P], how many better blocks are passed over, each of another kind or orientation;
            none if not given.
        judge: the policy, if there is one.
    """
    space = next_space(xp, goods, now)
    block = _best_block(xp, axes, goods, now, space, nth, judge)
    asleep = (xp.arange(len(now.awake))[:, None] == space.which) & ~block.found
    low, high, awake = _spaces(xp, goods, now, block)
    K, R = len(goods.count), goods.side.shape[1]
    mine = (xp.arange(K)[:, None] == block.row // (R // K)) & block.found
    taken = xp.where(mine, block.grid.prod(0), 0).astype(np.int32)
    left, used = now.left - taken, now.used + block.found.astype(np.int32)
    over = (used >= len(now.row)) | ~(left > 0).any(0)
    return Filling(
        low,
        high,
        awake & ~asleep & ~over,
        _with(xp, now.near, block.near, now.used, block.found),
        _with(xp, now.far, block.far, now.used, block.found),
        _with(xp, now.row, block.row, now.used, block.found),
        _with(xp, now.grid, block.grid, now.used, block.found),
        _with(xp, now.firm, block.firm, now.used, block.found) if now.firm.size else now.firm,
        used,
        left,
        now.load - (taken * goods.weight).sum(0).astype(np.int32),
    )


def _with(xp: Any, table: Any, values: Any, index: Any, found: Any) -> Any:
    """[..., M, P] with values [..., P] at an index [P] where they are found."""
    if xp is np:
        new, some = table.copy(), np.flatnonzero(found)
        new[..., index[some], some] = values[..., some]
        return new
    here = (xp.arange(table.shape[-2])[:, None] == index) & found
    return xp.where(here, values[..., None, :], table).astype(np.int32)


def _spaces(xp: Any, goods: Goods, now: Filling, block: Block) -> tuple[Any, Any, Any]:
    """(low, high, awake) of the spaces that are left."""
    if xp is not np or 4 * block.found.sum() > 3 * len(block.found):
        return without(xp, goods, now, block)
    old = now.low.copy(), now.high.copy(), now.awake.copy()
    some = np.flatnonzero(block.found)
    if len(some):
        new = without(np, some_lanes(goods, some), some_lanes(now, some), some_lanes(block, some))
        for all_lanes, few in zip(old, new, strict=True):
            all_lanes[..., some] = few
    return old


def _best_block(
    xp: Any, axes: Axes, goods: Goods, now: Filling, space: Space, nth: Any, judge: Judge | None
) -> Block:
    choose = _of_some if xp is np else _of_all
    found, row, grid = choose(xp, axes, goods, now, space, nth, judge)
    row = row.astype(np.int32)
    grid = xp.where(found, grid, 0)
    extent = xp.where(found, grid * goods.side[:, row, np.arange(len(row))], 0)
    near = xp.concatenate(
        [xp.where(space.turned, space.high[:2] - extent[:2], space.low[:2]), space.low[2:]]
    )
    held = xp.where(found, xp.minimum(extent[:2], space.carried), 0)
    start = xp.where(space.turned, space.high[:2] - held, space.low[:2])
    return Block(found, row, grid, near, near + extent, xp.concatenate([start, start + held]))


def _of_all(
    xp: Any, axes: Axes, goods: Goods, now: Filling, space: Space, nth: Any, judge: Judge | None
) -> tuple[Any, Any, Any]:
    """(found bool [P], row int [P], grid int32 [3, P]) of the best of all blocks, where the number
    of those that can stand must be known before.
    """
    R, P = goods.side.shape[1:]
    row, lane = np.repeat(np.arange(R), P), np.tile(np.arange(P), R)
    grid, _ = _grids(xp, axes, goods, now, space, row, lane)
    V = grid.shape[1]
    row, lane = np.tile(row, V), np.tile(lane, V)
    worth = _worth(xp, goods, now, space, row, lane, grid.reshape(3, -1), judge)
    worth = worth.reshape(V, R, P)
    most = worth.max(0)
    if nth is None:
        row = most.argmax(0)
    else:
        row = rows_of(xp, xp.argsort(-most, 0, stable=True), xp.minimum(nth, R - 1))
    turn = rows_of(xp, worth, row).argmax(0)
    found = (rows_of(xp, most, row) > -np.inf) & (nth is None or nth < R)
    grid = rows_of(xp, rows_of(xp, grid.reshape(3, V, R, P), row), turn)
    return found, row, grid


def _of_some(
    xp: Any, axes: Axes, goods: Goods, now: Filling, space: Space, nth: Any, judge: Judge | None
) -> tuple[Any, Any, Any]:
    """The same of the blocks of items that fit into their space, a tenth of all."""
    P = goods.side.shape[2]
    fits = (goods.side <= (space.high - space.low)[:, None]).all(0) & space.there
    kind = np.arange(len(fits)) // (len(fits) // len(goods.count))
    lane, row = np.nonzero((fits & (now.left > 0)[kind]).T)
    if not len(row):
        return np.zeros(P, bool), np.zeros(P, int), np.zeros((3, P), np.int32)
    grid, again = _grids(np, axes, goods, now, space, row, lane)
    turn, which = np.nonzero((grid[0] > 0) & ~again)
    worth = np.full(grid.shape[1:], -np.inf, np.float32)
    worth[turn, which] = _worth(
        np, goods, now, space, row[which], lane[which], grid[:, turn, which], judge
    )
    most = worth.max(0)
    order = np.lexsort((-most, lane))  # stable: of equal ones the first row
    nth = 0 if nth is None else nth
    place = np.searchsorted(lane, np.arange(P)) + nth
    there = nth < np.bincount(lane, minlength=P)
    best = order[np.minimum(place, len(order) - 1)]
    return there & (most[best] > -np.inf), row[best], grid[:, worth[:, best].argmax(0), best]


def _grids(
    xp: Any, axes: Axes, goods: Goods, now: Filling, space: Space, row: Any, lane: Any
) -> tuple[Any, Any]:
    """How many items along each axis a block would have, grown in V ways, 0 where it cannot stand:
    int32 [3, V, C]; and which ways are one of those before again: bool [V, C].
    """
    kind = row // (goods.side.shape[1] // len(goods.count))
    side, needed, weight = (
        goods.side[:, row, lane],
        goods.needed[row, lane],
        goods.weight[kind, lane],
    )
    sides, carried = (space.high - space.low)[:, lane], space.carried[:, lane]
    left = now.left[kind, lane]
    light = now.load[lane] // xp.maximum(weight, 1)
    copies = xp.where(weight > 0, xp.minimum(left, light), left)
    most, inside = sides // side, carried // side[:2]
    along = []  # as far as the rectangle reaches, or over its edge along x or along y
    for axis in (0, 1):
        least = -(-needed // side[1 - axis])
        if now.firm.size:
            least = xp.maximum(least, side[axis] - before_centre(side[axis]))
        beyond = xp.where(carried[axis] >= least, 1 + (carried[axis] - least) // side[axis], 0)
        reach = [inside[0], inside[1], most[2]]
        reach[axis] = xp.minimum(beyond, most[axis])
        along.append(xp.stack(reach))
    number = xp.stack(along, 1)  # [3, 2, C]
    less = goods.less[:, row, lane] >> (2 * (now.used % SHORTER))[lane] & 3
    number = xp.where(number > 1, xp.maximum(number - less[:, None], 1), number)
    grids = []
    for turns in axes:
        room, grid = copies[None], [None] * 3
        for axis in turns:
            grid[axis] = xp.minimum(number[axis], room)
            room = room // xp.maximum(grid[axis], 1)
        grids.append(xp.stack(grid))
    grid = xp.concatenate(grids, 1)
    grid = xp.where((grid > 0).all(0) & space.there[lane], grid, 0)
    plenty = number.astype(np.float32).prod(0) <= copies  # it may be more than 31 bits
    same = (number[:, :1] == number[:, 1:]).all(0)
    first = xp.concatenate([same & False, same])
    return grid, xp.concatenate([first] + [first | plenty] * (len(axes) - 1))


def _worth(
    xp: Any,
    goods: Goods,
    now: Filling,
    space: Space,
    row: Any,
    lane: Any,
    grid: Any,
    judge: Judge | None,
) -> Any:
    """What blocks are worth less what they spoil, minus infinity where there is none: float32
    [n].
    """
    side = goods.side[:, row, lane]
    extent = xp.where(grid > 0, grid * side, 0)
    gap = (space.high - space.low)[:, lane] - extent
    spoiled = (gap - goods.sums[goods.first[:, lane] + gap // goods.unit]).astype(np.float32)
    real = extent.astype(np.float32)
    face = xp.stack([real[1] * real[2], real[0] * real[2], real[0] * real[1]])
    worth = goods.value[row, lane] * grid.prod(0).astype(np.float32)
    worth = worth - goods.strict[lane] * (spoiled * face).sum(0)
    if judge:
        seen = features(xp, goods, now, space, Offer(row, lane, grid, extent, gap, spoiled))
        volume = (space.high - space.low).astype(np.float32).prod(0)
        worth = worth / xp.maximum(volume, 1)[lane] + judge(seen)
    return xp.where(grid[0] > 0, worth, -np.float32(np.inf))
