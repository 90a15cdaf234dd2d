"""Run folders: everything a training run leaves behind, and what it needs to go on.

    RUN/config.json      the recipe, the seed, the preset's name
    RUN/.lock            held by who trains
    RUN/metrics.jsonl    a line per chunk of updates and per validation
    RUN/checkpoints/N/   the state after N updates and the best policy so far (orbax)
    RUN/table.json, table.txt, packing.png   the end of the run

A folder appears with its config in it or not at all; a checkpoint likewise. Killed at any
moment, or out of disk, a run loses what it did since its last checkpoint and nothing else.
"""

import json
import os
import re
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.sharding import Mesh
from jax.typing import ArrayLike

from jaxpack.errors import MOST, UserError, check_counts
from jaxpack.io.atomic import new_folder, replace_file
from jaxpack.io.configs import config_from_dict, config_to_dict
from jaxpack.io.locks import held
from jaxpack.io.texts import read_json
from jaxpack.io.weights import fits_recipe, load_policy
from jaxpack.learning.parameters import Params
from jaxpack.learning.recipe import Policy, TrainConfig
from jaxpack.learning.trainer import TrainState, init_state
from jaxpack.model.numbers import fault
from jaxpack.xla.devices import data_mesh, on_all


@dataclass(frozen=True)
class RunConfig:
    """What a run folder's config.json holds."""

    preset: str
    seed: int
    train: TrainConfig
    chunk: int = 50  # updates per dispatch and per line of metrics.jsonl, at most
    checkpoint_every: int = 500  # updates between validations and checkpoints, at least
    start_from: str = ""  # the policy whose weights it begins with, or none: fresh ones

    def __post_init__(self) -> None:
        check_counts(self, "seed", least=-MOST - 1)
        check_counts(self, "chunk", "checkpoint_every")


class Best(NamedTuple):
    """The policy with the lowest cost on the validation set so far: the one a run ends with."""

    params: Params
    cost: Array  # float32[], mean objective of the greedy orders; inf before the first validation
    update: Array  # int32[], updates it had


class Snapshot(NamedTuple):
    """What a checkpoint holds."""

    state: TrainState
    best: Best


def starting_params(config: RunConfig) -> Params | None:
    """The weights that a run begins with, None for fresh ones.

    Raises:
        UserError: where there is no such policy, or its network is another.
    """
    if not config.start_from:
        return None
    policy = load_policy(config.start_from)
    if not fits_recipe(config.train, policy.params):
        raise UserError(
            f"--start-from {config.start_from}: its network is not the one to train; choose a "
            "policy of the same kind and width"
        )
    return config.train.policy.adopt(policy.config.policy, policy.params)


def first_snapshot(
    config: RunConfig, mesh: Mesh | None = None, params: Params | None = None
) -> Snapshot:
    """Where a run begins, on all devices of `mesh`; on one if not given.

    Args:
        params: from `starting_params`.
    """

    def init(seed: ArrayLike, params: Params | None) -> TrainState:
        return init_state(config.train, jax.random.key(seed), params=params)

    state = jax.jit(init, out_shardings=on_all(mesh or data_mesh()))(config.seed, params)
    return Snapshot(state, best_of_state(state, jnp.inf))


@jax.jit
def best_of_state(state: TrainState, cost: ArrayLike) -> Best:
    """The state's policy as the best one, in memory of its own: the state's is donated."""
    params = jax.tree.map(jnp.copy, state.kept)
    return Best(params, jnp.float32(cost), jnp.copy(state.update))


def create_run(path: Path, config: RunConfig) -> None:
    """Makes the run folder with its config. Raises UserError where it exists or cannot be made."""
    with new_folder(path) as folder:
        (folder / "config.json").write_text(json.dumps(config_to_dict(config), indent=2) + "\n")


def read_run(path: Path) -> RunConfig:
    """The config of a run folder. Raises UserError where it is missing, foreign or damaged."""
    if not path.is_dir():
        raise UserError(f"{path}: no such run folder; `python -m jaxpack.train` makes one")
    file = path / "config.json"
    if not file.is_file():
        raise UserError(
            f"{path}: not a run folder, it has no config.json; name one that train made"
        )
    return config_from_dict(RunConfig, read_json(file), str(file))


@contextmanager
def lock_run(run: Path) -> Iterator[None]:
    """Keeps every other process from training in `run` meanwhile.

    Raises:
        UserError: where another process has it, or the folder may not be written.
    """
    file = run / ".lock"
    in_use = f"{run}: another process is training this run; wait for its end or stop it first"
    with ExitStack() as stack:
        try:
            stack.enter_context(held(file, in_use))
        except OSError as error:
            raise _unwritable(run, file, str(error.strerror)) from error
        yield


def _unwritable(run: Path, path: Path, reason: str) -> UserError:
    return UserError(
        f"{path}: cannot be written ({reason}); make room or allow it, then go on with --resume "
        f"{run}: what its last checkpoint holds is kept"
    )


