"""The free boxes of bins: which one is filled next, and what a block leaves of them."""

from typing import Any

import numpy as np

from jaxpack.search.filling import CUT, FAR, TOPS, Block, Filling, Goods, Space, rows_of


def next_space(xp: Any, goods: Goods, now: Filling) -> Space:
    """The lowest one that is awake, the one nearest to a corner of these, the largest of these."""
    there = now.awake & (now.high > now.low).all(0)
    if xp is np:  # as many slots as are used
        there = there[: _last(there)]
        now = now._replace(low=now.low[:, : len(there)], high=now.high[:, : len(there)])
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
    low, high = (rows_of(xp, corners, which) for corners in (now.low, now.high))
    turned = low[:2] > goods.room[:2] - high[:2]
    carried = _carried(xp, now, low, high, turned)
    return Space(which, there.any(0), low, high, turned, carried)


def _carried(xp: Any, now: Filling, low: Any, high: Any, turned: Any) -> Any:
    """The largest rectangle at the corner that is all tops, where they are firm if that is asked,
    or the floor: int32 [2, P].
    """
    sides = high[:2] - low[:2]
    # NumPy's arrays are as long as they have to be.
    M = len(now.row) if xp is not np else max(1, int(now.used.max()))
    nears, fars = now.near[:2, :M], now.far[:2, :M]
    if now.firm.size:
        nears, fars = now.firm[:2, :M], now.firm[2:, :M]
    beside = ((nears < high[:2, None]) & (fars > low[:2, None])).all(0)
    carries = beside & (now.far[2, :M] == low[2]) & (xp.arange(M)[:, None] < now.used)
    nth = xp.cumsum(carries, 0)
    some = (nth == xp.arange(1, TOPS + 1)[:, None, None]) & carries  # [TOPS, M, P]
    there = some.any(1)
    index = some.argmax(1)
    near, far = (rows_of(xp, side, index) for side in (nears, fars))
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
    found = xp.stack([rows_of(xp, end[0], best // TOPS), rows_of(xp, end[1], best % TOPS)])
    found = xp.where(area.max(0) > 0, found, 0)
    return xp.where(low[2] == 0, sides, found)


def without(xp: Any, goods: Goods, now: Filling, block: Block) -> tuple[Any, Any, Any]:
    """(low, high, awake) of the spaces that are left around the block."""
    near, far = block.near[:, None], block.far[:, None]
    S, there = len(now.awake), (now.high > now.low).all(0)
    if xp is np:
        there = there[: _last(there)]
        now = now._replace(low=now.low[:, : len(there)], high=now.high[:, : len(there)])
    hit = ((now.low < far) & (now.high > near)).all(0) & there & block.found
    nth = xp.cumsum(hit, 0)
    most = CUT if xp is not np else min(CUT, max(1, int(nth[-1].max())))
    some = (nth == xp.arange(1, most + 1)[:, None, None]) & hit  # [CUT, S, P]
    cut, index = some.any(1), some.argmax(1)
    low, high = (rows_of(xp, side, index) for side in (now.low, now.high))
    lows, highs = [], []
    for axis in range(3):
        along = (np.arange(3) == axis)[:, None, None]
        lows += [low, xp.where(along, far, low)]
        highs += [xp.where(along, near, high), high]
    low, high = xp.concatenate(lows, 1), xp.concatenate(highs, 1)  # [3, 6 CUT, P]
    least = xp.where(now.left > 0, goods.shortest, FAR).min(1)
    good = (high - low >= least[:, None]).all(0) & xp.concatenate([cut] * 6, 0)
    if xp is np:
        some = np.argsort(~good, 0, kind="stable")[: max(1, int(good.sum(0).max()))]
        good = rows_of(np, good, some)
        low, high = (rows_of(np, side, some) for side in (low, high))
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
    more = (S if xp is not np else min(S, len(stays) + n)) - len(stays)
    stays = xp.pad(stays, ((0, more), (0, 0)))
    old_low, old_high = (xp.pad(old, ((0, 0), (0, more), (0, 0))) for old in (now.low, now.high))
    # The n-th of them into the n-th slot that is free.
    slot, which = xp.cumsum(~stays, 0), xp.cumsum(good, 0)
    match = (slot[:, None] == which[None]) & good[None] & ~stays[:, None]  # [S, 6 CUT, P]
    comes, source = match.any(1), match.argmax(1)
    new_low, new_high = (rows_of(xp, side, source) for side in (low, high))
    keep = stays & ~comes
    above = (old_low[2] == block.far[2]) & block.found
    above = above & ((old_low[:2] < far[:2]) & (old_high[:2] > near[:2])).all(0)
    rest = ((0, S - len(comes)), (0, 0))
    return (
        xp.pad(xp.where(comes, new_low, xp.where(keep, old_low, 0)), ((0, 0), *rest)),
        xp.pad(xp.where(comes, new_high, xp.where(keep, old_high, 0)), ((0, 0), *rest)),
        xp.pad(comes | (keep & (now.awake[: len(comes)] | above)), rest),
    )


def _last(there: np.ndarray) -> int:
    """How many rows of [S, P] have something, up to the last of these."""
    rows = np.flatnonzero(there.any(1))
    return int(rows[-1]) + 1 if len(rows) else 1
