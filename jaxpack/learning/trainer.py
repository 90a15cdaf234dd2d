"""Training as one program: instances, rollout, placement, cost, losses, Adam.

`make_train(config)` is the whole run as one pure function. The command line runs the same
`train_chunk`, a few updates per dispatch, so that it can report and checkpoint in between.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax import Array
from jax.typing import ArrayLike

from jaxpack.errors import UserError
from jaxpack.learning.losses import Losses, actor_critic_losses
from jaxpack.learning.pointer import (
    Params,
    PointerConfig,
    apply_value,
    init_pointer,
    sample_order,
)
from jaxpack.packing.first_fit import pack
from jaxpack.packing.instances import Distribution, sample_at
from jaxpack.packing.metrics import bins_used, compactness, paper_cost, pyramid
from jaxpack.packing.problem import Instance, Problem


@dataclass(frozen=True)
class TrainConfig:
    """A recipe: what is learned, from what, and for how long. Hashable, static under jit."""

    problem: Problem
    distribution: Distribution
    policy: PointerConfig = PointerConfig()
    train_instances: int = 100_000
    valid_instances: int = 10_000
    batch: int = 50  # B, instances per update
    epochs: int = 5
    learning_rate: float = 5e-4  # Adam, for actor and critic
    alpha: float = 0.5  # weight of compactness in Eq. (9)
    beta: float = 0.5  # weight of pyramid in Eq. (9)

    def __post_init__(self) -> None:
        self.distribution.check_fits(self.problem.bin)
        for name in ("train_instances", "valid_instances", "batch", "epochs"):
            if getattr(self, name) < 1:
                raise UserError(f"{name} {getattr(self, name)}: give at least 1")
        if self.batch > self.train_instances:
            raise UserError(
                f"batch {self.batch} is larger than train_instances {self.train_instances}"
            )
        if not self.learning_rate > 0:
            raise UserError(f"learning_rate {self.learning_rate}: give a positive rate")

    @property
    def updates_per_epoch(self) -> int:
        """Whole batches in the training set."""
        return self.train_instances // self.batch

    @property
    def updates(self) -> int:
        """Updates of a full run."""
        return self.updates_per_epoch * self.epochs


class TrainState(NamedTuple):
    """All that a run carries from update to update; with the config it determines the rest."""

    params: Params  # float32 leaves
    optimizer: optax.OptState
    key: Array  # typed PRNG key[]; never changes, the streams are folded from it
    update: Array  # int32[], updates done; gives the position in the data
    learning_rate: Array  # float32[]


class ChunkMetrics(NamedTuple):
    """Means over a chunk of updates, float32[] each."""

    cost: Array  # R of Eq. (9), of the sampled orders
    compactness: Array
    pyramid: Array
    bins: Array
    actor_loss: Array
    critic_loss: Array
    entropy: Array  # nats per choice
    gradient_norm: Array
    finite: Array  # 1 where every loss, gradient and weight was finite


def init_state(
    config: TrainConfig, key: Array, learning_rate: ArrayLike | None = None
) -> TrainState:
    """A run's first state. `key` gives weights, data, shuffles and samples."""
    params = init_pointer(config.problem, config.policy, jax.random.fold_in(key, 0))
    rate = config.learning_rate if learning_rate is None else learning_rate
    return TrainState(
        params=params,
        optimizer=optax.scale_by_adam().init(params),
        key=key,
        update=jnp.int32(0),
        learning_rate=jnp.asarray(rate, jnp.float32),
    )


def training_instances(config: TrainConfig, key: Array, rows: Array) -> Instance:
    """The instances at `rows` (int [...]) of the fixed training set of the run with this key.

    The set is a function of the key: it is made where it is used and never stored.
    """
    return sample_at(config.problem, config.distribution, jax.random.fold_in(key, 1), rows)


def validation_set(config: TrainConfig, key: Array) -> Instance:
    """The fixed validation set of the run with this key: leaves [valid_instances, ...]."""
    rows = jnp.arange(config.valid_instances)
    return sample_at(config.problem, config.distribution, jax.random.fold_in(key, 2), rows)


