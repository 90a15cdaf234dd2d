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

SPACES, BLOCKS = 32, 96
"""Most free boxes that are remembered, and most blocks in a bin."""
CUT, TOPS = 16, 4
"""Free boxes that a block is cut out of, and tops beside each other that are seen."""
SHORTER = 15  # blocks, after which they are shorter by the same numbers again
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
    less: Any  # int32 [3, R, P], two bits a block: items that it is shorter by than it could be
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
    """Which lanes have a space that is awake: bool [P]."""
    return (now.awake & (now.high > now.low).all(0)).any(0)


def some_lanes(of: Any, which: Any) -> Any:
    """Some lanes of goods or of bins: an index or a mask."""
    shared = ("sums", "unit") if isinstance(of, Goods) else ()
    return of._replace(
        **{name: getattr(of, name)[..., which] for name in of._fields if name not in shared}
    )


def step(xp: Any, axes: Axes, goods: Goods, now: Filling, nth: Any = None) -> Filling:
    """Puts one block into every lane, or puts its space to sleep.

    Args:
        xp: `numpy` or `jax.numpy`.
        axes: orders in which a block grows along the axes, where copies run short; static.
        nth: int32 [P], how many better blocks are passed over, each of another kind or orientation;
            none if not given.
    """
    space = _next_space(xp, goods, now)
    block = _best_block(xp, axes, goods, now, space, nth)
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


def _best_block(xp: Any, axes: Axes, goods: Goods, now: Filling, space: Space, nth: Any) -> Block:
    R, P = goods.side.shape[1:]
    row, lane = _offered(xp, goods, now, space)
    grid = _grids(xp, axes, goods, now, space, row, lane)
    worth = _worth(xp, goods, space, row, lane, grid)
    if xp is np:
        every = np.full((len(worth), R, P), -np.inf, np.float32)
        every[:, row, lane] = worth
        worth = every
    worth = worth.reshape(-1, R, P)
    most = worth.max(0)
    if nth is None:
        row = most.argmax(0)
    else:
        row = _row(xp, xp.argsort(-most, 0, stable=True), xp.minimum(nth, R - 1))
    turn = _row(xp, worth, row).argmax(0)
    found = (_row(xp, most, row) > -np.inf) & (nth is None or nth < R)
    row = row.astype(np.int32)
    grid = _row(xp, _grids(xp, axes, goods, now, space, row, np.arange(P)), turn)
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
    kind = np.arange(R) // (R // len(goods.value))
    row, lane = np.nonzero(fits & (now.left > 0)[kind])  # a tenth
    return row, lane


def _grids(
    xp: Any, axes: Axes, goods: Goods, now: Filling, space: Space, row: Any, lane: Any
) -> Any:
    """How many items along each axis a block would have, grown in every way: int32 [3, 2 V, C]."""
    kind = row // (goods.side.shape[1] // len(goods.value))
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
    return xp.where((grid > 0).all(0) & space.there[lane], grid, 0)


def _worth(xp: Any, goods: Goods, space: Space, row: Any, lane: Any, grid: Any) -> Any:
    """What blocks are worth less what they spoil, minus infinity where there is none: float32
    [V, C].
    """
    kind = row // (goods.side.shape[1] // len(goods.value))
    extent = grid * goods.side[:, row, lane][:, None]
    gap = (space.high - space.low)[:, lane][:, None] - extent
    gap = xp.maximum(gap, 0)
    first = goods.first[:, lane][:, None]
    spoiled = (gap - goods.sums[first + gap // goods.unit]).astype(np.float32)
    real = extent.astype(np.float32)
    face = xp.stack([real[1] * real[2], real[0] * real[2], real[0] * real[1]])
    worth = goods.value[kind, lane] * grid.prod(0).astype(np.float32)
    worth = worth - goods.strict[lane] * (spoiled * face).sum(0)
    return xp.where((grid > 0).all(0), worth, -np.float32(np.inf))


def _without(xp: Any, goods: Goods, now: Filling, block: Block) -> tuple[Any, Any, Any]:
    """(low, high, awake) of the spaces that are left around the block."""
    near, far = block.near[:, None], block.far[:, None]
    there = (now.high > now.low).all(0)
    hit = ((now.low < far) & (now.high > near)).all(0) & there & block.found
    nth = xp.cumsum(hit, 0)
    # NumPy's arrays are as long as they have to be.
    most = CUT if xp is not np else min(CUT, max(1, int(nth[-1].max())))
    some = (nth == xp.arange(1, most + 1)[:, None, None]) & hit  # [CUT, S, P]
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
    if xp is np:
        some = np.argsort(~good, 0, kind="stable")[: max(1, int(good.sum(0).max()))]
        good = np.take_along_axis(good, some, 0)
        low, high = (np.take_along_axis(side, some[None], 1) for side in (low, high))
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
