"""Is a packing of the grid possible? An independent check that shares no code with the kernel."""

from collections.abc import Iterator
from fractions import Fraction
from itertools import islice

import numpy as np
from jax.typing import ArrayLike

from jaxpack.model.box_check import Boxes, Rule, misplaced
from jaxpack.model.problem import Instance, Packing, Problem
from jaxpack.model.stability_check import off_centre

CHUNK = 1 << 18  # items checked at a time: bounds the memory
SHOWN = 5  # violations in one message


class InvalidPackingError(AssertionError):
    """A packing broke a rule: a bug in what made it, never the user's mistake."""


def check_packings(
    problem: Problem, instances: Instance, orders: ArrayLike, packings: Packing, label: str = ""
) -> None:
    """Raises InvalidPackingError naming the first violations, if there are any.

    Args:
        problem: the rules; of it only `support`, `inclusive` and `stability` are read.
        instances: leaves [B, ...], or of one instance without B.
        orders: int [B, N], the order in which the items were packed.
        packings: leaves [B, ...]; only `bin` and `position` are read.
        label: whose packings they are, the first word of the message.

    Raises:
        InvalidPackingError: an item is not packed, out of its bin, in another one, not supported,
            not over what carries it or not reachable from above; or an order is no permutation.
    """
    found = list(islice(violations(problem, instances, orders, packings), SHOWN))
    if found:
        raise InvalidPackingError(f"{label} packed against the rules: " + "; ".join(found))


def violations(
    problem: Problem, instances: Instance, orders: ArrayLike, packings: Packing
) -> Iterator[str]:
    """Every broken rule, one line each; nothing if all are valid. Arguments: `check_packings`."""
    single = np.ndim(orders) == 1
    arrays = [instances.size, instances.mask, instances.bin, orders, packings.bin]
    size, mask, room, order, bins, corner = (
        np.asarray(leaf)[None] if single else np.asarray(leaf)
        for leaf in (*arrays, packings.position)
    )
    length = max(1, CHUNK // max(1, order.shape[1]))
    for first in range(0, len(order), length):
        part = slice(first, first + length)
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
    packed = mask & (bins >= 0)
    used = np.zeros((len(bins), items), bool)
    instance, item = np.nonzero(packed & (bins < items))
    used[instance, bins[instance, item]] = True
    yield "bins are not numbered from 0 without gaps", np.any(used[:, 1:] & ~used[:, :-1], axis=1)

    turn = np.argsort(order, axis=1)  # the inverse permutation: when each item was packed
    sequence = np.argsort(turn, axis=1)
    instance, at = np.nonzero(np.take_along_axis(packed, sequence, 1))
    item = sequence[instance, at]
    names, number = np.unique(bins[instance, item], return_inverse=True)
    low = corner[instance, item].astype(np.int64)
    high = low + size[instance, item]
    boxes = Boxes(instance * len(names) + number, low, high, room[instance].astype(np.int64))
    support, inclusive = Fraction(problem.support).limit_denominator(10_000), problem.inclusive
    broken = {rule: np.zeros(packed.shape, bool) for rule in Rule}
    for found in misplaced(boxes, support, inclusive):
        broken[found.rule][instance[found.row], item[found.row]] = True
    overlaps = broken[Rule.OVERLAP].copy()
    if overlaps.any():  # of the earlier one of the two too: backwards it is the later one
        backwards = Boxes(*(leaf[::-1] for leaf in boxes))
        for found in misplaced(backwards, support, inclusive):
            if found.rule is Rule.OVERLAP:
                row = len(low) - 1 - found.row
                overlaps[instance[row], item[row]] = True
    yield "outside the bin", broken[Rule.OUTSIDE]
    yield "overlaps another item", overlaps
    yield "not reachable from above", broken[Rule.OVERLAP] | broken[Rule.BLOCKED]
    if problem.stability == "centre":
        for tipping in off_centre(boxes, np.zeros(len(low), bool)):
            broken[Rule.CENTRE][instance[tipping.row], item[tipping.row]] = True
        yield "not over what carries it", broken[Rule.CENTRE]
    yield "not supported", broken[Rule.FLOATING] | broken[Rule.SUPPORT]
