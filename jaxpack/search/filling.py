"""Fills one bin of every lane with blocks, to make the value of its contents large.

A lane takes the lowest of its free spaces, of these the one nearest to a corner of the bin, and
puts the block there that is worth most: its items' value, less the volume that it spoils because no
sum of items' edges fills what is left beside it. The spaces are the maximal free boxes (Lai and
Chan, 1997). A block is a grid of items of one kind that are turned alike. It may stand only where
its corner of the space is carried: on the largest rectangle of tops of one height there, beyond
which its last row may stick out as far as the support allows. A space in which nothing can stand
sleeps until another top comes up at its height.

Every array has the lanes last; M are blocks and S spaces of a bin, K kinds, R kinds in their
orientations. The functions take NumPy's or JAX's arrays, and give the same to the bit.
"""

from typing import Any, NamedTuple

import numpy as np

SPACES, BLOCKS = 24, 96
"""Most free boxes that are remembered, and most blocks in a bin."""
CUT, TOPS = 4, 4
"""Free boxes that a block is cut out of, and tops beside each other that are seen."""
FAR = 2**31 - 1  # units, more than any side
Axes = tuple[tuple[int, ...], ...]


class Goods(NamedTuple):
    """What may come into the bins. R rows are K kinds, each in O orientations."""

    side: Any  # int32 [3, R, P], units; FAR for an orientation that there is not
    needed: Any  # int32 [R, P], area of an item's base that must be carried, 1 or more
    value: Any  # float32 [K, P], of an item, in units of volume
    weight: Any  # int32 [K, P]
    count: Any  # int32 [K, P], copies that may come in
    room: Any  # int32 [3, P], units, of the bin
    limit: Any  # int32 [P], of weight
    sums: Any  # int32 [3 L], by length in its unit: the longest sum of edges that is not longer
    first: Any  # int32 [3, P], where in it an axis begins
    unit: Any  # int32[], units, of the lengths in `sums`
    less: Any  # int32 [3, R, P], items that a block is shorter by than it could be
    strict: Any  # float32 [P], what spoiled volume counts


class Filling(NamedTuple):
    """Bins that are being filled."""

    low: Any  # int32 [3, S, P], near corners of the free spaces
    high: Any  # int32 [3, S, P]; equal to `low` where there is none
    awake: Any  # bool [S, P]
    near: Any  # int32 [3, M, P], of the blocks, in their order
    far: Any  # int32 [3, M, P]
    row: Any  # int32 [M, P]
    grid: Any  # int32 [3, M, P], items along each axis
    used: Any  # int32 [P], blocks
    left: Any  # int32 [K, P], copies that are not packed
    load: Any  # int32 [P], weight that may still come in


class Space(NamedTuple):
    """The one that each lane fills next."""

    which: Any  # int32 [P]
    there: Any  # bool [P]
    low: Any  # int32 [3, P]
    high: Any
    turned: Any  # bool [2, P], whether its corner is the far one along x and along y
    carried: Any  # int32 [2, P], sides of the rectangle at that corner that carries


class Block(NamedTuple):
    """What is put there."""

    found: Any  # bool [P]
    row: Any  # int32 [P]
    grid: Any  # int32 [3, P]
    near: Any  # int32 [3, P]
    far: Any


def empty(xp: Any, goods: Goods, blocks: int) -> Filling:
    """Empty bins with room for so many blocks: one space, no block."""
    P = goods.room.shape[1]
    first = (xp.arange(SPACES) == 0)[:, None]
    nothing = xp.zeros((3, blocks, P), np.int32)
    return Filling(
        low=xp.zeros((3, SPACES, P), np.int32),
        high=xp.where(first, goods.room[:, None], 0).astype(np.int32),
        awake=xp.broadcast_to(first, (SPACES, P)),
        near=nothing,
        far=nothing,
        row=xp.zeros((blocks, P), np.int32),
        grid=nothing,
        used=xp.zeros(P, np.int32),
        left=goods.count,
        load=goods.limit,
    )


def goes_on(now: Filling) -> Any:
    """Whether any lane has a space that is awake: bool[]."""
    return (now.awake & (now.high > now.low).all(0)).any()


def step(xp: Any, axes: Axes, goods: Goods, now: Filling) -> Filling:
    """Puts one block into every lane, or puts its space to sleep.

    Args:
        xp: `numpy` or `jax.numpy`.
        axes: orders in which a block grows along the axes, where copies run short; static.
    """
    space = _next_space(xp, goods, now)
    block = _best_block(xp, axes, goods, now, space)
    asleep = (xp.arange(SPACES)[:, None] == space.which) & ~block.found
    low, high, awake = _without(xp, goods, now, block)
    here = (xp.arange(len(now.row))[:, None] == now.used) & block.found
    K, R = len(goods.value), goods.side.shape[1]
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


