"""The pointer network's gradient: orders are drawn with a memory of it, and gone through backwards.

Lanes L are all orders of a batch, B * S. What each step made is kept but for the attention, [N, N,
L, D] numbers, which the way back works out again: step by step, and only for the items that were
waiting then, half of all. What does not wait for the step before is one matrix product for all
steps, which is what XLA's CPU code is fast at.
"""

from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.learning.losses import Outcome, actor_critic_losses, judge, leave_one_out
from jaxpack.learning.parameters import MASKED, Params
from jaxpack.learning.pointer_network import apply_value, features_of
from jaxpack.model.problem import Instance
from jaxpack.packing.first_fit import pack

if TYPE_CHECKING:
    from jaxpack.learning.pointer import PointerConfig
    from jaxpack.learning.recipe import TrainConfig

STRETCHES = 4  # of the steps of an order: items that are taken before one are left out of it
LARGEST = 43.0  # of exponents, halved: two exponentials multiply to what float32 holds, or infinity
GATES = ("r", "z", "n")  # reset, update and new state: flax's names of the GRU's matrices


class Drawn(NamedTuple):
    """Orders, and what the network made on its way to them."""

    order: Array  # int32 [N, L]
    scores: Array  # float32 [N, N, L], of step and item; MASKED where it may not be taken
    features: Array  # float32 [N, L, M], of the items
    keys: Array  # float32 [N, L, D], of the items: see `_exponential`
    queries: Array  # float32 [N, L, D], of the steps, likewise
    states: Array  # float32 [N, L, D], of the GRU after each step
    gates: tuple[Array, ...]  # float32 [N, L, D] each, of the GRU at each step: see `_gates`


def pointer_gradient(
    config: "TrainConfig",
    network: "PointerConfig",
    params: Params,
    instances: Instance,
    keys: Array,
) -> tuple[Params, Outcome]:
    """Gradient of Eq. (10), and what the sampled orders were like. `keys`: [B, S]."""
    B, S = keys.shape
    features = jax.vmap(partial(features_of, config.problem, network))(instances)
    features, mask = (jnp.moveaxis(jnp.repeat(x, S, 0), 0, 1) for x in (features, instances.mask))
    N = len(mask)
    noise = jax.vmap(lambda key: jax.random.gumbel(key, (N, N)), out_axes=-1)(keys.reshape(-1))
    drawn = draw_orders(params, features, mask, noise)
    orders = drawn.order.T.reshape(B, S, N)

    def outcome(instance: Instance, order: Array) -> tuple[Array, ...]:
        return judge(config, instance, pack(config.problem, instance, order))

    cost, *measures = jax.vmap(jax.vmap(outcome, (None, 0)))(instances, orders)

    def loss(params: Params) -> tuple[Array, Outcome]:
        log_prob, entropy = _log_probs(scores_of(params, drawn), drawn.order, mask)
        if config.learner == "critic":
            value = partial(apply_value, config.problem, network, params)
            baseline = jax.vmap(value)(instances)[:, None]
        else:
            baseline = cost - leave_one_out(cost)
        losses = actor_critic_losses(log_prob.reshape(B, S), cost, baseline)
        total = losses.actor + losses.critic
        if not config.lacks("entropy"):
            total -= config.entropy * entropy.mean()
        means = [x.mean() for x in (cost, *measures)]
        each = (entropy / mask.sum(0)).mean()
        return total, Outcome._make([*means, losses.actor, losses.critic, each])

    return jax.grad(loss, has_aux=True)(params)


