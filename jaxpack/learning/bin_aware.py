"""Packing as a sequence of choices that see the bin: reset, candidates, step.

First fit, bin by bin: at every step one of the items that still fit the current bin is chosen,
the height-map rule places it, and when none fits a new bin is opened. What was chosen is an
order, and `pack` turns that order into the same packing. Items of equal size are one *kind*
with a count: there is nothing to choose between them.

Everything here treats trailing axes as batch ([K, B]: kinds, instances side by side), because
the kernel does. K is the number of kinds, padding included; F the number of footprints.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.packing.candidates import Rests, Surroundings, rests, surroundings
from jaxpack.packing.height_map import Triple, cell_dtype, drop, empty_map
from jaxpack.packing.problem import Instance, Problem


class Kinds(NamedTuple):
    """What does not change while an instance is packed."""

    sides: Triple  # length, width, height of each kind: cell_dtype [K, B], 0 for padding
    label: Array  # int32 [K, B], the kind's number among all kinds of the instance
    items: Array  # int32 [N, B], the items by kind; those of no kind (never placed) last
    bin: Array  # int32 [3, B], cells


class BinState(NamedTuple):
    """The current bin and what remains."""

    heights: Array  # cell_dtype [L + window - 1, W + window - 1, B], with walls
    remaining: Array  # int32 [K, B], items of each kind that are not packed yet
    used: Array  # int32 [B], volume packed into the current bin, cells
    opened: Array  # int32 [B], bins opened so far


class Candidates(NamedTuple):
    """The next placement of every kind. `corner` and `around` mean nothing where it fits not."""

    fits: Array  # bool [K, B], one remains and there is a position for it in the current bin
    corner: Triple  # x, y, z: cell_dtype [K, B], cells
    supported: Array  # integer [K, B], cells of the footprint at height z
    around: Surroundings  # integers [K, B], cells


def reset(problem: Problem, instance: Instance, kinds: int | None = None) -> tuple[Kinds, BinState]:
    """The state before the first choice.

    Args:
        instance: leaves with a trailing batch: size [N, 3, B], mask [N, B], bin [3, B].
        kinds: K, at least the number of distinct sizes in an instance; N if not given. Fewer
            rows are less work.
    """
    N, _, B = instance.size.shape
    K = min(kinds or N, N)
    dtype = cell_dtype(problem)
    limit = jnp.minimum(instance.bin, jnp.asarray([*problem.window, problem.bin[2]])[:, None])
    placeable = instance.mask & (instance.size <= limit).all(1)
    sides = [jnp.where(placeable, instance.size[:, axis], 0) for axis in range(3)]
    index = jax.lax.broadcasted_iota(jnp.int32, (N, B), 0)
    # Items that can never be placed last, then by size: runs of equal rows are the kinds.
    *ordered, items = jax.lax.sort(
        (~placeable, *sides, index), dimension=0, num_keys=4, is_stable=True
    )
    changed = jnp.stack([row[1:] != row[:-1] for row in ordered]).any(0)
    first = jnp.concatenate([jnp.ones((1, B), bool), changed])
    kind = jnp.cumsum(first, 0, dtype=jnp.int32) - 1
    kind = jnp.where(ordered[0], K, kind)
    member = jnp.arange(B)
    empty = jnp.zeros((K, B), jnp.int32)
    remaining = empty.at[kind, member].add(1, mode="drop")
    length, width, height = (
        empty.at[kind, member].set(row, mode="drop").astype(dtype) for row in ordered[1:]
    )
    state = BinState(
        heights=empty_map(problem, instance.bin),
        remaining=remaining,
        used=jnp.zeros(B, jnp.int32),
        opened=jnp.ones(B, jnp.int32),
    )
    label = jax.lax.broadcasted_iota(jnp.int32, (K, B), 0)
    return Kinds((length, width, height), label, items, instance.bin), state


def compact(kinds: Kinds, state: BinState, rows: int) -> tuple[Kinds, BinState]:
    """The same with only `rows` kinds: at least as many as there are of which items remain."""
    keep = jnp.argsort(state.remaining == 0, axis=0, stable=True)[:rows]
    label, remaining, *sides = (
        jnp.take_along_axis(column, keep, 0)
        for column in (kinds.label, state.remaining, *kinds.sides)
    )
    length, width, height = sides
    kinds = kinds._replace(sides=(length, width, height), label=label)
    return kinds, state._replace(remaining=remaining)


def candidates(problem: Problem, kinds: Kinds, state: BinState) -> tuple[BinState, Candidates]:
    """The choices, after a new bin was opened where nothing that remains fits the current one.

    The state that comes back is the one that the choices belong to.
    """
    _, window_y = problem.window
    length, width, height = kinds.sides
    waiting = state.remaining > 0
    footprint = jnp.where(waiting, (length.astype(jnp.int32) - 1) * window_y + width - 1, 0)

    ceiling = kinds.bin[2].astype(height.dtype)
    at = rests(problem, state.heights)
    fits = waiting & (jnp.take_along_axis(at.z, footprint, 0) <= ceiling - height)
    full = ~fits.any(0) & waiting.any(0)
    fresh = empty_map(problem, kinds.bin)
    state = BinState(
        heights=jnp.where(full, fresh, state.heights),
        remaining=state.remaining,
        used=jnp.where(full, 0, state.used),
        opened=state.opened + full,
    )
    # In an empty bin everything rests in the corner, on the floor.
    x, y, z = (jnp.where(full, 0, place) for place in at[:3])
    at = Rests(x, y, z, at.supported)
    around = surroundings(problem, state.heights, kinds.bin, at)
    # One gather of whole rows of the table instead of one per column.
    table = jnp.stack([column.astype(around.under.dtype) for column in (*at, *around)], -1)
    rows = jnp.take_along_axis(table, footprint[..., None], 0)
    x, y, z, supported, *beside = (rows[..., column] for column in range(rows.shape[-1]))
    supported = jnp.where(full, length * width, supported)
    x, y, z = (place.astype(height.dtype) for place in (x, y, z))
    return state, Candidates(
        fits | (waiting & full), (x, y, z), supported, Surroundings._make(beside)
    )


def step(
    problem: Problem, kinds: Kinds, state: BinState, choices: Candidates, kind: Array
) -> BinState:
    """Places one item of `kind` (int32 [B]) where the candidate says; nothing where none fits.

    Args:
        state, choices: as `candidates` returned them.
    """

    def chosen(table: Array) -> Array:
        return jnp.take_along_axis(table, kind[None], 0)[0]

    fits = chosen(choices.fits)
    size, corner = ((chosen(a), chosen(b), chosen(c)) for a, b, c in (kinds.sides, choices.corner))
    length, width, height = (side.astype(jnp.int32) for side in size)
    taken = (jnp.arange(len(state.remaining))[:, None] == kind) & fits
    return BinState(
        heights=drop(problem, state.heights, size, corner, fits),
        remaining=state.remaining - taken,
        used=state.used + jnp.where(fits, length * width * height, 0),
        opened=state.opened,
    )


def order_of(kinds: Kinds, chosen: Array) -> Array:
    """The packing order that a sequence of choices stands for.

    Args:
        chosen: int32 [N, B], label of the kind chosen at each step, N where nothing was left.

    Returns:
        int32 [N, B]; items that were never placed come last.
    """
    steps = jax.lax.broadcasted_iota(jnp.int32, chosen.shape, 0)
    # The j-th step by kind placed the j-th item by kind.
    _, by_kind = jax.lax.sort((chosen, steps), dimension=0, num_keys=1, is_stable=True)
    member = jnp.arange(chosen.shape[1])
    return jnp.zeros_like(chosen).at[by_kind, member].set(kinds.items)
