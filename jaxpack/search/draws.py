"""Fillings of bins in many lanes side by side: what may come in, with noise, and what came in."""

import numpy as np

from jaxpack.search import filling
from jaxpack.search.filling import FAR, Filling, Goods
from jaxpack.search.fillings import Filled, Kinds

LARGER = 1.3  # exponent of the size in the first values: large items are worth more than theirs
DRAWN, TURNED = 1.0, 0.6  # noise on the values of a draw at most, and on those of orientations
LESS, MORE = 0.4, 0.4  # chance that a block is shorter along an axis, and then by one more
PLAIN = 4  # draws whose blocks are as large as can be; two of these without noise
STRICT = (0.25, 0.5, 1.0, 2.0)  # weights of spoiled volume that draws choose from


def by_size(kinds: Kinds) -> np.ndarray:
    """The first values of all kinds: float [K]."""
    value: np.ndarray = kinds.size * (kinds.size / kinds.size.mean()) ** (LARGER - 1)
    return value


def drawn(
    kinds: Kinds,
    which: np.ndarray,
    value: np.ndarray,
    left: np.ndarray,
    types: np.ndarray,
    sums: np.ndarray,
    table: np.ndarray,
    draw: np.ndarray,
    random: np.random.Generator,
) -> tuple[Goods, np.ndarray]:
    """What may come into a bin of every lane; and which lanes have x and y exchanged: bool [P].

    Args:
        which: int [K, P], the kinds of every lane, -1 where it has less.
        value: float [K, P] or [K, 1], of an item.
        left: int32 [K, P] or [K, 1], copies.
        types: int [P], of the bins.
        sums: int32 [3 n, L], longest sums of edges for n choices of kinds.
        table: int [P], which of these choices is the lane's.
        draw: int [P], number of the draw: the first four have less noise than all others, or none.
        random: of the noise.
    """
    (K, P), ways = which.shape, kinds.ways
    swapped = (draw % 2 == 1) & (not kinds.loading.flat)
    rows = (which[:, None] * ways + np.arange(ways)[:, None]).reshape(-1, P)
    side = np.where(np.repeat(which < 0, ways, 0), FAR, kinds.side[:, rows])

    def turned(table: np.ndarray) -> np.ndarray:
        return np.where(swapped, table[[1, 0, 2]], table)

    noise = DRAWN * random.random(P) * random.standard_normal((K, P))
    noise = np.repeat(noise, ways, 0)
    noise += TURNED * random.random(P) * random.standard_normal(noise.shape)
    strict = random.choice(STRICT, P)
    less = np.zeros((3, len(rows), P), int)
    if kinds.count.max() > 1 and (draw >= PLAIN).any():
        # In half of the lanes by the same number all the time, in the others from block to block.
        chance = random.random((filling.SHORTER, *less.shape))
        chance = np.where(draw % 4 < 2, chance[0], chance)
        shorter = np.where(chance < LESS, 1 + (chance < LESS * MORE) + (chance < LESS * MORE**2), 0)
        less = (shorter << 2 * np.arange(filling.SHORTER)[:, None, None, None]).sum(0)
    # The first two as they are, the next two with the largest blocks.
    noise[:, draw < 2], strict[draw < 2], less[..., draw < PLAIN] = 0, 1, 0
    starts = (3 * table + np.arange(3)[:, None]) * sums.shape[1]
    side = turned(side)
    goods = Goods(
        side=side,
        shortest=side.reshape(3, K, ways, P).min(2),
        needed=kinds.needed[rows],
        value=(np.repeat(value, ways, 0) * np.exp(noise)).astype(np.float32),
        weight=kinds.weight[which],
        count=np.broadcast_to(left, (K, P)).astype(np.int32),
        room=turned(kinds.loading.stock.bins[kinds.bins[types]].T),
        limit=kinds.limit[types],
        sums=sums.ravel(),
        first=turned(starts).astype(np.int32),
        unit=np.int32(kinds.unit),
        less=less.astype(np.int32),
        strict=strict.astype(np.float32),
    )
    return goods, swapped


def filled_lane(
    kinds: Kinds, done: Filling, lane: int, which: np.ndarray, type: int, swapped: bool
) -> Filled:
    """What a lane has in its bin of a type; `which` are the lane's kinds: int [K]."""
    used, axes = int(done.used[lane]), [1, 0, 2] if swapped else [0, 1, 2]
    ways = kinds.ways
    row, grid, near = (leaf[..., :used, lane] for leaf in (done.row, done.grid, done.near))
    kind = which[row // ways]
    held = np.bincount(kind, grid.prod(0), len(kinds.count)).astype(np.int32)
    return Filled(type, held, kind * ways + row % ways, grid[axes], near[axes])