def draw_orders(params: Params, features: Array, mask: Array, noise: Array) -> Drawn:
    """Orders drawn item by item from Eq. (7).

    Args:
        features: float32 [N, L, M], of the items, see `features_of`.
        mask: bool [N, L].
        noise: float32 [N, N, L], of step and item, Gumbel's.
    """
    items, lanes = mask.shape
    cell, column = params["cell"], params["attend_score"]["kernel"]
    hidden = len(column)
    keys = _exponential(_keys(params, features))
    of_item = jnp.concatenate([cell[f"i{gate}"]["kernel"] for gate in GATES], 1)
    biases = jnp.concatenate([cell[f"i{gate}"]["bias"] for gate in GATES])
    weights = jnp.concatenate([_of_state(cell), params["attend_state"]["kernel"]], 1)

    def step(carry: tuple, noise: Array) -> tuple[tuple, tuple]:
        state, of_state, last, waiting = carry
        gates = _gates(cell, of_state, last @ of_item + biases)
        _, update, new, _ = gates
        state = (1 - update) * new + update * state
        of_state, query = jnp.split(state @ weights, [3 * hidden], 1)
        query = _exponential(query)
        shares = 1 / (1 + keys * query)
        scores = column.sum() - 2 * (shares.reshape(-1, hidden) @ column).reshape(items, lanes)
        # Padding waits until no item does: a floor below every score, above the taken ones.
        open_items = waiting & mask
        scores = jnp.where(open_items | (waiting & ~open_items.any(0)), scores, MASKED)
        item = jnp.argmax(scores + noise, 0).astype(jnp.int32)
        taken = jnp.arange(items)[:, None] == item
        last = (features * taken[..., None]).sum(0)
        carry = (state, of_state, last, waiting & ~taken)
        return carry, (item, scores, query, state, gates)

    nothing = jnp.zeros((lanes, 3 * hidden))
    start = (nothing[:, :hidden], nothing, jnp.zeros_like(features[0]), jnp.ones_like(mask))
    _, (order, scores, queries, states, gates) = jax.lax.scan(step, start, noise)
    return Drawn(order, scores, features, keys, queries, states, gates)


def _log_probs(scores: Array, order: Array, mask: Array) -> tuple[Array, Array]:
    """Log-probability of every order, and the entropy of its choices: float32 [L] each."""
    log_probs = jax.nn.log_softmax(scores, axis=1)
    # Padding comes last, and is no choice.
    chosen = (jnp.arange(len(mask))[:, None] == order[:, None]) & mask
    entropy = -(jnp.exp(log_probs) * log_probs).sum(1)
    some = jnp.arange(len(mask))[:, None] < mask.sum(0)
    return jnp.where(chosen, log_probs, 0).sum((0, 1)), jnp.where(some, entropy, 0).sum(0)


@jax.custom_vjp
def scores_of(params: Params, drawn: Drawn) -> Array:
    """The scores that the orders were drawn by, as a function of the weights that made them."""
    return drawn.scores


def _scores_forward(params: Params, drawn: Drawn) -> tuple[Array, tuple[Params, Drawn]]:
    return drawn.scores, (params, drawn)


def _scores_back(saved: tuple[Params, Drawn], given: Array) -> tuple[Params, None]:
    """The weights' gradient from that of the scores, float32 [N, N, L]."""
    params, drawn = saved
    order = drawn.order[..., None]
    features = jnp.take_along_axis(drawn.features, order, 0)  # in the order of the steps
    keys = jnp.take_along_axis(drawn.keys, order, 0)
    given = jnp.take_along_axis(given, drawn.order[None], 1)
    column = params["attend_score"]["kernel"]
    by_key, by_query, by_column = _attention_back(keys, drawn.queries, given)
    slopes = 4 * column[:, 0]
    (found,) = jax.vjp(lambda params: _keys(params, features), params)[1](slopes * by_key)
    by_query *= slopes
    by_state = by_query @ params["attend_state"]["kernel"].T
    found["attend_state"]["kernel"] = _product(drawn.states, by_query)
    found["attend_score"]["kernel"] = given.sum() - 2 * by_column.T
    before = jnp.concatenate([jnp.zeros_like(features[:1]), features[:-1]])
    found["cell"] = _gru_back(params["cell"], drawn, before, by_state)
    return found, None


scores_of.defvjp(_scores_forward, _scores_back)


