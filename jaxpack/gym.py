"""The environment as those of gymnasium, one and many at once (the extra `gym`).

    env = gymnasium.make("jaxpack.gym:jaxpack/Packing-v0", preset="bin-aware-2d")
    envs = gymnasium.make_vec("jaxpack.gym:jaxpack/Packing-v0", num_envs=256)

An action is a row of the observation, a kind of items in an orientation, which goes to the place
that the position rule gives it. A bin costs 1 when its first item is placed, so that the return is
minus the number of bins. An action that the mask does not allow ends the episode, and what is left
then costs a bin an item: it never pays.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium import spaces
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from jax import Array

from jaxpack.errors import UserError, check_counts
from jaxpack.learning.presets import DEFAULT_PRESET
from jaxpack.learning.presets import preset as named
from jaxpack.model.instances import Source
from jaxpack.model.problem import Problem
from jaxpack.packing.env import State, observe, reset, step
from jaxpack.packing.table import Table

SEEDS = 2**31 - 1


class World(NamedTuple):
    """What is packed: static, and the same in every episode."""

    problem: Problem
    source: Source

    @property
    def view(self) -> Table:
        """What a bin is."""
        return Table(self.problem)


class Turn(NamedTuple):
    """What came of an action, in NumPy or JAX."""

    seen: dict[str, Array]  # [B, ...] each, see `PackingEnv`
    reward: Array  # float32 [B]
    terminated: Array  # bool [B]


def make_world(preset: str, problem: Problem | None, distribution: Source | None) -> World:
    """Raises UserError where there is no such preset, or they do not go together."""
    recipe = named(preset)
    problem, source = problem or recipe.problem, distribution or recipe.distribution
    source.check_fits(problem.bin)
    if (problem.surface, source.surface, problem.rule) != ("cells", "cells", "lowest"):
        raise UserError("problem: give one of cells whose rule is lowest")
    return World(problem.resized(problem.bin, source.high), source)


@partial(jax.jit, static_argnames="world")
def begin(world: World, seeds: Array) -> tuple[State, dict[str, Array]]:
    """The start of episodes with these seeds, int32 [B], and what is seen of it."""
    state = _fresh(world, seeds)
    return state, _seen(world, state)


@partial(jax.jit, static_argnames="world")
def play(
    world: World, state: State, actions: Array, over: Array, seeds: Array
) -> tuple[State, Turn]:
    """An action in each episode; where one is over, bool [B], the next one begins instead."""
    empty = state.used == 0
    after = step(world.view, state, state.kinds.choice(actions))
    placed = (after.remaining != state.remaining).any(0)
    left = jnp.round((after.remaining * after.kinds.share).sum(0))
    reward = jnp.where(placed, -1.0 * empty, -left)
    after = jax.lax.cond(
        over.any(),
        lambda: jax.tree.map(partial(jnp.where, over), _fresh(world, seeds), after),
        lambda: after,
    )
    terminated = ~over & (~placed | ~(after.remaining > 0).any(0))
    return after, Turn(_seen(world, after), jnp.where(over, 0, reward), terminated)


def _fresh(world: World, seeds: Array) -> State:
    keys = jax.vmap(jax.random.key)(seeds)
    instances = jax.vmap(partial(world.source.draw, world.problem))(keys)
    last = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), instances)
    return reset(world.view, last, world.source.kinds(world.problem))


def _seen(world: World, state: State) -> dict[str, Array]:
    L, W, _ = world.problem.bin
    choices, here = observe(world.view, state), state.remaining > 0
    sizes = [jnp.where(here, side, 0) for side in state.kinds.sides]
    corners = [jnp.where(choices.allowed, side, 0) for side in choices.candidates.corner]
    seen = {
        "sizes": jnp.stack(sizes, -1),
        "remaining": state.remaining,
        "corners": jnp.stack(corners, -1),
        "mask": choices.allowed,
        "heights": state.inside.heights[:L, :W],
    }
    lane = {"sizes": 1, "remaining": 1, "corners": 1, "mask": 1, "heights": 2}
    dtypes = {name: jnp.int8 if name == "mask" else jnp.int32 for name in seen}
    return {n: jnp.moveaxis(leaf, lane[n], 0).astype(dtypes[n]) for n, leaf in seen.items()}


def observation_space(world: World) -> spaces.Dict:
    """What is seen of one episode."""
    seeds = jax.ShapeDtypeStruct((1,), jnp.int32)
    _, seen = jax.eval_shape(partial(begin, world), seeds)
    side = max(world.problem.bin)
    most = {"sizes": side, "remaining": world.source.items, "corners": side, "mask": 1}
    return spaces.Dict(
        {
            name: spaces.Box(0, most.get(name, side), leaf.shape[1:], np.dtype(leaf.dtype).type)
            for name, leaf in seen.items()
        }
    )


class PackingEnv(gymnasium.Env):
    """One order at a time, item by item: see `jaxpack.gym` for actions and rewards.

    An observation is a dict. Its K rows are the kinds of items in each of their orientations:
    `sizes` int32 [K, 3], sides in cells; `remaining` int32 [K], how many are left; `corners` int32
    [K, 3], where one would be placed; `mask` int8 [K], whether it may be, which `info` has too. And
    `heights` int32 [L, W]: the height map of the current bin. Rows of which nothing is left, and
    corners where nothing may be placed, are 0.

    Args:
        preset: the problem and the distribution of items, see `jaxpack.preset`.
        problem: instead of the preset's; of cells.
        distribution: of the items, instead of the preset's.

    Raises:
        UserError: where there is no such preset, or they do not go together.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        preset: str = DEFAULT_PRESET,
        problem: Problem | None = None,
        distribution: Source | None = None,
    ) -> None:
        self._world = make_world(preset, problem, distribution)
        self.observation_space = observation_space(self._world)
        self.action_space = spaces.Discrete(spaces.flatdim(self.observation_space["mask"]))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """See `gymnasium.Env.reset`; there are no options."""
        super().reset(seed=seed)
        seeds = np.asarray([self.np_random.integers(SEEDS)], np.int32)
        self._state, seen = begin(self._world, seeds)
        return _one(seen)

    def step(self, action: int) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """See `gymnasium.Env.step`."""
        goes_on = np.zeros(1, bool), np.zeros(1, np.int32)
        actions = np.asarray([action], np.int32)
        self._state, turn = play(self._world, self._state, actions, *goes_on)
        seen, info = _one(turn.seen)
        return seen, float(turn.reward[0]), bool(turn.terminated[0]), False, info


