"""A training run in its folder: chunk by chunk, logged, checkpointed, resumable to the bit."""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from threading import Event
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jax.sharding import Mesh

from jaxpack.errors import UserError
from jaxpack.io.runs import (
    Checkpoints,
    RunConfig,
    Snapshot,
    append_line,
    best_of_state,
    create_run,
    first_snapshot,
    lock_run,
    read_policy,
    read_run,
    rewind_lines,
    starting_params,
)
from jaxpack.learning.parameters import Params
from jaxpack.learning.recipe import Policy, TrainConfig
from jaxpack.learning.trainer import ChunkMetrics, train_chunk, validation_set
from jaxpack.model.metrics import bins_used, compactness, pyramid
from jaxpack.model.problem import Instance, Packing
from jaxpack.packing.first_fit import pack_decisions
from jaxpack.xla.devices import (
    PART,
    WHOLE,
    anywhere,
    data_mesh,
    is_first,
    pick_devices,
    split_batch,
)

VALIDATION_BATCH = 500  # instances decoded side by side


class DivergedError(RuntimeError):
    """A loss, a gradient or a weight stopped being a number."""


def chunk_length(config: RunConfig) -> int:
    """Updates per dispatch: the largest divisor of an epoch that is no more than asked for."""
    per_epoch = config.train.updates_per_epoch
    return max(n for n in range(1, min(config.chunk, per_epoch) + 1) if per_epoch % n == 0)


def validations(config: RunConfig) -> int:
    """Updates between them. By the update's number alone: a run that was stopped in between
    validates at the same ones.
    """
    length = chunk_length(config)
    return length * math.ceil(config.checkpoint_every / length)


def train_run(
    run: Path,
    config: RunConfig,
    stop: Callable[[], bool] = lambda: False,
    mesh: Mesh | None = None,
) -> Iterator[dict[str, Any]]:
    """Trains in `run` from its newest checkpoint, or from the start, to the end.

    Of several processes all train and checkpoint, and process 0 writes metrics.jsonl.

    Args:
        stop: asked after every chunk; where it says so the run is checkpointed and left.
        mesh: the devices that share every batch, from `data_mesh`; one if not given.

    Yields:
        every record as it is added to metrics.jsonl: of a chunk of updates, or of a validation.

    Raises:
        DivergedError: when a number is not finite; the last checkpoint is from before.
        UserError: where the newest checkpoint is damaged, or the folder cannot be written.
    """
    train, length, mesh = config.train, chunk_length(config), mesh or data_mesh()
    every = validations(config)
    checkpoints: Checkpoints | None = None
    snapshot = None
    if (run / "checkpoints").is_dir():
        checkpoints = Checkpoints(run)
        snapshot = checkpoints.restore(config, mesh)
    state, best = snapshot or first_snapshot(config, mesh, starting_params(config))
    update = saved = int(state.update)
    if is_first():
        rewind_lines(run, update)
    start = time.perf_counter()
    while update < train.updates:
        began = time.perf_counter()
        state, metrics = train_chunk(train, state, length, mesh)
        if metrics.finite != 1:
            raise DivergedError(_diverged(run, update, update + length, saved))
        now = time.perf_counter()
        update += length
        place = {"update": update, "epoch": math.ceil(update / train.updates_per_epoch)}
        speed = {"updates_per_second": length / (now - began), "seconds": now - start}
        yield _log(run, place | figures_of(metrics) | speed)
        stopping, due = anywhere(stop()), update % every == 0 or update == train.updates
        if due:
            means = validate_policy(train, state.kept, state.key, mesh)
            yield _log(run, place | {"validation": means})
            if means["cost"] < best.cost:
                best = best_of_state(state, means["cost"])
        if due or stopping:
            checkpoints = checkpoints or Checkpoints(run)
            checkpoints.save(Snapshot(state, best))
            saved = update
        if stopping:
            break
    if checkpoints:
        checkpoints.close()


