"""What online policies look at: the places that are worth a look, and the bin after each of them.

Axes: K places of a bin side by side, B bins, last. A sum or a minimum over cells is a loop over
rows here: XLA's own is thirty times slower over leading axes.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.packing.online import Offers, Setting, State
from jaxpack.packing.surface import Triple
from jaxpack.xla.programs import apart
from jaxpack.xla.target import target

PIECE = 128
"""Places that a core looks at together."""
NOWHERE = -1e9
"""The score of padding."""


class Places(NamedTuple):
    """Where the next item may stand; leaves [K, B], or some of these side by side [N]."""

    number: Array  # int32, of the offer
    there: Array  # bool, False for padding, which comes last
    sides: Triple  # of the item as it lies
    corner: Triple


Score = Callable[[Setting, State, Places], Array]
"""(what holds, bins [..., N], a place in each [N]) -> float32 [N]; the largest is taken."""


class Fits(NamedTuple):
    """What footprints find in bins seen from above, numbers [F, *batch]: F = l * w of a window."""

    flat: Array  # least height at which one lies flat and firm; H where it does nowhere
    flats: Array  # at how many positions it does
    space: Array  # the free height above these, summed up
    lowest: Array  # least height at which it comes to rest at all; H where it does nowhere


def places(setting: Setting, state: State, offers: Offers) -> Places:
    """The lowest K offers, as many as `Setting.most`, of those that meet an edge along x and y.

    An edge is a wall or a step between two cells: along each axis one end of the item has to be
    at one. What is left out stands in the open, with a gap beside it.
    """
    _, W, _ = setting.problem.bin
    edges = apart((state.heights >= 0).any(), partial(at_edges, setting), state, offers)
    number, there = _lowest(setting, offers.z, offers.allowed & edges)
    turn, spot = jnp.divmod(number, np.prod(setting.problem.bin[:2]))
    x, y = (leaf.astype(offers.z.dtype) for leaf in jnp.divmod(spot, W))
    length, width, height = (jnp.take_along_axis(side, turn, 0) for side in offers.sides)
    z = jnp.take_along_axis(offers.z.reshape(-1, number.shape[1]), number, 0)
    return Places(number, there, (length, width, height), (x, y, z))


def after(setting: Setting, state: State, place: Places) -> tuple[Array, Array]:
    """Bins from above once their next item stands there: (heights cell_dtype, firm bool) [L, W, N].

    Without walls; of the item itself only what lies on what is firm is firm.
    """
    L, W, _ = setting.problem.bin
    (length, width, height), (x, y, z) = place.sides, place.corner
    X, Y = (jnp.arange(side, dtype=z.dtype) for side in (L, W))
    X, Y = X[:, None, None], Y[:, None]
    covered = (x <= X) & (x + length > X) & (y <= Y) & (y + width > Y)
    before, firm = (leaf[:L, :W] for leaf in state)
    heights = jnp.where(covered, z + height, before)
    return heights, jnp.where(covered, (before == z) & firm, firm)


def scores(setting: Setting, score: Score, state: State, found: Places) -> Array:
    """The score of every place: float32 [K, B], `NOWHERE` of padding.

    On a CPU the places of all bins are looked at in pieces of `PIECE`, without the padding, which
    is about half of them.
    """
    K, B = found.there.shape
    size = min(PIECE, K * B) if target().whole_loops else K * B
    ends = jnp.cumsum(found.there.sum(0, dtype=jnp.int32))
    starts = jnp.concatenate([jnp.zeros(1, jnp.int32), ends[:-1]])

    def look_at(piece: Array, done: Array) -> Array:
        slot = piece * size + jnp.arange(size, dtype=jnp.int32)
        member = jnp.minimum((slot >= ends[:, None]).sum(0), B - 1)
        row = jnp.minimum(slot - starts[member], K - 1)
        places = jax.tree.map(lambda leaf: leaf[row, member], found)
        bins = jax.tree.map(lambda leaf: leaf[..., member], state)
        return jax.lax.dynamic_update_slice(done, score(setting, bins, places), [piece * size])

    nothing = jnp.zeros(-(-K * B // size) * size)
    done = jax.lax.fori_loop(0, -(-ends[-1] // size), look_at, nothing)
    return jnp.where(found.there, done[starts + jnp.arange(K)[:, None]], NOWHERE)


def at_edges(setting: Setting, state: State, offers: Offers) -> Array:
    """Whether an item would meet an edge along x and along y: bool [O, L, W, B]."""
    (L, W, _), (window_x, window_y) = setting.problem.bin, setting.problem.window
    inside = state.heights[:L, :W]
    x, y = (jnp.diff(inside, axis=axis) != 0 for axis in (0, 1))
    # Steps before cell 0, 1, ... and behind the last one, which walls are.
    ahead = ((1, 1 + window_x), (0, window_y), (0, 0)), ((0, window_x), (1, 1 + window_y), (0, 0))
    x = jnp.pad(x, ahead[0], constant_values=True)
    y = jnp.pad(y, ahead[1], constant_values=True)

    def of(length: Array, width: Array) -> Array:
        across = [x[:, e : e + W] & (e < width) for e in range(window_y)]
        along = [y[d : d + L] & (d < length) for d in range(window_x)]
        in_x, in_y = (jnp.stack(steps).any(0) for steps in (across, along))
        far_x = [in_x[d : d + L] & (length == d) for d in range(1, window_x + 1)]
        far_y = [in_y[:, e : e + W] & (width == e) for e in range(1, window_y + 1)]
        near_or_far = [in_x[:L], *far_x], [in_y[:, :W], *far_y]
        meets = [jnp.stack(ends).any(0) for ends in near_or_far]
        return meets[0] & meets[1]

    return jnp.stack([of(*size) for size in zip(*offers.sides[:2], strict=True)])


def _lowest(setting: Setting, z: Array, allowed: Array) -> tuple[Array, Array]:
    """(numbers int32 [K, B], bool [K, B] which of them are any) of the allowed with the least z."""
    B, H, most = z.shape[-1], setting.problem.bin[2], setting.most
    z = jnp.where(allowed, z, H).reshape(-1, B).T
    N = z.shape[1]
    # Of equal ones the first. In float32, for which XLA has a partial sort on a CPU: exact up to
    # 2^24, so in bins up to 140 x 140 x 140 cells.
    rank = z * np.float32(N) + np.arange(N, dtype=np.float32)
    rank = jnp.pad(rank, ((0, 0), (0, max(0, most - N))), constant_values=H * N)
    least, numbers = jax.lax.top_k(-rank, most)
    return jnp.minimum(numbers, N - 1).T, (-least < H * N).T


def fits(setting: Setting, heights: Array, firm: Array, window: tuple[int, int]) -> Fits:
    """What every footprint up to a window finds in bins.

    Args:
        heights: cell_dtype [L, W, *batch].
        firm: bool [L, W, *batch].
        window: the largest length and width, at most those of the bin.
    """
    (L, W, H), batch, N = setting.problem.bin, heights.shape[2:], heights[0, 0].size
    dtype = heights.dtype
    wall = np.iinfo(dtype).max
    heights, firm = (leaf.reshape(L, W, N) for leaf in (heights, firm))
    beyond = ((0, window[0] - 1), (0, window[1] - 1), (0, 0))
    high = jnp.pad(heights, beyond, constant_values=wall)
    low = jnp.pad(jnp.where(firm, heights, -1), beyond, constant_values=-1)
    lengths, widths = (jnp.arange(side) for side in window)

    def more(ends: tuple[Array, Array], of: tuple[Array, Array], at: Array, axis: int) -> tuple:
        size = (L, W)[axis]
        high, low = (jax.lax.dynamic_slice_in_dim(leaf, at, size, axis) for leaf in of)
        return jnp.maximum(ends[0], high), jnp.minimum(ends[1], low)

    def longer(rows: tuple, length: Array) -> tuple[tuple, tuple]:
        rows = more(rows, (high, low), length, 0)

        def wider(ends: tuple, width: Array) -> tuple[tuple, tuple]:
            ends = more(ends, rows, width, 1)
            return ends, _found(H, *ends)

        nothing = jnp.full((L, W, N), -1, dtype), jnp.full((L, W, N), wall, dtype)
        return rows, jax.lax.scan(wider, nothing, widths)[1]

    nothing = (jnp.full_like(high[:L], -1), jnp.full_like(high[:L], wall))
    _, found = jax.lax.scan(longer, nothing, lengths)
    return Fits(*(leaf.reshape(-1, *batch) for leaf in found))


def _found(H: int, high: Array, low: Array) -> tuple[Array, ...]:
    """`Fits` of one footprint: [N] each, of the ends of what is under it at each position."""
    L, W, N = high.shape
    least, narrow = jnp.full((W, N), H, high.dtype), high.dtype
    wide = jnp.int16 if np.iinfo(np.int16).max >= L * W * H else jnp.int32

    def row(x: Array, now: tuple) -> tuple:
        flat, flats, space, lowest = now
        here, level = high[x] == low[x], high[x]
        return (
            jnp.minimum(flat, jnp.where(here, level, H).astype(narrow)),
            flats + here,
            space + jnp.where(here, H - level, 0).astype(wide),
            jnp.minimum(lowest, level),
        )

    zeros = jnp.zeros((W, N), wide)
    rows = jax.lax.fori_loop(0, L, row, (least, zeros, zeros, least))

    def column(y: Array, now: tuple) -> tuple:
        (flat, flats, space, lowest), this = now, [leaf[y] for leaf in rows]
        lowest = jnp.minimum(lowest, this[3])
        return jnp.minimum(flat, this[0]), flats + this[1], space + this[2], lowest

    return jax.lax.fori_loop(1, W, column, tuple(leaf[0] for leaf in rows))


def levels(setting: Setting, heights: Array) -> Array:
    """How many cells of [L, W, *batch] are 0, 1, ... H high: int16 [H + 1, *batch]."""
    (L, W, H), batch = setting.problem.bin, heights.shape[2:]
    cells = heights.reshape(L * W, -1)
    level = jnp.arange(H + 1, dtype=cells.dtype)[:, None]

    def count(i: Array, found: Array) -> Array:
        return found + (cells[i] == level)

    found = jax.lax.fori_loop(0, L * W, count, jnp.zeros((H + 1, cells.shape[1]), jnp.int16))
    return found.reshape(-1, *batch)


def roughness(heights: Array) -> tuple[Array, Array]:
    """(sum of the steps between neighbouring cells, how many there are): int16 [*batch] each.

    Args:
        heights: cell_dtype [L, W, *batch].
    """
    (L, W), batch = heights.shape[:2], heights.shape[2:]
    cells = heights.reshape(L, W, -1)

    def row(x: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        this = cells[x].astype(jnp.int16)
        along = abs(this - cells[jnp.maximum(x - 1, 0)])
        across = abs(this - jnp.concatenate([this[:1], this[:-1]]))
        return now[0] + along + across, now[1] + (along > 0) + (across > 0)

    zeros = jnp.zeros(cells.shape[1:], jnp.int16)
    rows = jax.lax.fori_loop(0, L, row, (zeros, zeros))

    def column(y: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        return now[0] + rows[0][y], now[1] + rows[1][y]

    steps, number = jax.lax.fori_loop(1, W, column, (rows[0][0], rows[1][0]))
    return steps.reshape(batch), number.reshape(batch)
