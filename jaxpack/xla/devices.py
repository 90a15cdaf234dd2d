"""Several devices as one axis: each has its part of a batch, and the weights are on all.

They may belong to several processes, on several machines: each runs the same program.
"""

import contextlib
import math
import os
import re
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from jaxpack.errors import UserError
from jaxpack.xla.environment import usable_cores

DATA = "data"  # the one axis of a mesh: the leading axis of a batch is cut along it
PART, WHOLE = P(DATA), P()  # of an array: each device has a part, or all have all of it


def use_all_cores() -> None:
    """Makes every core of a CPU a device, unless JAX was told otherwise. Before any array.

    What XLA runs of a packing is loops, and of a loop it uses one core: two devices train nearly
    twice as fast as one on two cores. One of several processes keeps to one device: when another
    is lost, a process of several devices does not fail but waits until JAX ends it, without a word.
    """
    told = "xla_force_host_platform_device_count" in os.environ.get("XLA_FLAGS", "")
    told = told or "JAX_NUM_CPU_DEVICES" in os.environ or jax.distributed.is_initialized()
    if told:
        return
    with contextlib.suppress(RuntimeError):  # too late: somebody has used an array
        jax.config.update("jax_num_cpu_devices", usable_cores())


def join_processes(
    coordinator: str | None, process_id: int | None, num_processes: int | None
) -> None:
    """Makes this process one of several; under SLURM also without being told. Before any array.

    Args:
        coordinator: HOST:PORT, where process 0 is.

    Raises:
        UserError: where the three do not go together, or the coordinator cannot be reached.
    """
    if coordinator is None and process_id is None and num_processes is None:
        # A step of several tasks: its variables are those that JAX reads.
        if "SLURM_STEP_NODELIST" in os.environ and int(os.environ.get("SLURM_NTASKS", 1)) > 1:
            jax.distributed.initialize()
        return
    if coordinator is None or process_id is None or num_processes is None:
        raise UserError("--coordinator, --process-id and --num-processes: give all three or none")
    if not re.fullmatch(r"\S+:\d+", coordinator):
        raise UserError(f"--coordinator '{coordinator}': give HOST:PORT, such as 10.0.0.1:1234")
    if not 0 <= process_id < num_processes:
        raise UserError(
            f"--process-id {process_id}: of {num_processes} processes the first is 0, the last is "
            f"{num_processes - 1}"
        )
    try:
        jax.distributed.initialize(coordinator, num_processes, process_id)
    except RuntimeError as error:
        reason = str(error).split("\n")[0]
        raise UserError(
            f"--coordinator {coordinator}: the processes did not meet ({reason}); start all of them"
        ) from error


def is_first() -> bool:
    """Whether this is process 0, the one that prints and writes."""
    return jax.process_index() == 0


def anywhere(flag: bool) -> bool:
    """Whether `flag` is set in any of the processes; they wait for each other."""
    return bool(np.any(multihost_utils.process_allgather(np.array(flag))))


def on_first(action: Callable[[], Any]) -> None:
    """Does something in process 0 while the others wait; if it fails there it fails in all.

    Raises:
        UserError: the action's own, or in another process one that points to it.
    """
    failed = None
    if is_first():
        try:
            action()
        except UserError as error:
            failed = error
    if anywhere(failed is not None):
        raise failed or UserError("process 0 cannot begin; see what it says")


def data_mesh(devices: int = 1, everywhere: bool = False) -> Mesh:
    """The first `devices` devices of this process, or of each one, in the order of processes."""
    processes = range(jax.process_count()) if everywhere else [jax.process_index()]
    chosen = [jax.local_devices(process_index=process)[:devices] for process in processes]
    return Mesh(np.concatenate(chosen), (DATA,))


def pick_devices(asked: int | None, batch: int | None, processes: int = 1) -> int:
    """How many of its devices a process gives: as many as asked for, else the most that fit.

    Args:
        batch: what they are to have equal parts of; None where parts need not be equal.

    Raises:
        UserError: where there are not so many, or the batch cannot be cut into equal parts.
    """
    there = len(jax.local_devices())
    batch = math.lcm(*range(1, there + 1)) * processes if batch is None else batch
    if asked is None:
        asked = max((n for n in range(1, there + 1) if batch % (n * processes) == 0), default=1)
    if not 1 <= asked <= there:
        raise UserError(f"--devices {asked}: there are {there}; ask for 1 to {there}")
    if batch % (asked * processes):
        raise UserError(
            f"--devices {asked}: a batch of {batch} cannot be cut into {asked * processes} equal "
            "parts; change --devices or --batch"
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


def share_out(mesh: Mesh | None, function: Callable, batch: Array) -> Array:
    """`function(batch)` within `split_batch` where all devices have the whole batch: each does a
    part, and all get everything. Without a mesh: `function` itself.

    Args:
        function: [B, ...] -> [B, ...]; member i of the output depends on member i only.
    """
    if mesh is None:
        return jnp.asarray(function(batch))
    count = len(batch)
    part = -(-count // mesh.size)
    rows = jax.lax.axis_index(DATA) * part + jnp.arange(part)
    done = function(batch[jnp.minimum(rows, count - 1)])
    return jnp.asarray(jax.lax.all_gather(done, DATA, tiled=True)[:count])


def mean_over_batch(mesh: Mesh | None, function: Callable, in_specs: Any) -> Callable:
    """The same for a `function` whose output is a mean over its batch."""
    if mesh is None:
        return function

    def mean(*batch: Any) -> Any:
        return jax.lax.pmean(function(*batch), DATA)

    return split_batch(mesh, mean, in_specs, out_specs=WHOLE)
