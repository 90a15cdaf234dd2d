"""Packing as a sequence of choices that see the bin: reset, observe, step.

    state = reset(view, instances)
    choices = observe(view, state)                   # all that could be placed next, and where
    state = step(view, state, choice_of(view, state, choices, row))

A choice is a kind, an orientation and a position. Items of equal size are one *kind* with a count:
there is nothing to choose between them. Where items may be turned, every orientation of a kind is a
choice of its own, and so is every position of those that several rules prefer, if the view has more
than one. Who chooses no position gets that of the first rule; `positions` has all there are. When
nothing that remains fits the current bin, a new one is opened. What was chosen is an order with
orientations and places (`decisions_of`), which `pack_decisions` turns into the same packing.

Everything here treats trailing axes as batch ([K, B]: choices, instances side by side), because
the kernels do: move the axis of a batch of instances to the end first. K is the number of kinds
times that of orientations, padding included. The view says what a bin is: see `packing.view`.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.model.problem import Instance
from jaxpack.packing.surface import Triple
from jaxpack.packing.view import Candidates, Outline, Places, View


class Kinds(NamedTuple):
    """What does not change while an instance is packed. A row is a kind in an orientation."""

    sides: Triple  # length, width, height of each row: of the view's type [K, B], 0 for padding
    kind: Array  # int32 [K, B], its number among all kinds of the instance
    orientation: Array  # int32 [K, B], index along O of `Instance.turned`
    share: Array  # float32 [K, B], one by the number of the kind's orientations
    items: Array  # int32 [N, B], the items by kind; those of no kind (never placed) last
    bin: Array  # int32 [3, B], sides

    def choice(self, row: Array) -> "Choice":
        """That of a row, int32 [B]."""
        kind, orientation = (
            jnp.take_along_axis(column, row[None], 0)[0] for column in (self.kind, self.orientation)
        )
        return Choice(kind, orientation)


class State(NamedTuple):
    """The current bin and what remains."""

    kinds: Kinds
    inside: Any  # what lies in the current bin, as the view keeps it
    remaining: Array  # int32 [K, B], items of the row's kind that are not packed yet
    used: Array  # float32 [B], volume packed into the current bin
    opened: Array  # int32 [B], bins opened so far


class Choices(NamedTuple):
    """What could be placed next, and the bin it would be in.

    K is here that of `Kinds` times the number of rules of the view: first the placements of all
    rows by the first rule, then those by the second, and so on.
    """

    allowed: Array  # bool [K, B], one remains, and there is a position for it like none before
    candidates: Candidates  # of no meaning where none remains
    outline: Outline


class Choice(NamedTuple):
    """What is placed next."""

    kind: Array  # int32 [B], see `Kinds.kind`
    orientation: Array  # int32 [B]
    position: tuple[Array, Array] | None = None  # x, y of its corner [B]; None: the rule's


class Decisions(NamedTuple):
    """What a policy decided of an instance; the position rule does the rest."""

    order: Array  # int32 [..., N], the items in the order in which they are packed
    orientation: Array  # int32 [..., N] by item, index along O of `Instance.turned`; 0 without it
    # int32 [..., N] by item, x + y * the bin's length, of its corner; it stands there in the first
    # bin that has any position for it, if it may. None, or -1: where the rule says.
    place: Array | None = None


def reset(view: View, instance: Instance, kinds: int | None = None) -> State:
    """The state before the first choice.

    Args:
        view: what a bin is, static: `Table(problem)` of cells.
        instance: leaves with a trailing batch: size [N, 3, B], mask [N, B], bin [3, B],
            turned [N, O, 3, B] or None.
        kinds: at least the number of distinct sizes in an instance (with their orientations);
            N if not given. Fewer rows are less work.
    """
    turned = instance.size[:, None] if instance.turned is None else instance.turned
    N, ways, _, B = turned.shape
    allowed = instance.mask[:, None] & (turned <= view.largest(instance.bin)).all(2)  # [N, O, B]
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
        table[:, :, axis].reshape(-1, B).astype(view.dtype) for axis in range(3)
    )
    real = table[:, :, 0] > 0
    share = real / jnp.maximum(real.sum(1, keepdims=True), 1)
    row = jax.lax.broadcasted_iota(jnp.int32, (kinds * ways, B), 0)
    rows = (length, width, height), row // ways, row % ways, share.reshape(-1, B)
    return State(
        kinds=Kinds(*rows, items, instance.bin),
        inside=view.empty(instance.bin),
        remaining=jnp.where(real, count[:, None], 0).reshape(-1, B),
        used=jnp.zeros(B),
        opened=jnp.ones(B, jnp.int32),
    )


def observe(view: View, state: State) -> Choices:
    """Every choice, with the positions that the rules give it and what it would touch there.

    Args:
        view: as `reset` had it.
        state: as `reset` or `step` returned it.
    """
    kinds = state.kinds
    by_rule = [view.look(state.inside, kinds.bin, kinds.sides, rule) for rule in range(view.rules)]
    places = [jnp.stack(candidates.corner) for candidates in by_rule]
    allowed = []
    for rule, candidates in enumerate(by_rule):
        alike = [(places[rule] == other).all(0) for other in places[:rule]]
        new = ~jnp.stack(alike).any(0) if alike else True
        allowed.append(candidates.fits & (state.remaining > 0) & new)
    candidates = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *by_rule)
    outline = view.outline(state.inside, kinds.bin)
    return Choices(jnp.concatenate(allowed), candidates, outline)


def choice_of(view: View, state: State, choices: Choices, row: Array) -> "Choice":
    """The choice that a row stands for, with its position where there are several to choose from.

    Args:
        view: as `reset` had it.
        state: as `reset` or `step` returned it.
        choices: what `observe` said of it.
        row: int32 [B], along K of `choices.allowed`.
    """
    if view.rules == 1:
        return state.kinds.choice(row)
    choice = state.kinds.choice(row % len(state.remaining))
    x, y, _ = (jnp.take_along_axis(place, row[None], 0)[0] for place in choices.candidates.corner)
    return choice._replace(position=(x, y))


def positions(view: View, state: State, kind: Array, orientation: Array) -> Places:
    """All positions for one item: those that are allowed, and how high it would come to rest.

    Args:
        view: as `reset` had it.
        state: as `reset` or `step` returned it.
        kind: int32 [B], see `Kinds.kind`.
        orientation: int32 [B].
    """
    _, size = _row(state.kinds, Choice(kind, orientation))
    return view.places(state.inside, state.kinds.bin, size)


def step(view: View, state: State, choice: Choice) -> State:
    """Places one item, and opens a new bin where nothing that remains fits the current one.

    Nothing is placed where none of the kind remains, or it is not allowed where it should stand.

    Args:
        view: as `reset` had it.
        state: as `reset` or `step` returned it.
        choice: one of those that `observe` allows, or at one of the `positions`.
    """
    kinds = state.kinds
    row, size = _row(kinds, choice)
    if choice.position is None:
        corners, found = view.corners(
            state.inside, kinds.bin, jax.tree.map(lambda s: s[None], size)
        )
        corner, fits = jax.tree.map(lambda leaf: leaf[0], (corners, found))
    else:
        corner, fits = _at(view.places(state.inside, kinds.bin, size), *choice.position)
    fits &= (row & (state.remaining > 0)).any(0)
    # Of all orientations of its kind one item less is left.
    taken = (kinds.kind == choice.kind) & (state.remaining > 0) & fits
    remaining = state.remaining - taken
    inside = view.place(state.inside, kinds.bin, size, corner, fits)
    waiting = remaining > 0
    full = waiting.any(0) & ~(waiting & view.corners(inside, kinds.bin, kinds.sides)[1]).any(0)
    length, width, height = (side.astype(jnp.float32) for side in size)
    used = state.used + jnp.where(fits, length * width * height, 0)
    return State(
        kinds=kinds,
        inside=jax.tree.map(
            lambda new, old: jnp.where(full, new, old), view.empty(kinds.bin), inside
        ),
        remaining=remaining,
        used=jnp.where(full, 0, used),
        opened=state.opened + full,
    )


def compact(state: State, rows: int) -> State:
    """The same with only `rows` rows: at least as many as there are of which items remain."""
    keep = jnp.argsort(state.remaining == 0, axis=0, stable=True)[:rows]
    kinds = state.kinds
    columns = (kinds.sides, kinds.kind, kinds.orientation, kinds.share, state.remaining)
    *kept, remaining = jax.tree.map(lambda column: jnp.take_along_axis(column, keep, 0), columns)
    return state._replace(kinds=Kinds._make((*kept, *kinds[4:])), remaining=remaining)


def _row(kinds: Kinds, choice: Choice) -> tuple[Array, Triple]:
    """(bool [K, B], where the choice stands; its sides [B], 0 where it stands nowhere)."""
    row = (kinds.kind == choice.kind) & (kinds.orientation == choice.orientation)
    length, width, height = (jnp.where(row, side, 0).max(0) for side in kinds.sides)
    return row, (length, width, height)


def _at(places: Places, x: Array, y: Array) -> tuple[Triple, Array]:
    """The corner at (x, y) [B], and whether it is allowed."""
    here = (places.x == x) & (places.y == y) & places.allowed
    z = jnp.where(here, places.z, 0).max((0, 1))
    return (x.astype(z.dtype), y.astype(z.dtype), z), here.any((0, 1))


def decisions_of(kinds: Kinds, chosen: Choice) -> Decisions:
    """The decisions that a sequence of choices stands for, batch first: leaves [B, N].

    Args:
        kinds: those of the state that the choices began from.
        chosen: leaves [N, B], the choice of each step; kind N where nothing was left.

    Returns:
        What `jaxpack.pack` makes the same packing of; items that were never placed come last.
    """
    steps, member = (
        jax.lax.broadcasted_iota(jnp.int32, chosen.kind.shape, 0),
        jnp.arange(chosen.kind.shape[1]),
    )
    columns = [chosen.orientation]
    if chosen.position is not None:
        x, y = (side.astype(jnp.int32) for side in chosen.position)
        columns.append(x + y * kinds.bin[0])
    # The j-th of the steps sorted like this placed the j-th of `Kinds.items`.
    _, by_kind, *in_turn = jax.lax.sort(
        (chosen.kind, steps, *columns), dimension=0, num_keys=1, is_stable=True
    )
    nothing = jnp.zeros_like(steps)
    order = nothing.at[by_kind, member].set(kinds.items)
    by_item = [nothing.at[kinds.items, member].set(column).T for column in in_turn]
    return Decisions(order.T, *by_item)
