"""Many runs as one program. Members differ in their seeds, rates and other numbers of the recipe.

M is the axis of members, the leading one of all leaves. Each device has a part of them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import jax
from jax import Array
from jax.sharding import Mesh

from jaxpack.learning.parameters import Params
from jaxpack.learning.recipe import TRACED, TrainConfig
from jaxpack.learning.trainer import ChunkMetrics, TrainState, init_state, train_updates
from jaxpack.xla.devices import split_batch
from jaxpack.xla.target import target

T = TypeVar("T")


def each_member(function: Callable[..., T], *members: object) -> T:
    """`function` of every member, leaves [M, ...].

    On a CPU one after the other: its cache holds the lanes of one, and what a member does is to the
    bit what it does alone. Elsewhere side by side.
    """
    if target().cpu:
        return jax.lax.map(lambda member: function(*member), members)
    return jax.vmap(function)(*members)


def alike(configs: Sequence[TrainConfig]) -> tuple[list[TrainConfig], tuple[str, ...]]:
    """What is static of each recipe, the same where one program trains both, and the names of the
    numbers that this program takes: those of TRACED that differ anywhere.
    """
    first = configs[0]
    names = tuple(n for n in TRACED if len({getattr(config, n) for config in configs}) > 1)
    same = {name: getattr(first, name) for name in ("learning_rate", *names)}
    return [replace(config, **same) for config in configs], names


@partial(jax.jit, static_argnames="config")
def init_members(
    config: TrainConfig, seeds: Array, rates: Array, params: Params | None
) -> TrainState:
    """The first states of runs with these seeds, int32 [M], and rates, float32 [M].

    Args:
        params: the weights of all of them, without the axis M; fresh ones if None.
    """

    def init(seed: Array, rate: Array) -> TrainState:
        return init_state(config, jax.random.key(seed), rate, params)

    return each_member(init, seeds, rates)


def _train_members(
    config: TrainConfig,
    states: TrainState,
    numbers: Mapping[str, Array],
    updates: int,
    mesh: Mesh,
) -> tuple[TrainState, ChunkMetrics]:
    def part(states: TrainState, numbers: Mapping[str, Array]) -> tuple[TrainState, ChunkMetrics]:
        update = states.update[0]  # one for all of them, so that side by side they take one branch

        def train(
            state: TrainState, numbers: Mapping[str, Array]
        ) -> tuple[TrainState, ChunkMetrics]:
            return train_updates(config, state._replace(update=update), updates, numbers=numbers)

        return each_member(train, states, numbers)

    trained: tuple[TrainState, ChunkMetrics] = split_batch(mesh, part)(states, numbers)
    return trained


train_members = partial(
    jax.jit, static_argnames=("config", "updates", "mesh"), donate_argnames=("states",)
)(_train_members)
"""`train_updates` of every member (leaves [M, ...], M a multiple of the mesh's devices), compiled.

All have done the same number of updates. `numbers`: float32 [M] by name, see `TrainConfig.traced`.
"""
