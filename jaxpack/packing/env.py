"""Packing as a sequence of choices that see the bin: reset, candidates, step.

First fit, bin by bin: at every step one of the items that still fit the current bin is chosen,
the height-map rule places it, and when none fits a new bin is opened. What was chosen is an
order, and `pack` turns that order into the same packing. Items of equal size are one *kind*
with a count: there is nothing to choose between them. Where items may be turned, every
orientation of a kind is a choice of its own.

Everything here treats trailing axes as batch ([K, B]: choices, instances side by side), because
the kernel does. K is the number of kinds times that of orientations, padding included; F the
number of footprints.
"""

from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.model.problem import Instance, Problem
from jaxpack.packing.candidates import Rests, Surroundings, rests, surroundings
from jaxpack.packing.height_map import cell_dtype, drop, empty_map
from jaxpack.packing.surface import Triple

T = TypeVar("T")


class Kinds(NamedTuple):
    """What does not change while an instance is packed."""

    sides: Triple  # length, width, height of each choice: cell_dtype [K, B], 0 for padding
    label: Array  # int32 [K, B], the kind's number among all kinds of the instance
    orientation: Array  # int32 [K, B], index along O of `Instance.turned`
    share: Array  # float32 [K, B], one by the number of the kind's orientations
    items: Array  # int32 [N, B], the items by kind; those of no kind (never placed) last
    bin: Array  # int32 [3, B], cells


class BinState(NamedTuple):
    """The current bin and what remains."""

    heights: Array  # cell_dtype [L + window - 1, W + window - 1, B], with walls
    remaining: Array  # int32 [K, B], items of the choice's kind that are not packed yet
    used: Array  # int32 [B], volume packed into the current bin, cells
    opened: Array  # int32 [B], bins opened so far


class Candidates(NamedTuple):
    """The next placement of every kind. `corner` and `around` mean nothing where it fits not."""

    fits: Array  # bool [K, B], one remains and there is a position for it in the current bin
    corner: Triple  # x, y, z: cell_dtype [K, B], cells
    supported: Array  # integer [K, B], cells of the footprint at height z
    around: Surroundings  # integers [K, B], cells


class Decisions(NamedTuple):
    """What a policy decided of an instance; the rule that fills in the positions does the rest."""

    order: Array  # int32 [..., N], the items in the order in which they are packed
    orientation: Array  # int32 [..., N] by item, index along O of `Instance.turned`; 0 without it


def reset(problem: Problem, instance: Instance, kinds: int | None = None) -> tuple[Kinds, BinState]:
    """The state before the first choice.

    Args:
        instance: leaves with a trailing batch: size [N, 3, B], mask [N, B], bin [3, B],
            turned [N, O, 3, B] or None.
        kinds: at least the number of distinct sizes in an instance (with their orientations);
            N if not given. Fewer rows are less work.
    """
    turned = instance.size[:, None] if instance.turned is None else instance.turned
    N, ways, _, B = turned.shape
    limit = jnp.minimum(instance.bin, jnp.asarray([*problem.window, problem.bin[2]])[:, None])
    allowed = instance.mask[:, None] & (turned <= limit).all(2)  # [N, O, B]
    for way in range(1, ways):
        alike = (turned[:, :way] == turned[:, way : way + 1]).all(2).any(1)
        allowed = allowed.at[:, way].set(allowed[:, way] & ~alike)
    placeable = allowed.any(1)
    sides = jnp.where(allowed[:, :, None], turned, 0).reshape(N, ways * 3, B)
    index = jax.lax.broadcasted_iota(jnp.int32, (N, B), 0)
    # Items that can never be placed last, then by size: runs of equal rows are the kinds.
    keys = (~placeable, *jnp.unstack(sides, axis=1))
    *ordered, items = jax.lax.sort((*keys, index), dimension=0, num_keys=len(keys), is_stable=True)
    kinds = min(kinds or N, N)
    changed = jnp.stack([row[1:] != row[:-1] for row in ordered]).any(0)
    first = jnp.concatenate([jnp.ones((1, B), bool), changed])
    kind = jnp.cumsum(first, 0, dtype=jnp.int32) - 1
    kind = jnp.where(ordered[0], kinds, kind)
    member = jnp.arange(B)
    empty = jnp.zeros((kinds, B), jnp.int32)
    count = empty.at[kind, member].add(1, mode="drop")
    columns = [empty.at[kind, member].set(row, mode="drop") for row in ordered[1:]]
    # [kinds, O, 3, B]; of every kind all orientations stand together.
    table = jnp.stack(columns, 1).reshape(kinds, ways, 3, B)
    length, width, height = (
        table[:, :, axis].reshape(-1, B).astype(cell_dtype(problem)) for axis in range(3)
    )
    real = table[:, :, 0] > 0
    share = real / jnp.maximum(real.sum(1, keepdims=True), 1)
    state = BinState(
        heights=empty_map(problem, instance.bin),
        remaining=jnp.where(real, count[:, None], 0).reshape(-1, B),
        used=jnp.zeros(B, jnp.int32),
        opened=jnp.ones(B, jnp.int32),
    )
    row = jax.lax.broadcasted_iota(jnp.int32, (kinds * ways, B), 0)
    choices = (length, width, height), row // ways, row % ways, share.reshape(-1, B)
    return Kinds(*choices, items, instance.bin), state


