"""Packing one item at a time: where the next item may stand in a bin, and the bin once it does.

    state = empty(setting, batch)
    offers = look(setting, state, items)             # every orientation at every position
    state = place(setting, state, offers, choice)    # one number of an offer a bin

A bin is a height map, as everywhere on the grid, and where the setting asks for stability a map of
what is firm on top: see `Rules.stability`, whose `centre` this is, exactly. The firm part of an
item's top are the cells within the convex hull of the firm cells that it lies on; its centre, with
a margin, has to be over that hull. Whatever comes later, of any weight, nothing tips then.

Axes: O orientations, L and W cells of the floor, B bins side by side, last. An offer has a number
in O x L x W.
"""

import math
from dataclasses import dataclass
from functools import cache
from itertools import permutations
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.model.problem import Problem
from jaxpack.model.rules import MARGIN
from jaxpack.packing.height_map import cell_dtype, drop, empty_map, rest
from jaxpack.packing.surface import Triple

TURNS = {"none": ((0, 1, 2),), "upright": ((0, 1, 2), (1, 0, 2)), "all": (*permutations(range(3)),)}
"""Which of an item's sides lie along x, y and z."""
WORD = 32  # bits


@dataclass(frozen=True)
class Setting:
    """What holds while items come one by one; hashable, static under jit."""

    problem: Problem  # the bin; its window is the largest item's in any orientation
    turns: str = "upright"  # none, upright or all
    stable: bool = True  # whether an item's centre has to be over what is firm

    @property
    def most(self) -> int:
        """K, how many places of an item are looked at."""
        return 48 if len(TURNS[self.turns]) <= 2 else 96

    @property
    def high(self) -> int:
        """The longest side of an item."""
        return max(self.problem.window)


BIN = Problem((10, 10, 10), largest=(5, 5), support=0)
SETTINGS = {
    "online-1": Setting(BIN),
    "online-2": Setting(BIN, turns="all", stable=False),
    "online-3": Setting(BIN),
}
"""After those of Zhao, Yu and Xu, Learning efficient online 3D bin packing on packing configuration
trees (ICLR 2022). In 3 items have densities, which `stable` need not know."""


class State(NamedTuple):
    """What lies in the bins, seen from above."""

    heights: Array  # cell_dtype [L + window - 1, W + window - 1, B], with walls
    firm: Array  # bool, of the same shape: what may carry; all of it where nothing is asked


class Offers(NamedTuple):
    """Where items may stand."""

    sides: Triple  # cell_dtype [O, B] each
    z: Array  # cell_dtype [O, L, W, B], where the item would come to rest
    allowed: Array  # bool [O, L, W, B]


def empty(setting: Setting, batch: int) -> State:
    """Empty bins, B of them."""
    bins = jnp.broadcast_to(jnp.asarray(setting.problem.bin, jnp.int32)[:, None], (3, batch))
    heights = empty_map(setting.problem, bins)
    return State(heights, jnp.ones_like(heights, bool))


def look(setting: Setting, state: State, items: Array) -> Offers:
    """Every place for the next item of each bin.

    Args:
        items: int [3, B], its own length, width and height in cells; none is larger than the
            problem's window in any orientation that it may have.
    """
    problem, dtype = setting.problem, cell_dtype(setting.problem)
    own = items.astype(dtype)
    turned: list[Triple] = [(own[a], own[b], own[c]) for a, b, c in TURNS[setting.turns]]
    ceiling = jnp.full(own.shape[1:], problem.bin[2], dtype)
    nothing = jnp.zeros_like(ceiling)
    z = jnp.stack([rest(problem, state.heights, size, nothing, ceiling) for size in turned])
    allowed = z < np.iinfo(dtype).max
    if setting.stable:
        held = [_held(problem, state, size, at) for size, at in zip(turned, z, strict=True)]
        allowed &= jnp.stack(held)
    sides = jax.tree.map(lambda *of: jnp.stack(of), *turned)
    for turn in range(1, len(turned)):  # what looks the same is offered once
        same = [(side[:turn] == side[turn]) for side in sides]
        allowed = allowed.at[turn].set(allowed[turn] & ~jnp.stack(same).all(0).any(0))
    return Offers(sides, z, allowed)


