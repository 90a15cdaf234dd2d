"""Bins that are being filled with blocks, one in every lane, to make the value in them large.

A lane takes the lowest of its free spaces, of these the one nearest to a corner of the bin, and
puts the block there that is worth most: its items' value, less the volume that it spoils because no
sum of items' edges fills what is left beside it, and what a policy adds to that. The spaces are the
maximal free boxes (Lai and Chan, 1997). A block is a grid of items of one kind that are turned
alike. It may stand only where its corner of the space is carried: on the largest rectangle of tops
of one height there, beyond which its last row may stick out as far as the support allows. A space
in which nothing can stand sleeps until another top comes up at its height. `spaces` and `blocks`
are the two halves of a step.

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
    shortest: Any  # int32 [3, K, P], along each axis, of a kind however it is turned
    needed: Any  # int32 [R, P], area of an item's base that must be carried, 1 or more
    value: Any  # float32 [R, P], of an item as it stands, in units of volume
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
    firm: (
        Any  # int32 [4, M, P], near x and y, far x and y of what their tops carry on; or [4, 0, P]
    )
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
    firm: Any  # int32 [4, P], see `Filling`


def empty(xp: Any, goods: Goods, blocks: int, firm: bool = False) -> Filling:
    """Empty bins with room for so many blocks: one space, no block.

    Args:
        xp: `numpy` or `jax.numpy`.
        goods: what comes in.
        blocks: at most.
        firm: whether they carry only where they are carried, see `Rules.stability`.
    """
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
        firm=xp.zeros((4, blocks if firm else 0, P), np.int32),
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


def rows_of(xp: Any, table: Any, index: Any) -> Any:
    """Of [..., N, P] the rows at an index [P], or at several [n, P]: [..., P] or [..., n, P]."""
    if xp is np:
        *more, N, P = table.shape
        return table.reshape(*more, N * P).take(index * P + np.arange(P), -1)  # half the time
    several = index.reshape((1,) * (table.ndim - 2) + (-1, table.shape[-1]))
    found = xp.take_along_axis(table, several, -2)
    return found if index.ndim == 2 else found[..., 0, :]
