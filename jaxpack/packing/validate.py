"""Is a packing possible? An independent check in NumPy that shares no code with the kernel.

It knows no height map: it compares the items of a bin pair by pair, as boxes. Reachable means
that an item can be lowered straight onto its place when its turn in the order comes: no item
that was packed earlier, and stands over the same cells, reaches higher than where it rests.
"""

from collections.abc import Iterator
from itertools import islice

import numpy as np
from jax.typing import ArrayLike

from jaxpack.packing.problem import Instance, Packing, Problem

CHUNK = 256  # instances compared at a time: bounds the memory of the [B, N, N] tables


class InvalidPackingError(AssertionError):
    """A packing broke a rule: a bug in what made it, never the user's mistake."""


def check_packings(
    problem: Problem, instances: Instance, orders: ArrayLike, packings: Packing, label: str = ""
) -> None:
    """Raises InvalidPackingError naming the first violations, if there are any."""
    found = list(islice(violations(problem, instances, orders, packings), 5))
    if found:
        raise InvalidPackingError(f"{label} packed against the rules: " + "; ".join(found))


def violations(
    problem: Problem, instances: Instance, orders: ArrayLike, packings: Packing
) -> Iterator[str]:
    """Every broken rule of a batch of packings, one line each; nothing if all are valid.

    Args:
        problem: the rules; of it only `support` and `inclusive` are read.
        instances: leaves [B, ...], or of one instance without B.
        orders: int [B, N], the order in which the items were packed.
        packings: leaves [B, ...]; only `bin` and `position` are read.
    """
    single = np.ndim(orders) == 1
    arrays = [instances.size, instances.mask, instances.bin, orders, packings.bin]
    size, mask, room, order, bins, corner = (
        np.asarray(leaf)[None] if single else np.asarray(leaf)
        for leaf in (*arrays, packings.position)
    )
    for first in range(0, len(order), CHUNK):
        part = slice(first, first + CHUNK)
        for name, broken in _broken_rules(
            problem, size[part], mask[part], room[part], order[part], bins[part], corner[part]
        ):
            for instance, *item in np.argwhere(broken):
                place = f"instance {first + instance}" + "".join(f" item {i}" for i in item)
                yield f"{place}: {name}"


def _broken_rules(
    problem: Problem,
    size: np.ndarray,
    mask: np.ndarray,
    room: np.ndarray,
    order: np.ndarray,
    bins: np.ndarray,
    corner: np.ndarray,
) -> Iterator[tuple[str, np.ndarray]]:
    """(rule, where it is broken): bool [B] or [B, N]."""
    items = size.shape[1]
    is_order = np.sort(order, axis=1) == np.arange(items)
    yield "the order is not a permutation of the items", ~is_order.all(1)
    yield "not packed", mask & (bins < 0)
    yield "padding was packed", ~mask & (bins >= 0)
    yield "bin number out of range", bins >= items
    numbers = np.arange(items)
    used = ((bins[:, :, None] == numbers) & mask[:, :, None]).any(1)
    yield "bins are not numbered from 0 without gaps", (used[:, 1:] & ~used[:, :-1]).any(1)

    packed = mask & (bins >= 0)
    far = corner + size
    outside = (corner < 0).any(2) | (far > room[:, None]).any(2)
    yield "outside the bin", packed & outside

    turn = np.argsort(order, axis=1)  # the inverse permutation: when each item was packed
    same_bin = (bins[:, :, None] == bins[:, None, :]) & packed[:, :, None] & packed[:, None, :]
    same_bin &= ~np.eye(items, dtype=bool)
    # shared[b, i, j]: cells of i's footprint that lie over or under j's.
    reach = np.minimum(far[:, :, None], far[:, None]) - np.maximum(
        corner[:, :, None], corner[:, None]
    )
    shared = np.clip(reach[..., 0], 0, None) * np.clip(reach[..., 1], 0, None) * same_bin
    yield "overlaps another item", ((shared > 0) & (reach[..., 2] > 0)).any(2)
    earlier = turn[:, None, :] < turn[:, :, None]
    z, top = corner[..., 2], far[..., 2]
    blocked = (shared > 0) & earlier & (top[:, None, :] > z[:, :, None])
    yield "not reachable from above", blocked.any(2)

    below = earlier & (top[:, None, :] == z[:, :, None])
    footprint = size[..., 0] * size[..., 1]
    supported = np.where(z == 0, footprint, (shared * below).sum(2))
    share = problem.support * footprint
    stable = supported >= share - 1e-6 if problem.inclusive else supported > share + 1e-6
    yield "not supported", packed & ~(stable & (supported > 0))