def place(setting: Setting, state: State, offers: Offers, choice: Array, fits: Array) -> State:
    """The bins once the items stand where they were put.

    Args:
        choice: int32 [B], number of an offer that is allowed.
        fits: bool [B], False where nothing is placed.
    """
    problem = setting.problem
    size, (x, y, z) = chosen(setting, offers, choice)
    heights = drop(problem, state.heights, size, (x, y, z), fits)
    if not setting.stable:
        return State(heights, state.firm)
    (length, width, _), (window_x, window_y) = size, problem.window
    d, e = (jnp.arange(side, dtype=jnp.int32) for side in (window_x, window_y))
    lane = jnp.arange(len(choice))
    at = x.astype(jnp.int32) + d[:, None, None], y.astype(jnp.int32) + e[None, :, None], lane
    base = (d[:, None, None] < length) & (e[None, :, None] < width)
    carries = base & state.firm[at] & (state.heights[at] == z)
    reach = jnp.asarray(_reach(problem.window), jnp.int16)[..., None]  # [D, l, w, 1]
    hull = jnp.where(carries, reach, np.iinfo(np.int16).min).max((1, 2))  # [D, B]
    firm = base & (reach <= hull[:, None, None]).all(0)
    now = state.firm.at[at].set(jnp.where(base & fits, firm, state.firm[at]))
    return State(heights, now)


def chosen(setting: Setting, offers: Offers, choice: Array) -> tuple[Triple, Triple]:
    """(sides, corner) of an offer of each bin, cell_dtype [B] each."""
    L, W, _ = setting.problem.bin
    dtype = offers.z.dtype
    turn, spot = jnp.divmod(choice, L * W)
    x, y = jnp.divmod(spot, W)
    length, width, height = (jnp.take_along_axis(s, turn[None], 0)[0] for s in offers.sides)
    z = jnp.take_along_axis(offers.z.reshape(-1, len(choice)), choice[None], 0)[0]
    return (length, width, height), (x.astype(dtype), y.astype(dtype), z)


def _held(problem: Problem, state: State, size: Triple, z: Array) -> Array:
    """Whether the centre of an item at each position is over the hull of what carries it there:
    bool [L, W, B].

    Every cell that carries it reaches beyond the centre in some directions; together they have to
    in all that an edge of the hull may face. A bit for each.
    """
    (L, W, _), (window_x, window_y) = problem.bin, problem.window
    table = jnp.asarray(_beyond(problem.window))  # [l, w, d, e, words]
    bits = table[size[0].astype(jnp.int32) - 1, size[1].astype(jnp.int32) - 1]  # [B, d, e, words]
    bits = jnp.moveaxis(bits, 0, -1)
    found = [jnp.zeros(z.shape, jnp.uint32) for _ in range(table.shape[-1])]
    for d in range(window_x):
        for e in range(window_y):
            part = (slice(d, d + L), slice(e, e + W))
            carries = (state.heights[part] == z) & state.firm[part]
            for word in range(len(found)):
                found[word] |= jnp.where(carries, bits[d, e, word], np.uint32(0))
    full = np.bitwise_or.reduce(_beyond(problem.window), (0, 1, 2, 3))
    return jnp.stack([word == whole for word, whole in zip(found, full, strict=True)]).all(0)


@cache
def _directions(window: tuple[int, int]) -> np.ndarray:
    """All that an edge of a hull of cells of such a window may face: int [D, 2]."""
    length, width = window
    steps = ((a, b) for a in range(-width, width + 1) for b in range(-length, length + 1))
    return np.array([step for step in steps if math.gcd(*step) == 1])


@cache
def _reach(window: tuple[int, int]) -> np.ndarray:
    """How far every cell of a window reaches in every direction: int [D, l, w]."""
    a, b = _directions(window).T[:, :, None, None]
    near, far = (np.indices(window) + end for end in (0, 1))
    return np.maximum(a * near[0], a * far[0]) + np.maximum(b * near[1], b * far[1])


@cache
def _beyond(window: tuple[int, int]) -> np.ndarray:
    """In which directions each cell of a base reaches beyond its centre with the margin.

    Returns:
        uint32 [l, w, d, e, words]: a bit for each direction, of the cell (d, e) of a base of
        length l + 1 and width w + 1; none of cells beside it.
    """
    directions, reach = _directions(window), _reach(window)
    length, width = np.indices(window) + 1
    a, b = directions.T[:, :, None, None]
    # In units of 1 / (2 MARGIN): the centre's part and that of the margin.
    limit = MARGIN * (a * length + b * width) + 2 * (abs(a) * length + abs(b) * width)
    d, e = np.indices(window)
    inside = (d < length[..., None, None]) & (e < width[..., None, None])
    far = 2 * MARGIN * reach[:, None, None] >= limit[..., None, None]
    bits = np.moveaxis(far & inside, 0, -1)
    words = -(-len(directions) // WORD)
    bits = np.pad(bits, [(0, 0)] * 4 + [(0, words * WORD - len(directions))])
    powers = np.uint32(1) << np.arange(WORD, dtype=np.uint32)
    grouped = bits.reshape(*bits.shape[:-1], words, WORD)
    return np.asarray((grouped * powers).sum(-1, dtype=np.uint32))