def compact(kinds: Kinds, state: BinState, rows: int) -> tuple[Kinds, BinState]:
    """The same with only `rows` choices: at least as many as there are of which items remain."""
    keep = jnp.argsort(state.remaining == 0, axis=0, stable=True)[:rows]

    def kept(columns: T) -> T:
        return jax.tree.map(lambda column: jnp.take_along_axis(column, keep, 0), columns)

    sides, label, orientation, share = kept(kinds[:4])
    kinds = kinds._replace(sides=sides, label=label, orientation=orientation, share=share)
    return kinds, state._replace(remaining=kept(state.remaining))


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
    """Places one item of row `kind` (int32 [B]) where the candidate says; nothing if none fits.

    Args:
        state, choices: as `candidates` returned them.
    """

    def chosen(table: Array) -> Array:
        return jnp.take_along_axis(table, kind[None], 0)[0]

    fits = chosen(choices.fits)
    size, corner = ((chosen(a), chosen(b), chosen(c)) for a, b, c in (kinds.sides, choices.corner))
    length, width, height = (side.astype(jnp.int32) for side in size)
    # Of all orientations of its kind one item less is left.
    taken = (kinds.label == chosen(kinds.label)) & (state.remaining > 0) & fits
    return BinState(
        heights=drop(problem, state.heights, size, corner, fits),
        remaining=state.remaining - taken,
        used=state.used + jnp.where(fits, length * width * height, 0),
        opened=state.opened,
    )


def decisions_of(kinds: Kinds, chosen: Array, orientation: Array) -> Decisions:
    """The decisions that a sequence of choices stands for, batch first: leaves [B, N].

    Args:
        chosen: int32 [N, B], label of the kind chosen at each step, N where nothing was left.
        orientation: int32 [N, B], of the choice of each step.

    Returns:
        Items that were never placed come last.
    """
    steps, member = (
        jax.lax.broadcasted_iota(jnp.int32, chosen.shape, 0),
        jnp.arange(chosen.shape[1]),
    )
    # The j-th of the steps sorted like this placed the j-th of `Kinds.items`.
    _, by_kind, in_turn = jax.lax.sort(
        (chosen, steps, orientation), dimension=0, num_keys=1, is_stable=True
    )
    nothing = jnp.zeros_like(chosen)
    order = nothing.at[by_kind, member].set(kinds.items)
    return Decisions(order.T, nothing.at[kinds.items, member].set(in_turn).T)
