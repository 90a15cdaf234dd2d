"""Was every item placed where it may be when it came? An independent check of online packing."""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from jaxpack.model.box_check import Boxes, misplaced
from jaxpack.model.packing_check import SHOWN, InvalidPackingError
from jaxpack.model.stability_check import off_centre, unbalanced


class Played(NamedTuple):
    """What went where, turn by turn; here with the sequences as the first axis, B."""

    item: Any  # int [B, T], index in the sequence of what was placed; -1: nothing
    bin: Any  # int [B, T], from 0
    sides: Any  # int [B, T, 3], cells, as it lies
    corner: Any  # int [B, T, 3], cells


def check_online(
    bin: tuple[int, int, int],
    turns: Sequence[Sequence[int]],
    stable: bool,
    items: np.ndarray,
    played: Played,
    buffer: int = 1,
    density: np.ndarray | None = None,
    label: str = "",
) -> None:
    """Raises InvalidPackingError naming the first violations, if there are any.

    Args:
        bin: its sides in cells.
        turns: which of an item's sides may lie along x, y and z.
        stable: whether an item's centre has to be over what stands firm, see `Rules.stability`.
        items: int [B, N, 3], sides in cells, in the order in which they arrive.
        played: arrays of NumPy.
        buffer: how many items there were to choose from.
        density: float [B, N] of the items. With these weights forces have to hold every stack too.
        label: whose packings they are, the first word of the message.

    Raises:
        InvalidPackingError: an item was placed twice, or before it had arrived, in a bin that was
            closed, in an orientation that it may not have, out of the bin, into another one, on
            nothing, or so that it may tip.
    """
    found = list(islice(_violations(bin, turns, stable, items, played, buffer), SHOWN))
    if not found and density is not None:
        boxes, rows = _boxes(bin, played)
        weights = (boxes.high - boxes.low).prod(1) * density[rows[0], played.item[rows]]
        nothing = np.zeros(len(weights), np.bool_)
        tipping = islice(unbalanced(boxes, weights, nothing), SHOWN)
        found = [f"{_where(rows, one.row)}: no forces hold it" for one in tipping]
    if found:
        raise InvalidPackingError(f"{label} packed against the rules: " + "; ".join(found))


def _violations(
    bin: tuple[int, int, int],
    turns: Sequence[Sequence[int]],
    stable: bool,
    items: np.ndarray,
    played: Played,
    buffer: int,
) -> Iterator[str]:
    """Every broken rule, one line each."""
    item, bins, sides, _ = played
    placed = item >= 0
    before: np.ndarray = np.cumsum(placed, 1) - placed
    ordered = np.sort(np.where(placed, item, -1 - np.arange(item.shape[1])), 1)
    own = np.take_along_axis(items, np.maximum(item, 0)[..., None], 1)
    lies = np.stack([(own[..., list(turn)] == sides).all(-1) for turn in turns]).any(0)
    opened = np.diff(bins, axis=1, prepend=-1)
    broken = {
        "no item of the sequence": placed & (item >= items.shape[1]),
        "an item was placed twice": (np.diff(ordered, axis=1, prepend=-(2**30)) == 0),
        "placed before it had arrived": placed & (item >= before + buffer),
        "its orientation is not allowed": placed & ~lies,
        "a bin was left out, or opened again": placed & ((opened < 0) | (opened > 1)),
    }
    for rule, where in broken.items():
        for sequence, turn in np.argwhere(where):
            yield f"sequence {sequence} turn {turn}: {rule}"
    boxes, rows = _boxes(bin, played)
    for finding in misplaced(boxes, Fraction(0), True):
        yield f"{_where(rows, finding.row)}: {finding.rule}"
    if stable:
        for one in off_centre(boxes, np.zeros(len(boxes.bin), np.bool_)):
            yield f"{_where(rows, one.row)}: its centre is not over what stands firm"


def _boxes(
    bin: tuple[int, int, int], played: Played
) -> tuple[Boxes, tuple[np.ndarray, np.ndarray]]:
    """(the items that were placed, the sequence and the turn of each)."""
    item, bins, sides, corner = played
    rows = np.nonzero(item >= 0)
    low = corner[rows].astype(np.int64)
    number = rows[0] * (int(bins.max(initial=0)) + 1) + bins[rows]
    room = np.broadcast_to(np.array(bin, np.int64), low.shape)
    return Boxes(number, low, low + sides[rows], room), (rows[0], rows[1])


def _where(rows: tuple[np.ndarray, np.ndarray], row: int) -> str:
    return f"sequence {rows[0][row]} turn {rows[1][row]}"
