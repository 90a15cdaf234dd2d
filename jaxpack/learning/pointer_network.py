"""The pointer network: its layers, and how it decodes an order.

Section II.B of the paper: a Conv1d encoder of width 1 (every item passes through the same
weights), a GRU decoder fed with the size of the item chosen last, additive attention (Eq. 6) and
a mask (Eq. 7). It sees sizes only, never the bin, so all it can express is an order of sizes.
The critic has four Conv1d layers, the first shared with the encoder.
"""

from collections.abc import Callable
from itertools import accumulate
from typing import TYPE_CHECKING, NamedTuple

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.learning.parameters import MASKED, Params
from jaxpack.model.problem import Instance, Problem

if TYPE_CHECKING:
    from jaxpack.learning.pointer import PointerConfig


class PointerNetwork(nn.Module):
    """Actor and critic in one module: the critic's first layer is the actor's encoder."""

    config: "PointerConfig"

    def setup(self) -> None:
        """Declares the layers."""
        hidden, critic = self.config.hidden, self.config.critic
        self.encoder = nn.Conv(hidden, (1,))
        self.cell = nn.GRUCell(hidden)
        self.attend_item = nn.Dense(hidden, use_bias=False)  # W1
        self.attend_state = nn.Dense(hidden, use_bias=False)  # W2
        self.attend_score = nn.Dense(1, use_bias=False)  # v
        self.critic = [nn.Conv(critic, (1,)), nn.Conv(critic, (1,)), nn.Conv(1, (1,))]

    def __call__(self, features: Array, mask: Array) -> tuple[Array, Array]:
        """One decoding step and the value; exists so that `init` meets every weight."""
        state = self.advance(self.initial_state(), features[0])
        return self.attend(state, self.keys(features)), self.value(features, mask)

    def initial_state(self) -> Array:
        """The GRU's state before the first item: zeros [D]."""
        return jnp.zeros(self.config.hidden)

    def keys(self, features: Array) -> Array:
        """W1 e_j for every item: [N, M] -> [N, D]. It does not change while decoding."""
        return self.attend_item(self.encoder(features))

    def advance(self, state: Array, last: Array) -> Array:
        """The GRU's next state [D] after the item with features `last` [M]."""
        following: Array = self.cell(state, last)[0]
        return following

    def attend(self, state: Array, keys: Array) -> Array:
        """Scores [N] of the items: u_j = v^T tanh(W1 e_j + W2 h), Eq. (6)."""
        return self.attend_score(jnp.tanh(keys + self.attend_state(state)))[:, 0]

    def value(self, features: Array, mask: Array) -> Array:
        """The critic: expected cost of an instance, mean over its items. Scalar."""
        hidden = nn.relu(self.encoder(features))
        for layer in self.critic[:-1]:
            hidden = nn.relu(layer(hidden))
        values = self.critic[-1](hidden)[:, 0]
        return jnp.where(mask, values, 0).sum() / jnp.maximum(mask.sum(), 1)


class Rollout(NamedTuple):
    """An order and what the policy thought of it."""

    order: Array  # int32[N]
    log_prob: Array  # float32[], of the whole order (padding adds nothing)
    entropy: Array  # float32[], mean over the choices, nats


def features_of(problem: Problem, config: "PointerConfig", instance: Instance) -> Array:
    """The network's input, float32 [N, M], M = 2 in 2D, 3 in 3D: input_scale * side / bin side.

    The paper does not say how sizes are scaled, and it matters. As shares of the bin (scale 1)
    tanh in Eq. (6) stays near its linear part, scores are linear in the sides, and training in
    2D ends at the height sort to the digit; see experiments/input_scale.py.
    """
    axes = jnp.asarray(problem.axes)
    return config.input_scale * instance.size[:, axes] / instance.bin[axes].astype(jnp.float32)


