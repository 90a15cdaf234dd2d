"""Trained policies as files: NAME.npz with the weights, NAME.json with where they come from.

Both are plain data. Loading never unpickles: nothing in a file is executed.
"""

import json
import os
from importlib import resources
from os import PathLike
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpack.errors import UserError
from jaxpack.io.atomic import replace_file
from jaxpack.io.configs import config_from_dict, config_to_dict
from jaxpack.io.texts import read_json
from jaxpack.learning.parameters import Params
from jaxpack.learning.recipe import Policy, TrainConfig
from jaxpack.model.numbers import fault


def shipped_policies() -> list[str]:
    """Names of the policies in the package, for `load_policy`."""
    folder = resources.files("jaxpack") / "weights"
    return sorted(
        item.name[: -len(".npz")] for item in folder.iterdir() if item.name.endswith(".npz")
    )


def load_policy(name: str) -> Policy:
    """A policy from the package, or from a file.

    Args:
        name: of the package, such as "pointer-2d"; or the path of a file NAME.npz, with NAME.json
            beside it. Nothing in them is executed.

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


def save_policy(path: str | PathLike[str], policy: Policy, provenance: dict[str, Any]) -> None:
    """Writes a policy's weights, and beside them its recipe and where it comes from as .json.

    Args:
        path: of the weights, .npz. Both files are the old ones or the new ones, never half.
        policy: the recipe and the weights.
        provenance: plain data of any kind, such as the seed and the command.

    Raises:
        OSError: where a file cannot be written.
    """
    path = Path(path)
    arrays = {name: np.asarray(value) for name, value in _by_name(policy.params).items()}
    record = provenance | {"config": config_to_dict(policy.config)}
    with replace_file(path, "wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)
    with replace_file(path.with_suffix(".json"), "w") as file:
        file.write(json.dumps(record, indent=2) + "\n")


def fits_recipe(config: TrainConfig, params: Params) -> bool:
    """Whether `params` have the names, shapes and dtypes that `config` gives."""
    return not _differing(_expected(config), _by_name(params))


def _expected(config: TrainConfig) -> Params:
    """The parameters that the config's network has, their shapes for arrays."""
    return jax.eval_shape(lambda: config.policy.init(config.problem, jax.random.key(0)))


def _by_name(params: Params) -> dict[str, Any]:
    """Every array by the keys that lead to it, joined: "encoder/kernel"."""
    leaves = jax.tree_util.tree_leaves_with_path(params)
    return {jax.tree_util.keystr(path, simple=True, separator="/"): leaf for path, leaf in leaves}


def _differing(expected: Params, found: dict[str, Any]) -> list[str]:
    """Names whose arrays are missing, too many or of another kind."""
    wanted = {name: (leaf.shape, leaf.dtype) for name, leaf in _by_name(expected).items()}
    kinds = {name: (leaf.shape, leaf.dtype) for name, leaf in found.items()}
    return sorted(k for k in wanted.keys() | kinds.keys() if wanted.get(k) != kinds.get(k))


def _read(path: Path) -> Policy:
    try:
        record = read_json(path.with_suffix(".json"))
        config = config_from_dict(TrainConfig, record["config"], f"{path.with_suffix('.json')}")
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            flat = {name: archive[name] for name in archive.files}
        expected = _expected(config)
        if names := _differing(expected, flat):
            raise fault(path, f"its weights do not match its config ({names[0]}); retrain it")
        if not all(np.isfinite(leaf).all() for leaf in flat.values()):
            raise fault(path, "a weight is not a finite number; retrain it")
    except UserError:
        raise
    except Exception as error:  # of many kinds: those of zipfile, zlib, tokenize, NumPy, ...
        reason = str(error).split("\n")[0][:120] or type(error).__name__
        raise fault(path, f"not a policy, or damaged ({reason}); fetch it again") from error
    leaves = [jnp.asarray(flat[name]) for name in _by_name(expected)]
    return Policy(config, jax.tree.unflatten(jax.tree.structure(expected), leaves))
