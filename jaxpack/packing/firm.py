"""What carries an item beyond its centre, and what its top then carries: see `Rules.stability`.

Kernels know of every item a rectangle that carries, within the hull of what it rests on itself. An
item may stand where each quarter of its base has some of these beyond the centre: its centre, with
a margin on all sides, is within their hull then.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from jaxpack.model.rules import before_centre

QUARTERS = 15
"""A bit for each quarter of a base: near and far along x, each with near and far along y."""
_BITS = ((0b0011, 0b1100), (0b0101, 0b1010))
_ENDS = ((0, 0), (0, 1), (1, 0), (1, 1))  # along x and y, near or far, of each bit


def beyond(xp: Any, start: Any, side: Any, axis: int) -> Callable[[Any, Any], Any]:
    """(near, far) of what carries -> the quarters of bases that it is in, beyond the centre: int8.

    Args:
        xp: `numpy` or `jax.numpy`.
        start, side: of the bases along an axis, 0 or 1.
        axis: that.
    """
    before, end = before_centre(side), start + side
    first, last = start + before, end - before
    near_bits, far_bits = (np.int8(bits) for bits in _BITS[axis])

    def quarters(near: Any, far: Any) -> Any:
        near_half = xp.where((near <= first) & (far > start), near_bits, np.int8(0))
        far_half = xp.where((far >= last) & (near < end), far_bits, np.int8(0))
        return near_half | far_half

    return quarters


def held(
    xp: Any, least: Callable[[Any], Any], base: tuple, firm: tuple, there: Any, area: np.dtype
) -> tuple[Any, Any, Any, Any]:
    """Near x, far x, near y, far y of a rectangle within the hull of what carries an item: [B].

    In each quarter of its base that counts which reaches farthest from the centre, by the product
    along x and y, of equal ones the first; the rectangle ends where the nearer one of two does.

    Args:
        xp: `numpy` or `jax.numpy`.
        least: array -> its minimum over the first axis.
        base: near x, far x, near y, far y of the item [B], which is carried beyond its centre.
        firm: likewise what may carry it [M, B].
        there: bool [M, B], which of these lies directly under it.
        area: a type for products of lengths.
    """
    near_x, far_x, near_y, far_y = base
    ends = [
        (xp.maximum(firm[0], near_x), xp.minimum(firm[1], far_x)),
        (xp.maximum(firm[2], near_y), xp.minimum(firm[3], far_y)),
    ]
    twice = [(near_x + far_x).astype(area), (near_y + far_y).astype(area)]
    quarters = beyond(xp, near_x, far_x - near_x, 0)(firm[0], firm[1])
    quarters &= beyond(xp, near_y, far_y - near_y, 1)(firm[2], firm[3])
    index = np.arange(len(there), dtype=np.int32)[:, None]
    found = []
    for bit, chosen in enumerate(_ENDS):
        mine = there & ((quarters >> np.int8(bit)) & np.int8(1) == 1)
        reach = [
            abs(2 * ends[axis][end].astype(area) - twice[axis]) for axis, end in enumerate(chosen)
        ]
        worth = xp.where(mine, -(reach[0] * reach[1]), area.type(1))
        first = least(xp.where(worth == least(worth), index, np.int32(len(there))))
        # Of one row the number is what it is, of the others nothing.
        found.append(
            [
                least(xp.where(index == first, ends[axis][end], np.iinfo(firm[0].dtype).max))
                for axis, end in enumerate(chosen)
            ]
        )
    return (
        xp.maximum(found[0][0], found[1][0]),
        xp.minimum(found[2][0], found[3][0]),
        xp.maximum(found[0][1], found[2][1]),
        xp.minimum(found[1][1], found[3][1]),
    )