class Checkpoints:
    """The checkpoints of a run folder, the newest two, written synchronously by orbax.

    Args:
        read_only: touch nothing, for a run that another process may be training.

    Raises:
        UserError: where the folder for them cannot be made.
    """

    def __init__(self, run: Path, read_only: bool = False) -> None:
        # Imported here: it takes a quarter of a second that the first update need not wait for.
        import orbax.checkpoint as ocp

        self._orbax = ocp
        self._run = run
        options = ocp.CheckpointManagerOptions(
            max_to_keep=None if read_only else 2,
            enable_async_checkpointing=False,
            cleanup_tmp_directories=not read_only,
            create=not read_only,
            read_only=read_only,
        )
        folder = (run / "checkpoints").resolve()
        try:
            self._manager = ocp.CheckpointManager(
                folder, options=options, item_handlers=ocp.StandardCheckpointHandler()
            )
        except OSError as error:
            raise _unwritable(run, folder, str(error.strerror)) from error

    def save(self, snapshot: Snapshot) -> None:
        """Writes a snapshot; the folder of a checkpoint appears when it is complete.

        Raises:
            UserError: where it cannot be written; the checkpoints before it stay.
        """
        step = int(snapshot.state.update)
        arguments = self._orbax.args.StandardSave(_key_as_data(snapshot))
        try:
            self._manager.save(step, args=arguments)
        except Exception as error:
            where = self._run / "checkpoints" / str(step)
            raise _unwritable(self._run, where, _reason(error)) from error

    def restore(self, config: RunConfig, mesh: Mesh | None = None) -> Snapshot | None:
        """The newest snapshot, on all devices of `mesh`; None where there is no checkpoint yet.

        Raises:
            UserError: where the newest checkpoint cannot be read.
        """
        latest = self._manager.latest_step()
        if latest is None:
            return None
        shapes = jax.eval_shape(lambda: _key_as_data(first_snapshot(config)))
        everywhere = on_all(mesh or data_mesh())
        wanted = jax.tree.map(
            lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype, sharding=everywhere), shapes
        )
        where = self._run / "checkpoints" / str(latest)
        plain, reason = self._read(latest, wanted)
        if plain is None:
            raise UserError(
                f"{where}: damaged checkpoint ({reason}); delete that folder to go back to the one "
                "before it"
            )
        state = plain.state._replace(key=jax.random.wrap_key_data(plain.state.key))
        return Snapshot(state, plain.best)

    def _read(self, step: int, wanted: Snapshot) -> tuple[Snapshot | None, str]:
        """(snapshot, "") or (None, what was wrong)."""
        arguments = self._orbax.args.StandardRestore(wanted)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                # Read only what has the right shape: a restore that fails half-way leaves
                # coroutines that complain on the user's screen when they are collected.
                if _shapes(self._manager.item_metadata(step).tree) != _shapes(wanted):
                    return None, "made with another config"
                return self._manager.restore(step, args=arguments), ""
            except Exception as error:
                return None, _reason(error)

    def close(self) -> None:
        """Releases what orbax holds."""
        self._manager.close()


def _reason(error: Exception) -> str:
    """What orbax raised in few words: it is of many kinds, none of them its own."""
    if found := re.search(r"\[Errno (\d+)\]|os_error_code='(\d+)'|OS error (\d+)", str(error)):
        return os.strerror(int(found[found.lastindex or 0]))
    return str(error).split("\n")[0].strip()[:120] or type(error).__name__


def _shapes(tree: Any) -> dict[str, tuple[int, ...]]:
    """Shape of every leaf by its path, alike for named tuples and for what orbax makes of them."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(tree)
    name = partial(jax.tree_util.keystr, simple=True, separator="/")
    return {name(path): tuple(leaf.shape) for path, leaf in leaves}


def _key_as_data(snapshot: Snapshot) -> Snapshot:
    """The snapshot with its typed key as plain numbers, which orbax can write."""
    state = snapshot.state
    return snapshot._replace(state=state._replace(key=jax.random.key_data(state.key)))


def read_policy(run: Path) -> Policy:
    """The best policy of a run folder so far.

    Raises:
        UserError: where the folder is missing, foreign, damaged or has no checkpoint yet.
    """
    config = read_run(run)
    if not (run / "checkpoints").is_dir():
        raise UserError(f"{run}: has no checkpoint yet; go on with --resume {run}")
    checkpoints = Checkpoints(run, read_only=True)
    snapshot = checkpoints.restore(config)
    checkpoints.close()
    if snapshot is None:
        raise UserError(f"{run}: has no checkpoint yet; go on with --resume {run}")
    return Policy(config.train, snapshot.best.params)


def append_line(run: Path, record: dict[str, Any]) -> None:
    """Adds one JSON line to metrics.jsonl, on the disk before any checkpoint that follows it.

    Raises:
        UserError: where it cannot be written.
    """
    try:
        with open(run / "metrics.jsonl", "a") as file:
            file.write(json.dumps(record) + "\n")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise _unwritable(run, run / "metrics.jsonl", str(error.strerror)) from error


def read_lines(run: Path) -> list[dict[str, Any]]:
    """The whole lines of metrics.jsonl; a last one that a kill cut short is left out.

    Raises:
        UserError: naming the first line that is no record, or where the file cannot be read.
    """
    file = run / "metrics.jsonl"
    if not file.exists():
        return []
    try:
        lines = file.read_bytes().split(b"\n")[:-1]
    except OSError as error:
        raise fault(file, f"cannot be read ({error.strerror}); allow it") from error
    records = []
    for row, line in enumerate(lines, 1):
        try:
            record = json.loads(line)
            if type(record["update"]) is not int:
                raise TypeError("'update' is no whole number")
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            raise fault(file, f"row {row}", "not a record of a run; delete that line") from error
        records.append(record)
    return records


def rewind_lines(run: Path, update: int) -> None:
    """Drops the lines of metrics.jsonl after `update`: the resumed run writes them again."""
    kept = [record for record in read_lines(run) if record["update"] <= update]
    with replace_file(run / "metrics.jsonl") as file:
        file.writelines(json.dumps(record) + "\n" for record in kept)
