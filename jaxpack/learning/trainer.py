"""Training as one program: instances, rollout, placement, cost, losses, weights.

`make_train(config)` is the whole run as one pure function. The command line runs the same
`train_chunk`, a few updates per dispatch, so that it can report and checkpoint in between.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax import Array
from jax.sharding import Mesh
from jax.typing import ArrayLike

from jaxpack.learning.losses import Outcome
from jaxpack.learning.parameters import Params
from jaxpack.learning.recipe import TrainConfig
from jaxpack.learning.shuffle import shuffled
from jaxpack.model.instances import sample_at
from jaxpack.model.problem import Instance
from jaxpack.xla.devices import PART, WHOLE, mean_over_batch


class TrainState(NamedTuple):
    """All that a run carries from update to update; with the config it determines the rest."""

    params: Params  # float32 leaves
    optimizer: optax.OptState
    key: Array  # typed PRNG key[]; never changes, the streams are folded from it
    update: Array  # int32[], updates done; gives the position in the data
    learning_rate: Array  # float32[], before the schedule

    @property
    def kept(self) -> Params:
        """The weights that are validated and kept."""
        return self.optimizer.average if isinstance(self.optimizer, Averaged) else self.params


class Averaged(NamedTuple):
    """An optimizer's state and the mean of the weights. Only where the recipe has one: a state
    without it has no field for it, as in the checkpoints of before.
    """

    state: optax.OptState
    average: Params  # float32 leaves


class ChunkMetrics(NamedTuple):
    """Means over a chunk of updates, float32[] each."""

    outcome: Outcome  # of the sampled orders
    gradient_norm: Array
    finite: Array  # 1 where every loss, gradient and weight was finite


def init_state(
    config: TrainConfig,
    key: Array,
    learning_rate: ArrayLike | None = None,
    params: Params | None = None,
) -> TrainState:
    """A run's first state. `key` gives weights (if none are given), data, shuffles and samples."""
    if params is None:
        params = config.policy.init(config.problem, jax.random.fold_in(key, 0))
    rate = config.learning_rate if learning_rate is None else learning_rate
    optimizer = optax.scale_by_adam().init(params)
    if config.average:
        optimizer = Averaged(optimizer, jax.tree.map(jnp.copy, params))
    return TrainState(
        params=params,
        optimizer=optimizer,
        key=key,
        update=jnp.int32(0),
        learning_rate=jnp.asarray(rate, jnp.float32),
    )


def training_instances(config: TrainConfig, key: Array, rows: Array) -> Instance:
    """The instances at `rows` (int [...]) of the fixed training set of the run with this key.

    The set is a function of the key: it is made where it is used and never stored.
    """
    return sample_at(config.problem, config.distribution, jax.random.fold_in(key, 1), rows)


def validation_set(config: TrainConfig, key: Array, rows: Array) -> Instance:
    """The instances at `rows` (int [...]) of the fixed validation set of the run with this key."""
    return sample_at(config.problem, config.distribution, jax.random.fold_in(key, 2), rows)


def policy_gradient(
    config: TrainConfig, params: Params, instances: Instance, key: Array, mesh: Mesh | None = None
) -> tuple[Params, Outcome]:
    """The gradient of the config's loss on a batch of instances (leaves [B, ...]).

    Args:
        mesh: the devices that share the batch, from `data_mesh`; it does not change the result.
    """
    # A key for every order of the whole batch, whichever device draws it.
    keys = jax.random.split(key, (instances.mask.shape[0], config.samples))
    mean = mean_over_batch(mesh, partial(config.policy.gradient, config), (WHOLE, PART, PART))
    result: tuple[Params, Outcome] = mean(params, instances, keys)
    return result


