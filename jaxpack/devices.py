"""Several devices as one axis: each has its part of a batch, and the weights are on all."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from jaxpack.errors import UserError

DATA = "data"  # the one axis of a mesh: the leading axis of a batch is cut along it
PART, WHOLE = P(DATA), P()  # of an array: each device has a part, or all have all of it


def data_mesh(devices: int = 1) -> Mesh:
    """The first `devices` devices of this process."""
    return Mesh(np.array(jax.local_devices()[:devices]), (DATA,))


def pick_devices(asked: int | None, batch: int) -> int:
    """How many devices share a batch: as many as asked for, else the most that divide it.

    Raises:
        UserError: where there are not so many, or the batch cannot be cut into equal parts.
    """
    there = len(jax.local_devices())
    if asked is None:
        return max(n for n in range(1, there + 1) if batch % n == 0)
    if not 1 <= asked <= there:
        raise UserError(f"--devices {asked}: there are {there}; ask for 1 to {there}")
    if batch % asked:
        raise UserError(
            f"--devices {asked}: a batch of {batch} cannot be cut into {asked} equal parts; change "
            "--devices or --batch"
        )
    return asked


def on_all(mesh: Mesh) -> NamedSharding:
    """The same array on every device."""
    return NamedSharding(mesh, WHOLE)


def by_batch(mesh: Mesh) -> NamedSharding:
    """A part of the leading axis on every device."""
    return NamedSharding(mesh, PART)


def split_batch(
    mesh: Mesh | None, function: Callable, in_specs: Any = PART, out_specs: Any = PART
) -> Callable:
    """`function` of batches, each device doing its own part. Without a mesh: `function` itself.

    Args:
        function: args (leaves [B, ...]) -> leaves [B, ...]; member i of the output depends on
            member i of the input only.
        in_specs, out_specs: WHOLE where an argument or a leaf is no batch.
    """
    if mesh is None:
        return function
    # Unchecked: the kernels' loops start from constants, which the check takes for shared.
    return jax.shard_map(
        function, mesh=mesh, in_specs=in_specs, out_specs=out_specs, check_vma=False
    )


def mean_over_batch(mesh: Mesh | None, function: Callable, in_specs: Any) -> Callable:
    """The same for a `function` whose output is a mean over its batch."""
    if mesh is None:
        return function

    def mean(*batch: Any) -> Any:
        return jax.lax.pmean(function(*batch), DATA)

    return split_batch(mesh, mean, in_specs, out_specs=WHOLE)
