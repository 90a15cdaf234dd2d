"""Training a sweep: its members as one program, each logged and checkpointed in its run folder."""

import math
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from functools import partial
from itertools import groupby
from operator import itemgetter
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.sharding import Mesh

from jaxpack.io.members import Member
from jaxpack.io.runs import Best, Checkpoints, Snapshot, append_line, rewind_lines, starting_params
from jaxpack.learning.members import alike, each_member, init_members, train_members
from jaxpack.learning.parameters import Params
from jaxpack.learning.recipe import TrainConfig
from jaxpack.learning.trainer import ChunkMetrics, TrainState
from jaxpack.training import (
    DivergedError,
    chunk_length,
    figures_of,
    validation_means,
    validations,
)
from jaxpack.xla.devices import by_batch, data_mesh, split_batch

Records = list[tuple[Member, dict[str, Any]]]
"""What has just been added to the metrics.jsonl of some members."""

PLACE = itemgetter(0, 1)


class Group(NamedTuple):
    """Members that one program trains: recipes alike but for numbers, at the same update."""

    config: TrainConfig  # of all of them, its numbers aside
    update: int
    members: list[Member]
    numbers: dict[str, np.ndarray]  # float32 [M], those of the recipes that differ in the sweep
    snapshots: list[Snapshot | None]  # where each goes on, None: at the start

    @property
    def updates(self) -> int:
        """Those that are left to do."""
        return self.config.updates - self.update


def newest_snapshot(member: Member) -> Snapshot | None:
    """What the newest checkpoint of a member holds, None where there is none.

    Raises:
        UserError: where it is damaged.
    """
    if not (member.run / "checkpoints").is_dir():
        return None
    checkpoints = Checkpoints(member.run, read_only=True)
    snapshot = checkpoints.restore(member.config)
    checkpoints.close()
    return snapshot


def group_members(members: Sequence[Member]) -> list[Group]:
    """The programs that train them, one after the other.

    Members have the same number of updates behind them, unless the sweep was killed while it wrote
    its checkpoints or one was trained by itself: those are groups of their own.
    """
    configs, names = alike([member.config.train for member in members])
    rows = []
    for member, config in zip(members, configs, strict=True):
        snapshot = newest_snapshot(member)
        update = int(snapshot.state.update) if snapshot else 0
        rows.append((configs.index(config), update, member, snapshot if update else None))
    groups = []
    for (first, update), same in groupby(sorted(rows, key=PLACE), PLACE):
        _, _, grouped, snapshots = zip(*same, strict=True)
        trains = [member.config.train for member in grouped]
        numbers = {
            name: np.asarray([getattr(train, name) for train in trains], np.float32)
            for name in names
        }
        groups.append(Group(configs[first], update, list(grouped), numbers, list(snapshots)))
    return groups


def train_sweep(
    groups: Sequence[Group], stop: Callable[[], bool] = lambda: False, devices: int = 1
) -> Iterator[Records]:
    """Trains every member from its newest checkpoint, or from the start, to the end.

    To the bit a member does what `train_run` does with it on one device of a CPU. One whose numbers
    are not finite any more is left as its last checkpoint has it; the others go on.

    Args:
        groups: from `group_members`.
        stop: asked after every chunk; where it says so all are checkpointed and left.
        devices: that share the members.

    Yields:
        the records of all members of a group, as they are added to their metrics.jsonl.

    Raises:
        DivergedError: where no member comes to its end.
        UserError: where a folder cannot be written.
    """
    finished = 0
    for group in groups:
        left = len(group.members)
        if group.updates:
            stopped, left = yield from _train_group(group, stop, devices)
            if stopped:
                return
        finished += left
    if not finished:
        raise DivergedError(
            "every run diverged: a loss, gradient or weight is not a number; train again with a "
            "lower --learning-rate"
        )


