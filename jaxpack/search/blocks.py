"""Puts one block into a bin of every lane: which ones there are to choose from, and what each is
worth.
"""

from typing import Any

import numpy as np

from jaxpack.search.block_policy import Judge, Offer, features
from jaxpack.search.filling import SHORTER, Axes, Block, Filling, Goods, Space, rows_of
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
    low, high, awake = without(xp, goods, now, block)
    here = (xp.arange(len(now.row))[:, None] == now.used) & block.found
    K, R = len(goods.count), goods.side.shape[1]
    mine = (xp.arange(K)[:, None] == block.row // (R // K)) & block.found
    taken = xp.where(mine, block.grid.prod(0), 0).astype(np.int32)
    left, used = now.left - taken, now.used + block.found.astype(np.int32)
    over = (used >= len(now.row)) | ~(left > 0).any(0)
    return Filling(
        low,
        high,
        awake & ~asleep & ~over,
        xp.where(here, block.near[:, None], now.near),
        xp.where(here, block.far[:, None], now.far),
        xp.where(here, block.row, now.row).astype(np.int32),
        xp.where(here, block.grid[:, None], now.grid).astype(np.int32),
        used,
        left,
        now.load - (taken * goods.weight).sum(0).astype(np.int32),
    )


def _best_block(
    xp: Any, axes: Axes, goods: Goods, now: Filling, space: Space, nth: Any, judge: Judge | None
) -> Block:
    R, P = goods.side.shape[1:]
    row, lane = _offered(xp, goods, now, space)
    grid, again = _grids(xp, axes, goods, now, space, row, lane)
    V = grid.shape[1]
    if xp is np:
        turn, which = np.nonzero((grid[0] > 0) & ~again)
        row, lane, grid = row[which], lane[which], grid[:, turn, which]
        worth = np.full((V, R, P), -np.inf, np.float32)
        worth[turn, row, lane] = _worth(xp, goods, now, space, row, lane, grid, judge)
    else:
        row, lane, grid = np.tile(row, V), np.tile(lane, V), grid.reshape(3, -1)
        worth = _worth(xp, goods, now, space, row, lane, grid, judge).reshape(V, R, P)
    most = worth.max(0)
    if nth is None:
        row = most.argmax(0)
    else:
        row = rows_of(xp, xp.argsort(-most, 0, stable=True), xp.minimum(nth, R - 1))
    turn = rows_of(xp, worth, row).argmax(0)
    found = (rows_of(xp, most, row) > -np.inf) & (nth is None or nth < R)
    row = row.astype(np.int32)
    grid = rows_of(xp, _grids(xp, axes, goods, now, space, row, np.arange(P))[0], turn)
    grid = xp.where(found, grid, 0)
    extent = xp.where(found, grid * goods.side[:, row, np.arange(P)], 0)
    near = xp.concatenate(
        [xp.where(space.turned, space.high[:2] - extent[:2], space.low[:2]), space.low[2:]]
    )
    return Block(found, row, grid, near, near + extent)


def _offered(xp: Any, goods: Goods, now: Filling, space: Space) -> tuple[Any, Any]:
    """(row int [C], lane int [C]) of the items that a block may be of; of all where their number
    must be known before.
    """
    R, P = goods.side.shape[1:]
    if xp is not np:
        return np.repeat(np.arange(R), P), np.tile(np.arange(P), R)
    fits = (goods.side <= (space.high - space.low)[:, None]).all(0) & space.there
    kind = np.arange(R) // (R // len(goods.count))
    row, lane = np.nonzero(fits & (now.left > 0)[kind])  # a tenth
    return row, lane


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