def train_step(
    config: TrainConfig, state: TrainState, instances: Instance
) -> tuple[TrainState, ChunkMetrics]:
    """One update of Eq. (10) from a batch of instances (leaves [B, ...])."""
    key = jax.random.fold_in(jax.random.fold_in(state.key, 3), state.update)
    keys = jax.random.split(key, instances.mask.shape[0])

    def loss(params: Params) -> tuple[Array, tuple[Losses, list[Array]]]:
        def outcome(instance: Instance, key: Array) -> tuple:
            rollout = sample_order(config.problem, config.policy, params, instance, key)
            packing = pack(config.problem, instance, rollout.order)
            cost = paper_cost(instance, packing, config.alpha, config.beta)
            value = apply_value(config.problem, config.policy, params, instance)
            judged = (compactness(instance, packing), pyramid(packing), bins_used(packing))
            return rollout, cost, value, judged

        rollout, cost, value, judged = jax.vmap(outcome)(instances, keys)
        losses = actor_critic_losses(rollout.log_prob, cost, value)
        means = [x.mean() for x in (cost, *judged, rollout.entropy)]
        return losses.actor + losses.critic, (losses, means)

    grads, (losses, means) = jax.grad(loss, has_aux=True)(state.params)
    norm = optax.tree.norm(grads)
    direction, optimizer = optax.scale_by_adam().update(grads, state.optimizer)
    params = jax.tree.map(lambda p, d: p - state.learning_rate * d, state.params, direction)
    cost, compact, pyramidal, bins, entropy = means
    checked = jnp.stack([norm, losses.actor, losses.critic, optax.tree.norm(params)])
    finite = jnp.isfinite(checked).all()
    metrics = ChunkMetrics(
        cost, compact, pyramidal, bins, losses.actor, losses.critic, entropy, norm, finite * 1.0
    )
    state = state._replace(params=params, optimizer=optimizer, update=state.update + 1)
    return state, metrics


def train_updates(
    config: TrainConfig, state: TrainState, updates: int
) -> tuple[TrainState, ChunkMetrics]:
    """`updates` updates (static) within one epoch: the batches follow the epoch's shuffle."""
    epoch, done = jnp.divmod(state.update, config.updates_per_epoch)
    shuffle_key = jax.random.fold_in(jax.random.fold_in(state.key, 4), epoch)
    shuffled = jax.random.permutation(shuffle_key, config.train_instances)

    def update(state: TrainState, step: Array) -> tuple[TrainState, ChunkMetrics]:
        first = (done + step) * config.batch
        rows = jax.lax.dynamic_slice_in_dim(shuffled, first, config.batch)
        return train_step(config, state, training_instances(config, state.key, rows))

    state, metrics = jax.lax.scan(update, state, jnp.arange(updates))
    means = jax.tree.map(jnp.mean, metrics)
    return state, means._replace(finite=metrics.finite.min())


train_chunk = partial(jax.jit, static_argnames=("config", "updates"), donate_argnames=("state",))(
    train_updates
)
"""`train_updates` compiled, the state's buffers reused: traced once per config and length."""


def make_train(
    config: TrainConfig,
) -> Callable[..., tuple[TrainState, ChunkMetrics]]:
    """The whole run as a pure function, to jit, and to vmap over keys and rates.

    Returns:
        train(key, learning_rate=None) -> (state, metrics): the final state, and the metrics of
        each epoch, leaves [epochs].
    """

    def train(
        key: Array, learning_rate: ArrayLike | None = None
    ) -> tuple[TrainState, ChunkMetrics]:
        def epoch(state: TrainState, _: None) -> tuple[TrainState, ChunkMetrics]:
            return train_updates(config, state, config.updates_per_epoch)

        state = init_state(config, key, learning_rate)
        return jax.lax.scan(epoch, state, None, length=config.epochs)

    return train