class PackingVectorEnv(VectorEnv):
    """Many `PackingEnv`s as one program; to the bit they do what each does alone.

    An episode that has ended begins anew with the next step, whose action counts for nothing
    (`AutoresetMode.NEXT_STEP`).

    Args:
        num_envs: B, how many.
        preset: see `PackingEnv`.
        problem: likewise.
        distribution: likewise.

    Raises:
        UserError: where there is no such preset, or they do not go together.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": [],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        preset: str = DEFAULT_PRESET,
        problem: Problem | None = None,
        distribution: Source | None = None,
    ) -> None:
        self.num_envs = num_envs
        check_counts(self, "num_envs")
        self._world = make_world(preset, problem, distribution)
        self.single_observation_space = observation_space(self._world)
        rows = spaces.flatdim(self.single_observation_space["mask"])
        self.single_action_space = spaces.Discrete(rows)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._streams = [np_random()[0] for _ in range(num_envs)]

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """See `gymnasium.vector.VectorEnv.reset`; there are no options.

        Args:
            seed: of the first, the next one's is one more; or a list, None for as it is.
        """
        super().reset(seed=seed if isinstance(seed, int) else None)
        if isinstance(seed, int):
            seed = range(seed, seed + self.num_envs)
        for lane, own in enumerate(seed or ()):
            if own is not None:
                self._streams[lane], _ = np_random(own)
        self._over = np.ones(self.num_envs, bool)
        self._state, seen = begin(self._world, self._seeds())
        self._over = np.zeros(self.num_envs, bool)
        return self._told(seen)

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """See `gymnasium.vector.VectorEnv.step`."""
        actions = np.asarray(actions, np.int32)
        self._state, turn = play(self._world, self._state, actions, self._over, self._seeds())
        self._over = np.array(turn.terminated)
        seen, info = self._told(turn.seen)
        truncated = np.zeros(self.num_envs, bool)
        return seen, np.array(turn.reward, np.float64), self._over.copy(), truncated, info

    def _seeds(self) -> np.ndarray:
        """Of the next episodes, where one is over: int32 [B]."""
        seeds = np.zeros(self.num_envs, np.int32)
        for lane in np.flatnonzero(self._over):
            seeds[lane] = self._streams[lane].integers(SEEDS)
        return seeds

    def _told(self, seen: dict[str, Array]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        info = {"mask": np.array(seen["mask"]), "_mask": np.ones(self.num_envs, bool)}
        return {name: np.array(leaf) for name, leaf in seen.items()}, info


def _one(seen: dict[str, Array]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """(observation, info) of the only one."""
    first = {name: np.array(leaf[0]) for name, leaf in seen.items()}
    return first, {"mask": first["mask"].copy()}


gymnasium.register(
    "jaxpack/Packing-v0",
    entry_point="jaxpack.gym:PackingEnv",
    vector_entry_point="jaxpack.gym:PackingVectorEnv",
)
