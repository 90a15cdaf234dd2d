"""What the bin-aware policy sees of each candidate, and the network that scores it.

Every kind of item that remains is a row: what it is, where the rule would put it in the current
bin and what it would touch there. The context is the height map as a histogram of levels and
what is left to pack. Rows pass through shared layers (they meet in two pooled means), so K, the
bin and the sizes may be others than in training. R is the number of a row's features, G of the
context's, D the width of the layers; all come last.
"""

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.learning.parameters import MASKED, Params
from jaxpack.model.problem import Problem
from jaxpack.packing.env import Choices, State
from jaxpack.packing.view import LEVELS, View

if TYPE_CHECKING:
    from jaxpack.learning.bin_aware import BinAwareConfig

BUCKETS = LEVELS  # of the histograms over sides


class Sees(NamedTuple):
    """What a row says of its candidate, beside its sizes."""

    placement: bool  # where it would rest
    surroundings: bool  # what lies under and beside it there
    stock: bool  # what of the rest would fill the gaps beside and above it exactly


SEES = {
    "sizes": Sees(False, False, False),
    "placement": Sees(True, False, False),
    "surroundings": Sees(True, True, False),
    "stock": Sees(True, False, True),
    "all": Sees(True, True, True),
}


class Sight(NamedTuple):
    """What the network sees before a choice."""

    rows: Array  # float32 [K, B, R]
    context: Array  # float32 [B, G]
    remaining: Array  # int32 [K, B]
    fits: Array  # bool [K, B]


def look(network: "BinAwareConfig", view: View, state: State, choices: Choices) -> Sight:
    """What the network sees of the choices, from `observe`."""
    shares = (
        _row_features(network, view, state, choices),
        _context_features(network, state, choices),
    )
    rows, context = (network.input_scale * (share - network.input_centre) for share in shares)
    # Once a kind, wherever it could stand: of one rule these are all rows.
    further = (view.rules - 1) * len(state.remaining)
    remaining = jnp.pad(state.remaining, ((0, further), (0, 0)))
    return Sight(rows, context, remaining, choices.allowed)


def _row_features(network: "BinAwareConfig", view: View, state: State, choices: Choices) -> Array:
    """What each row is: float32 [K, B, R], lengths relative to the bin's sides."""
    kinds, candidates = state.kinds, choices.candidates
    sides = [jnp.tile(side, (view.rules, 1)) for side in kinds.sides]
    remaining = jnp.tile(state.remaining, (view.rules, 1))
    length, width, height = (side.astype(jnp.float32) for side in sides)
    bin_x, bin_y, ceiling = kinds.bin.astype(jnp.float32)
    area, sees = jnp.maximum(length * width, 1), SEES[network.sees]
    volume = length * width * height / (bin_x * bin_y * ceiling)
    rows = [
        length / bin_x, width / bin_y, height / ceiling, 8 * volume,
        jnp.minimum(remaining, 8) / 4,
    ]  # fmt: skip
    if sees.placement:
        x, y, z = (place.astype(jnp.float32) for place in candidates.corner)
        top = z + height
        rows += [
            x / bin_x, y / bin_y, z / ceiling, top / ceiling, candidates.supported / area,
            (top - choices.outline.highest) / ceiling, 1.0 * (top == ceiling),
            candidates.level / (bin_x * bin_y),
        ]  # fmt: skip
    if sees.surroundings:
        around = candidates.around
        beside = ((around.left, width), (around.right, width),
                  (around.front, length), (around.back, length))  # fmt: skip
        means = [total / jnp.maximum(cells, 1) for total, cells in beside]
        rows += [(z - around.under / area) / ceiling]
        rows += [(mean - z) / ceiling for mean in means]
        rows += [jnp.abs(mean - top) / ceiling for mean in means]
        rows += [around.gap_left / bin_x, around.gap_right / bin_x]
        rows += [around.gap_front / bin_y, around.gap_back / bin_y]
    if sees.stock:
        around = candidates.around
        free = kinds.bin[2] - (candidates.corner[2] + sides[2]).astype(jnp.int32)
        rows += [
            _stock_at(view, axis, state, wanted) / 4
            for axis, wanted in enumerate((around.gap_right, around.gap_back, free))
        ]
        rows += [1.0 * (around.gap_right == 0), 1.0 * (around.gap_back == 0)]
    # What does not remain or does not fit has no meaning, and a wall's height for z.
    present = remaining > 0
    rows = [jnp.where(present, jnp.clip(row, -2, 2), 0).astype(jnp.float32) for row in rows]
    return jnp.stack(rows, -1)


def _context_features(network: "BinAwareConfig", state: State, choices: Choices) -> Array:
    """What all rows share: float32 [B, G]."""
    kinds, outline = state.kinds, choices.outline
    length, width, height = (side.astype(jnp.float32) for side in kinds.sides)
    bin_x, bin_y, ceiling = kinds.bin.astype(jnp.float32)
    capacity = bin_x * bin_y * ceiling
    remaining = state.remaining * kinds.share
    volume = remaining * length * width * height / capacity
    left = volume.sum(0)
    # A whole number of bins leaves nothing over, in whatever order a program has summed them.
    over = left - jnp.floor(left + 5e-5)
    shares = [
        state.used / capacity, left / 4, jnp.minimum(left, 1), over,
        outline.highest / ceiling, outline.volume / capacity,
        remaining.sum(0) / 40, state.used == 0,
    ]  # fmt: skip
    levels = outline.levels / (bin_x * bin_y)
    sides = ((height, ceiling), (length, bin_x), (width, bin_y))
    stock = []
    for side, whole in sides if SEES[network.sees].stock else sides[:1]:
        bucket = jnp.ceil(side * BUCKETS / whole).astype(jnp.int32) - 1
        stock.append(jnp.where(bucket == jnp.arange(BUCKETS)[:, None, None], volume, 0).sum(1))
    return jnp.concatenate([jnp.stack(shares), levels, *stock]).T