def init_pointer(problem: Problem, config: "PointerConfig", key: Array) -> Params:
    """Fresh weights of actor and critic. `key` is a typed PRNG key, consumed.

    Kernels are uniform with variance 1 / fan in, biases zero. All come from one draw: flax's own
    initialisers, one program per kernel and a QR decomposition per gate of the GRU, cost half a
    second at every start.
    """
    network, features = PointerNetwork(config), jnp.zeros((1, len(problem.axes)))
    shapes = jax.eval_shape(network.init, key, features, jnp.ones(1, bool))["params"]
    leaves, structure = jax.tree.flatten(shapes)
    ends = list(accumulate(leaf.size for leaf in leaves))
    drawn = jnp.split(jax.random.uniform(key, (ends[-1],), minval=-1, maxval=1), ends[:-1])

    def scaled(leaf: jax.ShapeDtypeStruct, values: Array) -> Array:
        if len(leaf.shape) == 1:
            return jnp.zeros(leaf.shape)
        fan_in = leaf.size // leaf.shape[-1]
        return values.reshape(leaf.shape) * (3 / fan_in) ** 0.5

    return jax.tree.unflatten(structure, map(scaled, leaves, drawn))


def apply_value(
    problem: Problem, config: "PointerConfig", params: Params, instance: Instance
) -> Array:
    """The critic's estimate of the cost of one instance: float32 scalar."""
    network = PointerNetwork(config).bind({"params": params})
    return network.value(features_of(problem, config, instance), instance.mask)


def sample_order(
    problem: Problem,
    config: "PointerConfig",
    params: Params,
    instance: Instance,
    key: Array,
    temperature: float = 1.0,
) -> Rollout:
    """Draws an order item by item from Eq. (7), as in training; differentiable in `params`.

    Its log-probability is that at temperature 1.
    """
    noise = temperature * jax.random.gumbel(key, (instance.mask.shape[0],) * 2)

    def choose(scores: Array, step: Array) -> Array:
        return jnp.argmax(scores + noise[step])

    return _decode(problem, config, params, instance, choose)


def greedy_order(
    problem: Problem, config: "PointerConfig", params: Params, instance: Instance
) -> Array:
    """The most probable item at every step, as in testing: int32 [N]."""
    return _decode(problem, config, params, instance, lambda scores, _: jnp.argmax(scores)).order


def score_order(
    problem: Problem, config: "PointerConfig", params: Params, instance: Instance, order: Array
) -> Rollout:
    """Log-probability of a given order (int [N], padding last)."""
    return _decode(problem, config, params, instance, lambda _, step: order[step])


def _decode(
    problem: Problem,
    config: "PointerConfig",
    params: Params,
    instance: Instance,
    choose: Callable[[Array, Array], Array],
) -> Rollout:
    """Decodes one instance; `choose(scores [N], step)` names the next item."""
    network = PointerNetwork(config).bind({"params": params})
    items = instance.mask.shape[0]
    features = features_of(problem, config, instance)
    keys = network.keys(features)

    def step(carry: tuple[Array, Array, Array], index: Array) -> tuple[tuple, tuple]:
        state, last, waiting = carry
        state = network.advance(state, last)
        scores = network.attend(state, keys)
        # Padding waits until no item does: a floor below every score, above the chosen ones.
        open_items = waiting & instance.mask
        some = open_items.any()
        scores = jnp.where(open_items | (waiting & ~some), scores, MASKED)
        item = choose(jax.lax.stop_gradient(scores), index)
        log_probs = jax.nn.log_softmax(scores)
        entropy = -(jnp.exp(log_probs) * log_probs).sum()
        log_prob = jnp.where(some, log_probs[item], 0)
        carry = (state, features[item], waiting & (jnp.arange(items) != item))
        return carry, (item, log_prob, jnp.where(some, entropy, 0))

    start = (network.initial_state(), jnp.zeros(features.shape[1]), jnp.ones(items, bool))
    _, (order, log_probs, entropies) = jax.lax.scan(step, start, jnp.arange(items))
    return Rollout(
        order=order.astype(jnp.int32),
        log_prob=log_probs.sum(),
        entropy=entropies.sum() / instance.mask.sum(),
    )
