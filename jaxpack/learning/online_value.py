"""What a partly filled bin is worth while items come one by one: the volume that will yet go in.

A network of two hidden layers sees what every footprint would find in the bin (`Fits`), how many
cells are how high and how rough they are. The next item goes where the bin is worth most
afterwards. The value is learned from play, by temporal differences: the worth of a bin is the
volume of the item that comes next and the worth of the bin then (Sutton, 1988; of positions that
are one's own move, as Tesauro's backgammon has it, 1995).
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.learning.parameters import Params
from jaxpack.packing.online import Setting, State, empty, look, place
from jaxpack.packing.online_view import (
    Places,
    Score,
    after,
    fits,
    levels,
    places,
    roughness,
    scores,
)
from jaxpack.xla.programs import apart

HIDDEN = (128, 32)


class Step(NamedTuple):
    """What came of one item in each bin."""

    state: State
    fits: Array  # bool [B], whether there was a place for it
    heights: Array  # cell_dtype [L, W, B], see `after`
    firm: Array  # bool [L, W, B]
    value: Array  # float32 [B], of these


def features(setting: Setting, heights: Array, firm: Array) -> Array:
    """What the network sees: float32 [F, *batch], most of it from 0 to 1.

    Args:
        heights: cell_dtype [L, W, *batch].
        firm: bool [L, W, *batch].
    """
    L, W, H = setting.problem.bin
    found = fits(setting, heights, firm, setting.problem.window)
    steps, number = roughness(heights)
    scaled = (
        (found.flat, H), (found.flats, L * W / 4), (found.space, L * W * H / 10), (found.lowest, H),
        (levels(setting, heights), L * W / 4), (steps[None], L * W), (number[None], L * W / 2),
    )  # fmt: skip
    return jnp.concatenate([leaf.astype(jnp.float32) / scale for leaf, scale in scaled])


def init_value(setting: Setting, key: Array) -> Params:
    """Fresh weights: every bin is worth a share of what is free in it."""
    seen = jax.eval_shape(
        lambda state: features(setting, *inside(setting, state)), empty_one(setting)
    ).shape[0]
    sizes = (seen, *HIDDEN)
    params: Params = {}
    for layer, (into, out) in enumerate(zip(sizes, HIDDEN, strict=False)):
        drawn = jax.random.normal(jax.random.fold_in(key, layer), (out, into))
        params |= {f"weights{layer}": drawn * (1.5 / into) ** 0.5, f"bias{layer}": jnp.zeros(out)}
    return params | {"out": jnp.zeros(HIDDEN[-1]), "share": jnp.float32(0.6)}


def empty_one(setting: Setting) -> State:
    """One empty bin."""
    return empty(setting, 1)


def inside(setting: Setting, state: State) -> tuple[Array, Array]:
    """Heights and what is firm [L, W, B], without the walls."""
    L, W, _ = setting.problem.bin
    return state.heights[:L, :W], state.firm[:L, :W]


def worth(setting: Setting, params: Params, heights: Array, firm: Array) -> Array:
    """The share of its volume that will yet go into each bin: float32 [*batch].

    Args:
        heights, firm: see `features`.
    """
    L, W, H = setting.problem.bin
    seen = features(setting, heights, firm)
    level = jnp.arange(H + 1, dtype=jnp.float32)
    hidden = seen.reshape(len(seen), -1)
    cells = hidden[-3 - H : -2] * (L * W / 4)
    free = 1 - (cells * level[:, None]).sum(0) / (L * W * H)
    for layer in range(len(HIDDEN)):
        bias = params[f"bias{layer}"][:, None]
        hidden = jax.nn.relu(params[f"weights{layer}"] @ hidden + bias)
    share = params["out"] @ hidden + params["share"]
    return (share * free).reshape(heights.shape[2:])


def worth_after(params: Params) -> Score:
    """What the bin is worth with the item."""

    def score(setting: Setting, state: State, place: Places) -> Array:
        heights, firm = after(setting, state, place)
        always = (place.number >= 0).any()
        return apart(always, partial(worth, setting, params), heights, firm)

    return score


def greedy_step(setting: Setting, params: Params, state: State, items: Array) -> Step:
    """Every bin takes its next item where it is worth most then.

    Args:
        items: int [3, B].
    """
    always = (state.heights >= 0).any()
    offers = apart(always, partial(look, setting), state, items)
    found = apart(always, partial(places, setting), state, offers)
    values = scores(setting, worth_after(params), state, found)
    best = jnp.argmax(values, 0)
    value, taken = jax.tree.map(
        lambda leaf: jnp.take_along_axis(leaf, best[None], 0)[0], (values, found)
    )
    heights, firm = after(setting, state, taken)
    state = place(setting, state, offers, taken.number, taken.there)
    return Step(state, taken.there, heights, firm, value)
