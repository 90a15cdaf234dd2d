"""Trained policies as files: NAME.npz with the weights, NAME.json with where they come from.

Both are plain data. Loading never unpickles: nothing in a file is executed.
"""

import json
import zipfile
from importlib import resources
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import traverse_util

from jaxpack.errors import UserError
from jaxpack.files.atomic import replace_file
from jaxpack.files.configs import config_from_dict, config_to_dict
from jaxpack.learning.parameters import Params
from jaxpack.learning.policies import init_policy
from jaxpack.learning.recipe import Policy, TrainConfig


def shipped_policies() -> list[str]:
    """Names of the policies in the package, for `load_policy`."""
    folder = resources.files("jaxpack") / "weights"
    return sorted(
        item.name[: -len(".npz")] for item in folder.iterdir() if item.name.endswith(".npz")
    )


def load_policy(name: str) -> Policy:
    """A policy from the package by name, such as "pointer-2d", or from a file NAME.npz.

    Raises:
        UserError: where there is no such policy, or its files are damaged or foreign.
    """
    if name in shipped_policies():
        path = Path(str(resources.files("jaxpack") / "weights" / f"{name}.npz"))
    elif name.endswith(".npz") and Path(name).exists():
        path = Path(name)
    else:
        raise UserError(
            f"no policy '{name}': choose from {', '.join(shipped_policies())} or name an .npz file"
        )
    return _read(path)


def save_policy(path: Path, policy: Policy, provenance: dict[str, Any]) -> None:
    """Writes `path` (.npz) and, beside it, the recipe and provenance as .json."""
    flat = traverse_util.flatten_dict(policy.params, sep="/")
    arrays = {name: np.asarray(value) for name, value in flat.items()}
    record = provenance | {"config": config_to_dict(policy.config)}
    with replace_file(path, "wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)
    with replace_file(path.with_suffix(".json"), "w") as file:
        file.write(json.dumps(record, indent=2) + "\n")


def fits_recipe(config: TrainConfig, params: Params) -> bool:
    """Whether `params` have the names and shapes that `config` gives."""
    return not _differing(config, params)


def check_params(config: TrainConfig, params: Params, where: str) -> Params:
    """`params` if they have the shapes that `config` gives; UserError naming `where` if not."""
    if names := _differing(config, params):
        raise UserError(f"{where}: its weights do not match its config ({names[0]}); retrain it")
    return params


def _differing(config: TrainConfig, params: Params) -> list[str]:
    expected = jax.eval_shape(lambda: init_policy(config.problem, config.policy, jax.random.key(0)))
    wanted = {k: v.shape for k, v in traverse_util.flatten_dict(expected, sep="/").items()}
    found = {k: np.shape(v) for k, v in traverse_util.flatten_dict(params, sep="/").items()}
    return sorted(k for k in wanted.keys() | found.keys() if wanted.get(k) != found.get(k))


def _read(path: Path) -> Policy:
    try:
        record = json.loads(path.with_suffix(".json").read_text())
        config = config_from_dict(TrainConfig, record["config"])
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            flat = {name: jnp.asarray(archive[name]) for name in archive.files}
    except (OSError, EOFError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        if isinstance(error, UserError):
            raise
        raise UserError(f"{path}: not a policy, or damaged ({error}); fetch it again") from error
    return Policy(
        config, check_params(config, traverse_util.unflatten_dict(flat, sep="/"), str(path))
    )
