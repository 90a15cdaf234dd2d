"""Choosing where the next item goes, and whole sequences packed by such a choice.

A rule gives every place a score, and the place with the largest is taken, of equal ones the lowest.
Who chooses sees the bin, the items that it holds (one, or as many as the buffer has) and those
that are known to come (none, or as many as are looked ahead at), and nothing else.
"""

import json
from collections.abc import Callable
from functools import cache, partial
from importlib import resources
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.errors import UserError
from jaxpack.learning.online_value import worth_after
from jaxpack.learning.parameters import Params
from jaxpack.model.online_check import Played
from jaxpack.packing.online import Offers, Setting, State, chosen, empty, look, place
from jaxpack.packing.online_view import Places, Score, after, fits, places, roughness, scores
from jaxpack.xla.programs import apart

LANES = 32  # sequences that a core packs at once: what is looked at of them stays in its cache


class Choice(NamedTuple):
    """What every bin takes next, and where."""

    slot: Array  # int32 [B], which of the held items
    offers: Offers  # of that item
    number: Array  # int32 [B], of the offer
    there: Array  # bool [B], False where none of the held items has a place


class Known(NamedTuple):
    """What may be known of the items."""

    held: Array  # int32 [W, 3, B], one of which is placed next; 0 where there is none
    coming: Array  # int32 [C, 3, B], those after them, in their order; 0 where there is none


Chooser = Callable[[State, Known, Array], Choice]
"""(bins, what is known, typed keys [B]) -> what is placed where."""


def least_z(setting: Setting, state: State, place: Places) -> Array:
    """The lowest place."""
    return -place.corner[2].astype(jnp.float32)


def best_fit(setting: Setting, state: State, place: Places) -> Array:
    """Where the free space around the item at its height is tightest: the smaller of what is left
    of it along x and along y, then their sum, then the height.
    """
    L, W, _ = setting.problem.bin
    x, y, z = place.corner
    length, width, _ = place.sides
    higher = state.heights[:L, :W] > z
    X, Y = jnp.arange(L)[:, None], jnp.arange(W)[:, None]
    beside = (
        (higher & (y <= Y) & (y + width > Y)).any(1),  # [L, N]
        (higher & ((x <= X) & (x + length > X))[:, None]).any(0),  # [W, N]
    )
    left = []
    for blocked, cells, start, side, whole in zip(
        beside, (X, Y), (x, y), (length, width), (L, W), strict=True
    ):
        near = jnp.where(blocked & (cells < start), cells + 1, 0).max(0)
        far = jnp.where(blocked & (cells >= start + side), cells, whole).min(0)
        left.append(far - near - side)
    least, both = jnp.minimum(*left), left[0] + left[1]
    return -(least * 1e4 + both * 1e2 + z).astype(jnp.float32)


def largest_space(setting: Setting, state: State, place: Places) -> Array:
    """Where the largest rectangle that is free above each height, summed up, stays largest
    (maximise accessible convex space: Hu et al., TAP-Net, 2020).
    """
    L, W, H = setting.problem.bin
    found = fits(setting, *after(setting, state, place), (L, W)).lowest  # [L W, N]
    areas = jnp.asarray(np.outer(np.arange(1, L + 1), np.arange(1, W + 1)).ravel(), jnp.int16)

    def at(level: Array, total: Array) -> Array:
        free = jnp.where(found <= level, areas[:, None], 0)
        return total + free.max(0)

    return jax.lax.fori_loop(0, H, at, jnp.zeros(found.shape[1:], jnp.int16)).astype(jnp.float32)


def flattest(setting: Setting, state: State, place: Places) -> Array:
    """Where the surface is smoothest afterwards, and hides least: the steps between its cells and
    its heights, summed up, are least.
    """
    L, W, _ = setting.problem.bin
    cells, _ = after(setting, state, place)
    rows = cells.reshape(L * W, -1)

    def add(i: Array, total: Array) -> Array:
        return total + rows[i]

    heights = jax.lax.fori_loop(0, L * W, add, jnp.zeros(rows.shape[1:], jnp.int16))
    return -(roughness(cells)[0] + heights).astype(jnp.float32)


RULES: dict[str, Score] = {
    "least-z": least_z,
    "best-fit": best_fit,
    "largest-space": largest_space,
    "flattest": flattest,
}


def value_rule(params: Params) -> Score:
    """Where most will be in the bin in the end, as the network expects."""

    def score(setting: Setting, state: State, place: Places) -> Array:
        length, width, height = place.sides
        volume = length.astype(jnp.float32) * width * height
        return volume / np.prod(setting.problem.bin) + worth_after(params)(setting, state, place)

    return score


@cache
def shipped_value(name: str) -> Params:
    """The weights of the package for a setting: see `jaxpack.packing.online.SETTINGS`.

    Raises:
        UserError: where there are none.
    """
    # What stands for any weights stands for those of 3.
    home = {"online-3": "online-1"}.get(name, name)
    file = resources.files("jaxpack") / "weights" / f"{home}.json"
    if not file.is_file():
        raise UserError(f"no policy for '{name}': train one, see docs/online.md")
    weights = json.loads(file.read_text())["weights"]
    return {leaf: jnp.asarray(value, jnp.float32) for leaf, value in weights.items()}