def _train_group(
    group: Group, stop: Callable[[], bool], devices: int
) -> Generator[Records, None, tuple[bool, int]]:
    """(whether it was stopped, how many members have not diverged)."""
    config, members = group.config, group.members
    length, every = chunk_length(members[0].config), validations(members[0].config)
    mesh = data_mesh(min(devices, len(members)))
    states, best, numbers = _start(group, mesh)
    for member in members:
        rewind_lines(member.run, group.update)
    checkpoints = [Checkpoints(member.run) for member in members]
    update, start = group.update, time.perf_counter()
    left, stopping = dict(enumerate(members)), False
    while update < config.updates and left:
        began = time.perf_counter()
        states, measured = train_members(config, states, numbers, length, mesh)
        metrics: ChunkMetrics = jax.device_get(measured)
        now = time.perf_counter()
        update += length
        for row in [row for row in left if metrics.finite[row] != 1]:
            del left[row]
        place = {"update": update, "epoch": math.ceil(update / config.updates_per_epoch)}
        speed = {"updates_per_second": length / (now - began), "seconds": now - start}
        figures = {row: figures_of(jax.tree.map(itemgetter(row), metrics)) for row in left}
        yield _log(left, {row: place | figures[row] | speed for row in left})
        stopping, due = stop(), update % every == 0 or update == config.updates
        if due:
            means = _validate(config, states.kept, states.key, numbers, mesh)
            best = _better(best, states, means["cost"])
            values = jax.device_get(means)
            validation = {row: {k: float(v[row]) for k, v in values.items()} for row in left}
            yield _log(left, {row: place | {"validation": validation[row]} for row in left})
        if due or stopping:
            for row in left:
                checkpoints[row].save(_row(Snapshot(states, best), row))
        if stopping:
            break
    for one in checkpoints:
        one.close()
    return stopping, len(left)


def _start(group: Group, mesh: Mesh) -> tuple[TrainState, Best, dict[str, Array]]:
    """What is trained, on its devices: as many rows as these share, the last member repeated."""
    count = len(group.members)
    rows = np.minimum(np.arange(-(-count // mesh.size) * mesh.size), count - 1)
    if group.snapshots[0] is None:
        configs = [member.config for member in group.members]
        seeds = np.asarray([config.seed for config in configs], np.int32)
        rates = np.asarray([config.train.learning_rate for config in configs], np.float32)
        params = starting_params(configs[0])
        states = init_members(group.config, jnp.asarray(seeds), jnp.asarray(rates), params)
        nothing = jnp.full(count, jnp.inf, jnp.float32)
        best = Best(jax.tree.map(jnp.copy, states.kept), nothing, jnp.copy(states.update))
    else:
        snapshots = [snapshot for snapshot in group.snapshots if snapshot]
        states, best = jax.tree.map(lambda *leaves: jnp.stack(leaves), *snapshots)
    numbers = {name: jnp.asarray(number) for name, number in group.numbers.items()}
    every = jax.tree.map(lambda leaf: leaf[rows], (states, best, numbers))
    placed: tuple[TrainState, Best, dict[str, Array]] = jax.device_put(every, by_batch(mesh))
    return placed


@partial(jax.jit, static_argnames=("config", "mesh"))
def _validate(
    config: TrainConfig, params: Params, keys: Array, numbers: dict[str, Array], mesh: Mesh
) -> dict[str, Array]:
    """`validation_means` of every member: float32 [M] by name."""

    def means(params: Params, key: Array, numbers: dict[str, Array]) -> dict[str, Array]:
        return validation_means(config.traced(numbers), params, key)

    found: dict[str, Array] = split_batch(mesh, partial(each_member, means))(params, keys, numbers)
    return found


@jax.jit
def _better(best: Best, states: TrainState, cost: Array) -> Best:
    """The policies with the lower costs, in memory of their own: the states' is donated."""
    found = Best(states.kept, cost, states.update)
    lower = cost < best.cost

    def chosen(new: Array, old: Array) -> Array:
        return jnp.where(lower.reshape(-1, *(1,) * (new.ndim - 1)), new, old)

    return jax.tree.map(chosen, found, best)


def _row(snapshot: Snapshot, row: int) -> Snapshot:
    """That of one member, on one device."""
    one: Snapshot = jax.device_put(jax.tree.map(itemgetter(row), snapshot), jax.devices()[0])
    return one


def _log(members: dict[int, Member], records: dict[int, dict[str, Any]]) -> Records:
    for row, member in members.items():
        append_line(member.run, records[row])
    return [(member, records[row]) for row, member in members.items()]