def _attention_back(keys: Array, queries: Array, given: Array) -> tuple[Array, Array, Array]:
    """What is summed up of Eq. (6) on the way back, but for constant factors.

    With s = 1 / (1 + exp(2a) exp(2b)), tanh(a + b) is 1 - 2s and its slope 4 s (1 - s): an
    exponential for each item and each step, and a division for each pair of them.

    Args:
        keys: float32 [N, L, D], of the items in the order of the steps that took them.
        queries: float32 [N, L, D], of the steps.
        given: float32 [N, N, L], gradient of the scores; 0 of items taken before.

    Returns:
        given s (1 - s), float32 [N, L, D] by key and by query, and given s, [1, D].
    """
    items, hidden = len(keys), keys.shape[-1]
    by_key, by_query, by_column = jnp.zeros_like(keys), [], jnp.zeros((1, hidden))
    ends = sorted({round(items * part / STRETCHES) for part in range(STRETCHES + 1)})
    for first, last in pairwise(ends):
        waiting = keys[first:]
        ones = jnp.ones((1, len(waiting)))

        def step(
            total: tuple[Array, Array],
            inputs: tuple[Array, Array],
            waiting: Array = waiting,
            ones: Array = ones,
        ) -> tuple[tuple[Array, Array], Array]:
            (by_key, by_column), (query, given) = total, inputs
            shares = 1 / (1 + waiting * query)
            # Sums as matrix products: else XLA's CPU code adds one number after the other.
            by_column += given.reshape(1, -1) @ shares.reshape(-1, hidden)
            slope = given[..., None] * shares * (1 - shares)
            by_query = (ones @ slope.reshape(len(waiting), -1)).reshape(query.shape)
            return (by_key + slope, by_column), by_query

        start = (jnp.zeros_like(waiting), by_column)
        inputs = (queries[first:last], given[first:last, first:])
        (found, by_column), stretch = jax.lax.scan(step, start, inputs)
        by_key = by_key.at[first:].add(found)
        by_query.append(stretch)
    return by_key, jnp.concatenate(by_query), by_column


def _gru_back(cell: Params, drawn: Drawn, before: Array, by_state: Array) -> Params:
    """The gradient of the GRU's weights.

    Args:
        before: float32 [N, L, M], features of the item that each step began with.
        by_state: float32 [N, L, D], gradient of the states after each step but for the next ones.
    """
    states = jnp.concatenate([jnp.zeros_like(drawn.states[:1]), drawn.states[:-1]])
    weights = _of_state(cell).T

    def step(later: Array, inputs: tuple) -> tuple[Array, tuple[Array, Array]]:
        by_state, state, (reset, update, new, part) = inputs
        by_state += later
        by_new = by_state * (1 - update) * (1 - new**2)
        by_reset = by_new * part * reset * (1 - reset)
        by_update = by_state * (state - new) * update * (1 - update)
        by_made = jnp.concatenate([by_reset, by_update, by_new], 1)
        of_state = jnp.concatenate([by_reset, by_update, by_new * reset], 1)
        return by_state * update + of_state @ weights, (by_made, of_state)

    inputs = (by_state, states, drawn.gates)
    _, (by_made, of_state) = jax.lax.scan(step, jnp.zeros_like(states[0]), inputs, reverse=True)
    found: Params = {}
    for kind, of, by in (("i", before, by_made), ("h", states, of_state)):
        kernels, biases = _product(of, by), by.sum((0, 1))
        for part, gate in enumerate(GATES):
            mine = slice(part * weights.shape[1], (part + 1) * weights.shape[1])
            found[kind + gate] = {"kernel": kernels[:, mine]}
            if "bias" in cell[kind + gate]:
                found[kind + gate]["bias"] = biases[mine]
    return found


def _gates(cell: Params, of_state: Array, of_item: Array) -> tuple[Array, ...]:
    """The GRU's reset, update and new state, and what the new one takes of the old, by reset."""
    (reset, update, part), (r, z, n) = jnp.split(of_state, 3, 1), jnp.split(of_item, 3, 1)
    part += cell["hn"]["bias"]
    reset, update = jax.nn.sigmoid(r + reset), jax.nn.sigmoid(z + update)
    return reset, update, jnp.tanh(n + reset * part), part


def _of_state(cell: Params) -> Array:
    """The GRU's matrices of its state, side by side: float32 [D, 3 D]."""
    return jnp.concatenate([cell[f"h{gate}"]["kernel"] for gate in GATES], 1)


def _keys(params: Params, features: Array) -> Array:
    """W1 e_j of every item: float32 [..., M] -> [..., D]."""
    encoder = params["encoder"]
    return (features @ encoder["kernel"][0] + encoder["bias"]) @ params["attend_item"]["kernel"]


def _exponential(numbers: Array) -> Array:
    """exp(2x), within bounds: beyond them tanh of a sum with anything reasonable is -1 or 1."""
    return jnp.exp(2 * jnp.clip(numbers, -LARGEST, LARGEST))


def _product(inputs: Array, by: Array) -> Array:
    """Gradient of a matrix: inputs [..., I] and gradients of what it made of them [..., O]."""
    return inputs.reshape(-1, inputs.shape[-1]).T @ by.reshape(-1, by.shape[-1])
