"""Does this device pack right? A tiny packing beside one in NumPy, where nobody has tried before.

A compiler for an accelerator has been wrong here once: on one GPU the highest point of a bin came
out wrong in bins of more than 126 cells. A wrong figure is worse than none.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from jaxpack.errors import UserError
from jaxpack.model.problem import Instance, Packing, Problem
from jaxpack.packing.first_fit import pack
from jaxpack.xla.target import device_name, target

Packer = Callable[[Problem, Instance, np.ndarray], Packing]
"""`pack` over a batch."""

PROBLEMS = (
    Problem((14, 1, 12), (7, 1)),  # int8, 168 cells
    Problem((11, 11, 9), (5, 5), inclusive=False),  # int8, the largest plane but one
    Problem((12, 12, 10), (6, 6)),  # int16 for the plane
)
COUNT, ITEMS = 16, 14


def check_device(packer: Packer | None = None) -> None:
    """Packs a few items on the default device, unless that is a CPU, and compares.

    Args:
        packer: what is checked, whatever the device; `pack` if not given.

    Raises:
        UserError: naming the device where a placement or a figure is not that of NumPy.
    """
    if packer is None:
        if target().cpu:
            return
        packer = _pack
    for number, problem in enumerate(PROBLEMS):
        instances, orders = _cases(problem, number)
        found = jax.tree.map(np.asarray, packer(problem, instances, orders))
        cases = zip(*map(np.asarray, instances[:3]), orders, strict=True)
        expected = zip(*(_by_numpy(problem, *case) for case in cases), strict=True)
        for name, ours, theirs in zip(Packing._fields, found, expected, strict=True):
            if not np.array_equal(ours, np.stack(theirs)):
                raise UserError(
                    f"{device_name()}: packs wrong, '{name}' of a bin "
                    f"{problem.bin} is not what NumPy gives; use another version of jax or of the "
                    "driver, or a CPU: JAX_PLATFORMS=cpu"
                )


def _pack(problem: Problem, instances: Instance, orders: np.ndarray) -> Packing:
    packed: Packing = jax.jit(jax.vmap(lambda one, order: pack(problem, one, order)))(
        instances, orders
    )
    return packed


def _cases(problem: Problem, seed: int) -> tuple[Instance, np.ndarray]:
    """(instances, orders) [COUNT, ...]: half of the bins are smaller, some items are padding."""
    rng, bin = np.random.default_rng(seed), np.array(problem.bin)
    largest = np.array([*problem.window, bin[2] // 2])
    size = rng.integers(1, largest + 1, (COUNT, ITEMS, 3))
    bins = np.where(np.arange(COUNT)[:, None] % 2, bin, np.maximum(largest, bin - 1))
    orders = rng.permuted(np.tile(np.arange(ITEMS), (COUNT, 1)), axis=1)
    mask = rng.random((COUNT, ITEMS)) < 0.9
    sizes, rooms = jnp.asarray(size, jnp.int32), jnp.asarray(bins, jnp.int32)
    return Instance(sizes, jnp.asarray(mask), rooms), orders.astype(np.int32)


def _by_numpy(
    problem: Problem, size: np.ndarray, mask: np.ndarray, bin: np.ndarray, order: np.ndarray
) -> tuple[np.ndarray, ...]:
    """The fields of a Packing. First fit over all bins at once, position by position: one instance,
    every item fits.
    """
    count = len(order)
    maps = np.zeros((count, bin[0], bin[1]), int)
    found, position = np.full(count, -1), np.zeros((count, 3), int)
    volume, top = np.zeros(count, int), np.zeros(count, int)
    for item in order[mask[order]]:
        length, width, height = size[item]
        under = np.lib.stride_tricks.sliding_window_view(maps, (length, width), (1, 2))
        z = under.max((3, 4))
        resting = (under == z[..., None, None]).sum((3, 4))
        needed = problem.support * length * width
        stable = resting >= needed if problem.inclusive else resting > needed
        slots, xs, ys = np.nonzero(stable & (z + height <= bin[2]))
        slot, z_least, y, x = min(zip(slots, z[slots, xs, ys], ys, xs, strict=True))
        maps[slot, x : x + length, y : y + width] = z_least + height
        found[item], position[item] = slot, (x, y, z_least)
        volume[slot] += length * width * height
        top[slot] = max(top[slot], z_least + height)
    return found, position, volume, top, maps.sum((1, 2))
