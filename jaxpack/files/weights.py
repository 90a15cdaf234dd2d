"""Trained policies as files: NAME.npz with the weights, NAME.json with where they come from.

Both are plain data. Loading never unpickles: nothing in a file is executed.
"""

import json
import os
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
from jaxpack.files.texts import fault, read_json
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
    elif name.endswith(".npz") and os.path.exists(name):  # False for what can be no name
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
    """Whether `params` have the names, shapes and dtypes that `config` gives."""
    return not _differing(config, params)


def check_params(config: TrainConfig, params: Params, where: str) -> Params:
    """`params`, finite and as `fits_recipe` has them; UserError naming `where` if they are not."""
    if names := _differing(config, params):
        raise fault(where, f"its weights do not match its config ({names[0]}); retrain it")
    if not all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(params)):
        raise fault(where, "a weight is not a finite number; retrain it")
    return params


def _differing(config: TrainConfig, params: Params) -> list[str]:
    expected = jax.eval_shape(lambda: init_policy(config.problem, config.policy, jax.random.key(0)))

    def kinds(params: Params) -> dict[str, tuple]:
        flat = traverse_util.flatten_dict(params, sep="/")
        return {name: (leaf.shape, leaf.dtype) for name, leaf in flat.items()}

    wanted, found = kinds(expected), kinds(params)
    return sorted(k for k in wanted.keys() | found.keys() if wanted.get(k) != found.get(k))


def _read(path: Path) -> Policy:
    try:
        record = read_json(path.with_suffix(".json"))
        config = config_from_dict(TrainConfig, record["config"], f"{path.with_suffix('.json')}")
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            flat = {name: archive[name] for name in archive.files}
        params = check_params(config, traverse_util.unflatten_dict(flat, sep="/"), str(path))
    except UserError:
        raise
    except Exception as error:  # of many kinds: those of zipfile, zlib, tokenize, NumPy, ...
        reason = str(error).split("\n")[0][:120] or type(error).__name__
        raise fault(path, f"not a policy, or damaged ({reason}); fetch it again") from error
    return Policy(config, jax.tree.map(jnp.asarray, params))