def scored(
    setting: Setting, score: Score, state: State, held: Array
) -> tuple[list[Offers], Array, Array]:
    """Every place of every held item: (offers by item, numbers and scores [W K, B] each)."""
    always, every = (state.heights >= 0).any(), []
    numbers, found = [], []
    for item in held:
        real = item[0] > 0
        offers = apart(always, partial(look, setting), state, jnp.maximum(item, 1))
        offers = offers._replace(allowed=offers.allowed & real)
        here = apart(always, partial(places, setting), state, offers)
        every.append(offers)
        numbers.append(here.number)
        found.append(scores(setting, score, state, here))
    return every, jnp.concatenate(numbers), jnp.concatenate(found)


def choice_of(setting: Setting, every: list[Offers], numbers: Array, row: Array) -> Choice:
    """That of a row [B] of what `scored` returned."""
    slot = row // setting.most
    picked = jax.tree.map(lambda *of: _pick(jnp.stack(of), slot), *every)
    number = jnp.take_along_axis(numbers, row[None], 0)[0]
    there = _at(picked.allowed, number)
    return Choice(slot, picked, number, there)


def by_rule(setting: Setting, score: Score) -> Chooser:
    """Takes the place with the largest score."""

    def choose(state: State, known: Known, keys: Array) -> Choice:
        every, numbers, found = scored(setting, score, state, known.held)
        return choice_of(setting, every, numbers, jnp.argmax(found, 0))

    return choose


def _pick(leaves: Array, slot: Array) -> Array:
    """leaves [W, ..., B], slot [B] -> [..., B]."""
    if len(leaves) == 1:
        return leaves[0]
    index = slot.reshape(1, *(1,) * (leaves.ndim - 2), -1)
    return jnp.take_along_axis(leaves, index, 0)[0]


def _at(cells: Array, number: Array) -> Array:
    """cells [O, L, W, B], number [B] -> [B]."""
    return jnp.take_along_axis(cells.reshape(-1, len(number)), number[None], 0)[0]


class _Now(NamedTuple):
    turn: Array
    state: State
    held: Array  # int32 [W, B], indices of the held items
    next: Array  # int32 [B], index of the item that arrives next
    bin: Array  # int32 [B]
    alive: Array  # bool [B]
    fresh: Array  # bool [B], whether the bin is empty
    played: Played


def play(
    setting: Setting,
    choose: Chooser,
    items: Array,
    keys: Array,
    buffer: int = 1,
    lookahead: int = 1,
    many: bool = False,
) -> Played:
    """Packs sequences, one item at a time.

    Args:
        setting: static, what holds.
        choose: see `Chooser`.
        items: int32 [N, 3, B], in the order in which they arrive; 0 is the end.
        keys: typed PRNG keys [B].
        buffer: W, how many items are held, of which any may be placed next.
        lookahead: how many items are known, with the held ones if it is 1; from 2 on one, two, ...
            after these as well.
        many: a bin in which none of the held items has a place is closed, and a new one opened;
            otherwise the sequence ends there.

    Returns:
        int32, the sequences as the last axis: [T, B] and [T, 3, B]. As many turns as there are
        items, twice as many with `many` bins.
    """
    N, _, B = items.shape
    turns = 2 * N if many else N
    padded = jnp.concatenate([items, jnp.zeros((1, 3, B), items.dtype)])
    whole = empty(setting, B)

    def rows(index: Array) -> Array:
        return jnp.take_along_axis(padded, jnp.minimum(index, N)[:, None], 0)

    def turn(now: _Now) -> _Now:
        ahead = now.next + jnp.arange(lookahead - 1)[:, None]
        known = Known(rows(now.held), rows(ahead))
        choice = choose(now.state, known, jax.vmap(jax.random.fold_in)(keys, jnp.full(B, now.turn)))
        there = choice.there & now.alive
        sides, corner = chosen(setting, choice.offers, choice.number)
        item = jnp.where(there, _pick(now.held, choice.slot), -1)
        state = place(setting, now.state, choice.offers, choice.number, there)
        left = (rows(now.held)[:, 0] > 0).any(0)
        opens = ~there & now.alive & left & ~now.fresh & many
        held = jnp.where(there & (jnp.arange(buffer)[:, None] == choice.slot), now.next, now.held)
        played = Played(
            now.played.item.at[now.turn].set(item),
            now.played.bin.at[now.turn].set(now.bin),
            now.played.sides.at[now.turn].set(jnp.stack(sides).astype(jnp.int32)),
            now.played.corner.at[now.turn].set(jnp.stack(corner).astype(jnp.int32)),
        )
        return _Now(
            now.turn + 1,
            jax.tree.map(partial(jnp.where, opens), whole, state),
            held,
            now.next + there,
            now.bin + opens,
            there | opens,
            jnp.where(there, False, now.fresh | opens),
            played,
        )

    nothing = jnp.full((turns, B), -1, jnp.int32)
    cells = jnp.zeros((turns, 3, B), jnp.int32)
    start = _Now(
        jnp.int32(0),
        whole,
        jnp.broadcast_to(jnp.arange(buffer, dtype=jnp.int32)[:, None], (buffer, B)),
        jnp.full(B, buffer, jnp.int32),
        jnp.zeros(B, jnp.int32),
        jnp.ones(B, bool),
        jnp.ones(B, bool),
        Played(nothing, 0 * nothing, cells, cells),
    )
    return jax.lax.while_loop(lambda now: now.alive.any() & (now.turn < turns), turn, start).played