def train_policy(
    recipe: TrainConfig,
    run: str | PathLike[str],
    seed: int = 0,
    log: Callable[[dict[str, Any]], object] = lambda record: None,
    chunk: int = 20,
    checkpoint_every: int = 100,
    devices: int = 1,
) -> Policy:
    """Trains a policy in a run folder: a new one, or one of this recipe and seed that goes on.

    Args:
        recipe: what is learned and how, such as `preset` gives.
        run: the folder. Every record is a JSON line of its metrics.jsonl too.
        seed: gives the weights, the data, the shuffles and the samples.
        log: called with every record, a dict of plain numbers: `update`, `epoch` and, after a chunk
            of updates, means of the orders drawn, losses, seconds; after a validation a dict
            `validation` of the greedy policy's means. If it returns something true, the training
            ends with a checkpoint.
        chunk: updates per record, at most.
        checkpoint_every: updates between validations, each with a checkpoint, at least.
        devices: how many share each batch; they have to divide it.

    Returns:
        The policy with the lowest cost on the validation set so far.

    Raises:
        DivergedError: when a number is not finite; the last checkpoint is from before.
        UserError: where the run is of another recipe, is damaged or being trained, or cannot be
            written.
    """
    path = Path(run)
    config = RunConfig("", seed, recipe, chunk, checkpoint_every)
    mesh = data_mesh(pick_devices(devices, recipe.batch))
    if not path.exists():
        create_run(path, config)
    elif replace(read_run(path), preset="") != config:
        raise UserError(f"{path}: exists already and is of another recipe or seed; name another")
    asked = Event()
    with lock_run(path):
        for record in train_run(path, config, asked.is_set, mesh):
            if log(record):
                asked.set()
    return read_policy(path)


def figures_of(metrics: ChunkMetrics) -> dict[str, float]:
    """What a record of metrics.jsonl says of a chunk."""
    outcome = metrics.outcome._asdict() | {"gradient_norm": metrics.gradient_norm}
    return {name: float(value) for name, value in outcome.items()}


def _log(run: Path, record: dict[str, Any]) -> dict[str, Any]:
    if is_first():
        append_line(run, record)
    return record


def validate_policy(
    config: TrainConfig, params: Params, key: Array, mesh: Mesh | None = None
) -> dict[str, float]:
    """Means of the greedy policy on the run's validation set, shared by the devices of `mesh`."""
    means = _validation_means(config, params, key, mesh)
    return {name: float(value) for name, value in means.items()}


def pack_greedily(
    config: TrainConfig, params: Params, instances: Instance
) -> tuple[Instance, Array, Packing, dict[str, Array]]:
    """What the greedy policy makes of instances (leaves [B, ...]): the instances as it turned them,
    the orders int32 [B, N], the packings, and what they are like, [B] each by name.
    """
    decided = config.policy.orders(config.problem, params, instances, kinds=config.kinds)
    instances, packing = pack_decisions(config.problem, instances, decided)
    measures = {
        "cost": jax.vmap(config.cost)(instances, packing),
        "compactness": jax.vmap(compactness)(instances, packing),
        "pyramid": jax.vmap(pyramid)(packing),
        "bins": jax.vmap(bins_used)(packing),
    }
    return instances, decided.order, packing, measures


def validation_means(
    config: TrainConfig, params: Params, key: Array, mesh: Mesh | None = None
) -> dict[str, Array]:
    """`validate_policy` to be traced: float32[] by name."""
    devices = mesh.size if mesh else 1
    batch = min(VALIDATION_BATCH, -(-config.valid_instances // devices))

    def judge(params: Params, key: Array, rows: Array) -> dict[str, Array]:
        instances = validation_set(config, key, jnp.minimum(rows, config.valid_instances - 1))
        return pack_greedily(config, params, instances)[-1]

    pieces = -(-config.valid_instances // (batch * devices)) * devices
    rows = jnp.arange(pieces * batch).reshape(pieces, batch)

    def judge_pieces(params: Params, key: Array, rows: Array) -> dict[str, Array]:
        return jax.lax.map(partial(judge, params, key), rows)

    judged = split_batch(mesh, judge_pieces, (WHOLE, WHOLE, PART))(params, key, rows)
    return {k: v.reshape(-1)[: config.valid_instances].mean() for k, v in judged.items()}


_validation_means = partial(jax.jit, static_argnames=("config", "mesh"))(validation_means)


def _diverged(run: Path, first: int, last: int, saved: int) -> str:
    kept = f"the checkpoint of update {saved} in {run} is kept" if saved else "no checkpoint yet"
    return (
        f"training diverged between updates {first} and {last}: a loss, gradient or weight is not "
        f"a number; {kept}; train again with a lower --learning-rate"
    )