def init_network(network: "BinAwareConfig", problem: Problem, key: Array) -> Params:
    """Fresh weights from one draw: variance 1 / fan in, biases and the last layer zero.

    They are the same for every problem.
    """
    shapes = _shapes(network)
    keys = jax.random.split(key, len(shapes))
    return {
        name: jnp.zeros(shape)
        if len(shape) == 1 or name == "score"
        else jax.random.uniform(k, shape, minval=-1, maxval=1) * (3 / shape[0]) ** 0.5
        for k, (name, shape) in zip(keys, shapes.items(), strict=True)
    }


def rescale_inputs(params: Params, was: "BinAwareConfig", now: "BinAwareConfig") -> Params:
    """Weights that make of what `now` lets in what `params` make of what `was` lets in.

    W s (x - c) + b = (W s / s') s' (x - c') + b + W s (c' - c) 1, of each layer that inputs enter.
    """
    ratio, further = was.input_scale / now.input_scale, now.input_centre - was.input_centre
    features = params["context"].shape[0]
    changed = dict(params)
    for name, bias in (("rows", "bias1"), ("context", "bias1"), ("mix", "bias2")):
        entering = params[name][:features] if name == "mix" else params[name]
        changed[bias] += further * was.input_scale * entering.sum(0)
        changed[name] = jnp.concatenate([ratio * entering, params[name][len(entering) :]])
    return changed


def scores(network: "BinAwareConfig", params: Params, sight: Sight) -> Array:
    """Log-probabilities of the rows: float32 [K, B], MASKED where the row does not fit."""
    rows, context, remaining, fits = sight
    K, B, _ = rows.shape

    def shared_by_rows(name: str, inputs: Array) -> Array:
        """One plain matrix product: XLA's CPU code is slow on any other form."""
        flat = inputs.reshape(K * B, -1) @ params[name]
        return flat.reshape(K, B, -1)

    shift = context @ params["context"] + params["bias1"]
    hidden = jax.nn.relu(shared_by_rows("rows", rows) + shift)
    if network.pooling:
        weights = (remaining.astype(jnp.float32), fits.astype(jnp.float32))
        shares = [weight / jnp.maximum(weight.sum(0), 1) for weight in weights]
        pooled = [jnp.einsum("kb,kbd->bd", share, hidden) for share in shares]
        context = jnp.concatenate([context, *pooled], -1)
    if network.attention:
        hidden += _attend(network, params, hidden, remaining > 0)
    shift = jax.nn.relu(context @ params["mix"] + params["bias2"]) @ params["shift"]
    middle = jax.nn.relu(shared_by_rows("deep", hidden) + shift)
    score = shared_by_rows("score", middle)[..., 0]
    masked = jnp.where(fits, score, MASKED)
    return jnp.where(fits, jax.nn.log_softmax(masked, axis=0), MASKED)


def _attend(network: "BinAwareConfig", params: Params, hidden: Array, present: Array) -> Array:
    """Multi-head attention among the rows of one instance: [K, B, D] -> [K, B, D]."""
    K, B, D = hidden.shape
    heads = (K, B, network.attention, D // network.attention)
    query, key, value = ((hidden @ params[n]).reshape(heads) for n in ("query", "key", "value"))
    weight = jnp.einsum("kbhd,jbhd->bhkj", query, key) / heads[-1] ** 0.5
    weight = jax.nn.softmax(jnp.where(present.T[:, None, None], weight, MASKED), axis=-1)
    mixed = jnp.einsum("bhkj,jbhd->kbhd", weight, value).reshape(K, B, D)
    return mixed @ params["out"]


def _shapes(network: "BinAwareConfig") -> dict[str, tuple[int, ...]]:
    D, sees = network.hidden, SEES[network.sees]
    rows = 5 + 8 * sees.placement + 13 * sees.surroundings + 5 * sees.stock
    context = 8 + (4 if sees.stock else 2) * BUCKETS
    mixed = context + 2 * D * network.pooling
    shapes: dict[str, tuple[int, ...]] = {
        "rows": (rows, D), "context": (context, D), "bias1": (D,),
        "mix": (mixed, D), "bias2": (D,), "shift": (D, D), "deep": (D, D), "score": (D, 1),
    }  # fmt: skip
    if network.attention:
        shapes |= dict.fromkeys(("query", "key", "value", "out"), (D, D))
    return shapes


def _stock_at(view: View, axis: int, state: State, wanted: Array) -> Array:
    """How many of the remaining items have exactly the wanted side, 4 at most: [K, B]."""
    sides, wanted = state.kinds.sides[axis], wanted.astype(jnp.int32)
    if view.cells is None:
        wanted = jnp.clip(wanted, 0, state.kinds.bin[axis])
        alike = (sides == wanted[:, None]) & (wanted > 0)[:, None]
        return jnp.minimum(jnp.where(alike, state.remaining, 0).sum(1), 4)
    most = view.cells[axis]
    lengths = jnp.arange(most + 1, dtype=sides.dtype)[:, None, None]
    stock = jnp.where(sides == lengths, state.remaining, 0).sum(1).at[0].set(0)
    return jnp.minimum(jnp.take_along_axis(stock, jnp.clip(wanted, 0, most), 0), 4)