def _next_space(xp: Any, goods: Goods, now: Filling) -> Space:
    there = now.awake & (now.high > now.low).all(0)
    length, width, _ = goods.room[:, None]
    corner = xp.minimum(now.low[0], length - now.high[0]) + xp.minimum(
        now.low[1], width - now.high[1]
    )
    chosen = there
    for key in (now.low[2], corner):
        key = xp.where(chosen, key, FAR)
        chosen = chosen & (key == key.min(0))
    volume = (now.high - now.low).astype(np.float32).prod(0)
    which = xp.where(chosen, volume, np.float32(-1)).argmax(0)
    low, high = (_row(xp, corners, which) for corners in (now.low, now.high))
    turned = low[:2] > goods.room[:2] - high[:2]
    carried = _carried(xp, now, low, high, turned)
    return Space(which, there.any(0), low, high, turned, carried)


def _carried(xp: Any, now: Filling, low: Any, high: Any, turned: Any) -> Any:
    """The largest rectangle at the corner that is all tops, or the floor: int32 [2, P]."""
    sides = high[:2] - low[:2]
    beside = ((now.near[:2] < high[:2, None]) & (now.far[:2] > low[:2, None])).all(0)
    carries = beside & (now.far[2] == low[2]) & (xp.arange(len(now.row))[:, None] < now.used)
    nth = xp.cumsum(carries, 0)
    some = (nth == xp.arange(1, TOPS + 1)[:, None, None]) & carries  # [TOPS, M, P]
    there = some.any(1)
    index = some.argmax(1)
    near, far = (xp.take_along_axis(side[:2], index[None], 1) for side in (now.near, now.far))
    # From the corner on.
    flip = turned[:, None]
    start = xp.maximum(xp.where(flip, high[:2, None] - far, near - low[:2, None]), 0)
    end = xp.minimum(xp.where(flip, high[:2, None] - near, far - low[:2, None]), sides[:, None])
    over = xp.maximum(xp.minimum(end[:, :, None], end[:, None]) - start[:, None], 0)
    over = xp.where(there[None, None], over, 0)  # [2, TOPS: up to its end, TOPS: of this, P]
    covered = (over[0][:, None] * over[1][None]).sum(2)  # [TOPS, TOPS, P]
    area = end[0][:, None] * end[1][None]
    whole = (covered == area) & there[:, None] & there[None]
    area = xp.where(whole, area, 0).reshape(TOPS * TOPS, -1)
    best = area.argmax(0)
    found = xp.stack([_row(xp, end[0], best // TOPS), _row(xp, end[1], best % TOPS)])
    found = xp.where(area.max(0) > 0, found, 0)
    return xp.where(low[2] == 0, sides, found)


def _best_block(xp: Any, axes: Axes, goods: Goods, now: Filling, space: Space) -> Block:
    K, R = len(goods.value), goods.side.shape[1]
    kind = np.arange(R) // (R // K)
    sides = space.high - space.low
    most = sides[:, None] // goods.side  # [3, R, P]
    light = now.load // xp.maximum(goods.weight, 1)
    copies = xp.where(goods.weight > 0, xp.minimum(now.left, light), now.left)[kind]  # [R, P]
    along = []  # as far as the rectangle reaches, or over its edge along x or along y
    for axis in (0, 1):
        inside = space.carried[:, None] // goods.side[:2]
        least = -(-goods.needed // goods.side[1 - axis])
        beyond = xp.where(
            space.carried[axis] >= least, 1 + (space.carried[axis] - least) // goods.side[axis], 0
        )
        reach = [inside[0], inside[1], most[2]]
        reach[axis] = xp.minimum(beyond, most[axis])
        along.append(xp.stack(reach))
    number = xp.stack(along, 1)  # [3, 2, R, P]
    number = xp.where(number > 1, xp.maximum(number - goods.less[:, None], 1), number)
    grids = []
    for turns in axes:
        room, grid = copies[None], [None] * 3
        for axis in turns:
            grid[axis] = xp.minimum(number[axis], room)
            room = room // xp.maximum(grid[axis], 1)
        grids.append(xp.stack(grid))
    grid = xp.stack(grids, 1).reshape(3, -1, R, sides.shape[1])  # [3, V, R, P]
    extent = grid * xp.where(goods.side == FAR, 0, goods.side)[:, None]
    gap = xp.maximum(sides[:, None, None] - extent, 0)
    spoiled = (gap - goods.sums[goods.first[:, None, None] + gap // goods.unit]).astype(np.float32)
    real = extent.astype(np.float32)
    face = xp.stack([real[1] * real[2], real[0] * real[2], real[0] * real[1]])
    worth = goods.value[kind] * grid.prod(0).astype(np.float32)
    worth = worth - goods.strict * (spoiled * face).sum(0)
    able = (grid > 0).all(0) & space.there
    worth = xp.where(able, worth, -np.float32(np.inf)).reshape(-1, sides.shape[1])
    best = worth.argmax(0)
    found = able.reshape(worth.shape).any(0)
    grid, extent = (_row(xp, leaf.reshape(3, *worth.shape), best) for leaf in (grid, extent))
    near = xp.concatenate(
        [xp.where(space.turned, space.high[:2] - extent[:2], space.low[:2]), space.low[2:]]
    )
    return Block(found, (best % R).astype(np.int32), grid, near, near + extent)


def _without(xp: Any, goods: Goods, now: Filling, block: Block) -> tuple[Any, Any, Any]:
    """(low, high, awake) of the spaces that are left around the block."""
    near, far = block.near[:, None], block.far[:, None]
    there = (now.high > now.low).all(0)
    hit = ((now.low < far) & (now.high > near)).all(0) & there & block.found
    nth = xp.cumsum(hit, 0)
    some = (nth == xp.arange(1, CUT + 1)[:, None, None]) & hit  # [CUT, S, P]
    cut, index = some.any(1), some.argmax(1)
    low, high = (xp.take_along_axis(side, index[None], 1) for side in (now.low, now.high))
    lows, highs = [], []
    for axis in range(3):
        along = (np.arange(3) == axis)[:, None, None]
        lows += [low, xp.where(along, far, low)]
        highs += [xp.where(along, near, high), high]
    low, high = xp.concatenate(lows, 1), xp.concatenate(highs, 1)  # [3, 6 CUT, P]
    waiting = (now.left > 0)[
        np.arange(goods.side.shape[1]) // (goods.side.shape[1] // len(now.left))
    ]
    least = xp.where(waiting, goods.side, FAR).min(1)
    good = (high - low >= least[:, None]).all(0) & xp.concatenate([cut] * 6, 0)
    stays = there & ~hit
    n = len(good)
    inside_old = (
        (low[:, :, None] >= now.low[:, None]) & (high[:, :, None] <= now.high[:, None])
    ).all(0)
    inside_old = (inside_old & stays[None]).any(1)
    inside = ((low[:, :, None] >= low[:, None]) & (high[:, :, None] <= high[:, None])).all(0)
    same = inside & xp.swapaxes(inside, 0, 1)
    earlier = (np.arange(n)[:, None] > np.arange(n)[None])[:, :, None]
    inside_new = (inside & good[None] & (~same | earlier)).any(1)
    good = good & ~inside_old & ~inside_new
    # The n-th of them into the n-th slot that is free.
    slot, which = xp.cumsum(~stays, 0), xp.cumsum(good, 0)
    match = (slot[:, None] == which[None]) & good[None] & ~stays[:, None]  # [S, 6 CUT, P]
    comes, source = match.any(1), match.argmax(1)
    new_low, new_high = (xp.take_along_axis(side, source[None], 1) for side in (low, high))
    keep = stays & ~comes
    above = (now.low[2] == block.far[2]) & block.found
    above = above & ((now.low[:2] < far[:2]) & (now.high[:2] > near[:2])).all(0)
    return (
        xp.where(comes, new_low, xp.where(keep, now.low, 0)),
        xp.where(comes, new_high, xp.where(keep, now.high, 0)),
        comes | (keep & (now.awake | above)),
    )


def _row(xp: Any, table: Any, index: Any) -> Any:
    """[..., P] of [..., N, P]."""
    shape = (1,) * (table.ndim - 1) + index.shape
    return xp.take_along_axis(table, index.reshape(shape), -2)[..., 0, :]


def longest_sums(edges: np.ndarray, copies: np.ndarray, length: int) -> np.ndarray:
    """For every length up to `length` the longest sum of edges that is not longer: int32.

    Args:
        edges: int [n], units.
        copies: int [n], of each at most.
    """
    reached = np.zeros(length + 1, bool)
    reached[0] = True
    for edge, most in zip(edges.tolist(), copies.tolist(), strict=True):
        part = 1
        while most > 0 and edge * part <= length:
            part = min(part, most)
            reached[edge * part :] |= reached[: length + 1 - edge * part].copy()
            most, part = most - part, 2 * part
    return np.maximum.accumulate(np.where(reached, np.arange(length + 1), 0)).astype(np.int32)
