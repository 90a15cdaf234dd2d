"""Planning while items come one by one: the best places are tried on futures that may come.

Each of the places that the value likes best is taken in a copy of the bin, and each copy goes on
greedily, with the items that are known and after them with ones that are drawn: the same for all
places. What the last of them adds is what its best place is worth, as greedy play sees it. The
place is taken whose copies come to most in the mean. All copies are one batch of one program.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.learning.parameters import Params
from jaxpack.packing.online import TURNS, Setting, State, chosen, place
from jaxpack.packing.online_view import NOWHERE
from jaxpack.search.online import (
    LANES,
    Choice,
    Chooser,
    Known,
    by_rule,
    choice_of,
    scored,
    value_rule,
)
from jaxpack.xla.pieces import in_pieces

WIDTH, DEPTH = 10, 1
"""Places that are tried, and items that come in each future."""


def planned(
    setting: Setting, params: Params, futures: int | None, width: int = WIDTH, depth: int = DEPTH
) -> Chooser:
    """Chooses by how the bin may go on.

    Args:
        setting: static, what holds.
        params: of the value.
        futures: how many are drawn; None: one for every item that may come first, which counts by
            its probability; 0: the known items alone, in which case nothing is drawn.
        width: places that are tried.
        depth: items that come in each future, uniformly, as in training.
    """
    score, kinds = value_rule(params), _kinds(setting)
    weight = jnp.asarray(kinds[1] if futures is None else np.ones(max(futures, 1)), jnp.float32)
    copies = len(weight)

    def drawn(key: Array) -> Array:
        """Items of futures: int32 [copies, depth, 3]."""
        items = jax.random.randint(key, (copies, depth * (futures != 0), 3), 1, setting.high + 1)
        return items if futures is not None else items.at[:, 0].set(kinds[0])

    def choose(state: State, known: Known, keys: Array) -> Choice:
        every, numbers, scores = scored(setting, score, state, known.held)
        greedy = jnp.argmax(scores, 0)
        if futures == 0 and not len(known.coming):
            return choice_of(setting, every, numbers, greedy)
        _, rows = jax.lax.top_k(scores.T, width)  # the first is the greedy one
        B = len(keys)
        coming = jnp.broadcast_to(
            jnp.moveaxis(known.coming, 2, 0)[:, None], (B, copies, *known.coming.shape[:2])
        )
        coming = jnp.concatenate([coming, jax.vmap(drawn)(keys)], 2)

        def spread(leaf: Array, times: int) -> Array:
            return jnp.repeat(leaf, times, -1)

        # Copies of a place beside each other, places of a bin beside each other.
        first = rows.reshape(-1)
        wide = [jax.tree.map(lambda leaf: spread(leaf, width), offers) for offers in every]
        choice = choice_of(setting, wide, spread(numbers, width), first)
        bins = jax.tree.map(lambda leaf: spread(leaf, width), state)
        bins = place(setting, bins, choice.offers, choice.number, choice.there)
        volume = _volume(setting, choice)
        held = spread(known.held, width)
        bins, held = (jax.tree.map(lambda leaf: spread(leaf, copies), of) for of in (bins, held))
        slot = jnp.repeat(choice.slot, copies)
        queue = jnp.broadcast_to(coming[:, None], (B, width, *coming.shape[1:]))
        queue = jnp.moveaxis(queue.reshape(-1, *coming.shape[2:]), 0, -1)  # [C, 3, B width copies]
        more = _in_lanes(partial(_goes_on, setting, params), bins, held, slot, queue)
        ends = (volume[:, None] + more.reshape(B * width, copies)).reshape(B, width, copies)
        mean = (ends * weight).sum(2) / weight.sum()
        tried = jnp.where(choice.there.reshape(B, width), mean, NOWHERE)
        best = jnp.take_along_axis(rows, jnp.argmax(tried, 1)[:, None], 1)[:, 0]
        return choice_of(setting, every, numbers, best)

    return choose


def _kinds(setting: Setting) -> tuple[np.ndarray, np.ndarray]:
    """Items that differ however they are turned: int32 [kinds, 3]; how many are alike [kinds]."""
    sides = np.indices((setting.high,) * 3).reshape(3, -1).T + 1
    ways = np.array([sides[:, list(turn)] for turn in TURNS[setting.turns]])
    same = (ways * (setting.high + 1) ** np.arange(3)).sum(2).min(0)
    _, first, count = np.unique(same, return_index=True, return_counts=True)
    return sides[first].astype(np.int32), count


def _volume(setting: Setting, choice: Choice) -> Array:
    """The share of a bin that is taken: float32 [B], 0 where nothing is."""
    length, width, height = chosen(setting, choice.offers, choice.number)[0]
    volume = length.astype(jnp.float32) * width * height / np.prod(setting.problem.bin)
    return jnp.where(choice.there, volume, 0)


def _in_lanes(function: Callable[..., Array], *batch: Any) -> Array:
    """A function of batches, whose axis is the last one, in pieces of `LANES`: to float32 [B]."""

    def piece(part: Any) -> Array:
        return function(*jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), part))

    return in_pieces(piece, jax.tree.map(lambda leaf: jnp.moveaxis(leaf, -1, 0), batch), LANES)


def _goes_on(
    setting: Setting, params: Params, bins: State, held: Array, slot: Array, queue: Array
) -> Array:
    """What bins yet take of a queue, greedily, and what they are worth with it: float32 [B].

    Args:
        held: int32 [W, 3, B].
        slot: int32 [B], of what was taken from these, where the next of the queue goes.
        queue: int32 [C, 3, B], at least one.
    """
    score, slots = value_rule(params), jnp.arange(len(held))[:, None, None]
    choose, B = by_rule(setting, score), len(slot)
    keys = jnp.zeros((B, 0))

    def one(now: tuple, item: Array) -> tuple[tuple, None]:
        bins, held, slot, alive, volume = now
        held = jnp.where(slots == slot, item, held)
        choice = choose(bins, Known(held, held[:0]), keys)
        alive &= choice.there
        choice = choice._replace(there=alive)
        bins = place(setting, bins, choice.offers, choice.number, alive)
        return (bins, held, choice.slot, alive, volume + _volume(setting, choice)), None

    start = bins, held, slot, jnp.ones(B, bool), jnp.zeros(B)
    (bins, held, slot, alive, volume), _ = jax.lax.scan(one, start, queue[:-1])
    held = jnp.where(slots == slot, queue[-1], held)
    best = scored(setting, score, bins, held)[2].max(0)
    return volume + jnp.where(alive & (best > NOWHERE), best, 0)