def train_step(
    config: TrainConfig, state: TrainState, instances: Instance, mesh: Mesh | None = None
) -> tuple[TrainState, ChunkMetrics]:
    """One update from a batch of instances (leaves [B, ...]), shared by the devices of `mesh`."""
    key = jax.random.fold_in(jax.random.fold_in(state.key, 3), state.update)
    gradient, outcome = policy_gradient(config, state.params, instances, key, mesh)
    norm = optax.tree.norm(gradient)
    if not config.lacks("clip"):
        shrink = jnp.minimum(1, config.clip / jnp.maximum(norm, 1e-12))
        shrink = jnp.where(config.clip > 0, shrink, 1)
        gradient = jax.tree.map(lambda leaf: leaf * shrink, gradient)
    before = state.optimizer
    inner = before.state if isinstance(before, Averaged) else before
    direction, optimizer = optax.scale_by_adam().update(gradient, inner)
    rate = state.learning_rate
    if config.schedule == "cosine":
        rate *= optax.cosine_decay_schedule(1.0, config.updates)(state.update)
    params = jax.tree.map(lambda p, d: p - rate * d, state.params, direction)
    if isinstance(before, Averaged):
        # A mean over all updates while these are few: the weights at the start are of no use.
        decay = jnp.minimum(config.average, (1 + state.update) / (10 + state.update))
        mean = jax.tree.map(lambda a, p: decay * a + (1 - decay) * p, before.average, params)
        optimizer = Averaged(optimizer, mean)
    losses = (norm, outcome.actor_loss, outcome.critic_loss, optax.tree.norm(params))
    finite = jnp.isfinite(jnp.stack(losses)).all() * 1.0
    metrics = ChunkMetrics(outcome, norm, finite)
    state = state._replace(params=params, optimizer=optimizer, update=state.update + 1)
    return state, metrics


def train_updates(
    config: TrainConfig,
    state: TrainState,
    updates: int,
    mesh: Mesh | None = None,
    numbers: Mapping[str, Array] | None = None,
) -> tuple[TrainState, ChunkMetrics]:
    """`updates` updates (static) within one epoch: the batches follow the epoch's shuffle.

    Args:
        mesh: static, the devices that share each batch, from `data_mesh`; None: where the state is.
        numbers: instead of the config's, see `TrainConfig.traced`.
    """
    epoch, done = jnp.divmod(state.update, config.updates_per_epoch)
    shuffle_key = jax.random.fold_in(jax.random.fold_in(state.key, 4), epoch)

    def take(turn: TrainConfig, state: TrainState, rows: Array) -> tuple[TrainState, ChunkMetrics]:
        return train_step(turn, state, training_instances(turn, state.key, rows), mesh)

    kinds = list(dict.fromkeys(config.turns))  # each is compiled once
    turn_of = jnp.asarray([kinds.index(turn) for turn in config.turns])
    turns = [partial(take, turn.traced(numbers or {})) for turn in kinds]

    def update(state: TrainState, step: Array) -> tuple[TrainState, ChunkMetrics]:
        places = (done + step) * config.batch + jnp.arange(config.batch)
        rows = shuffled(shuffle_key, places, config.train_instances)
        return jax.lax.switch(turn_of[state.update % len(turn_of)], turns, state, rows)

    state, metrics = jax.lax.scan(update, state, jnp.arange(updates))
    means = jax.tree.map(jnp.mean, metrics)
    return state, means._replace(finite=metrics.finite.min())


train_chunk = partial(
    jax.jit, static_argnames=("config", "updates", "mesh"), donate_argnames=("state",)
)(train_updates)
"""`train_updates` compiled, the state's buffers reused: traced once per config and length."""


def make_train(
    config: TrainConfig,
) -> Callable[..., tuple[TrainState, ChunkMetrics]]:
    """The whole run as a pure function, to jit, and to vmap over keys and rates.

    REINFORCE with the baseline that the recipe names, or imitation. The critic is that of Wang and
    Dong, Eq. (10); samples as one another's baseline are from Kool, van Hoof and Welling, Buy 4
    REINFORCE samples, get a baseline for free (2019).

    Args:
        config: the recipe, static.

    Returns:
        train(key, learning_rate=None, numbers=None) -> (state, metrics). `key` is a typed PRNG key
        [], the rate float32 []; numbers such as {"entropy": float32 []} replace the recipe's:
        entropy, clip, alpha, beta. `state.params` are the weights after the last update,
        `state.kept` these or their mean, if the recipe has one; `metrics` are means over each
        epoch, float32 [epochs].
    """

    def train(
        key: Array,
        learning_rate: ArrayLike | None = None,
        numbers: Mapping[str, Array] | None = None,
    ) -> tuple[TrainState, ChunkMetrics]:
        def epoch(state: TrainState, _: None) -> tuple[TrainState, ChunkMetrics]:
            return train_updates(config, state, config.updates_per_epoch, numbers=numbers)

        state = init_state(config, key, learning_rate)
        return jax.lax.scan(epoch, state, None, length=config.epochs)

    return train
