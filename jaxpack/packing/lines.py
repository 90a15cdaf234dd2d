"""Lines across a bin, between which nothing changes: where items end, along one axis."""

from dataclasses import dataclass

import numpy as np


@dataclass
class Lines:
    """Where cells begin along one axis: ascending, from 0 to the far wall."""

    at: np.ndarray  # int64 [C + 1], units; C cells lie between
    corner: np.ndarray  # bool [C + 1], whether items may stand there with their near edge
    step: int  # units, of which corners are multiples

    def with_ends(self, starts: np.ndarray, length: int) -> tuple["Lines", np.ndarray]:
        """With the near and far edges of items, and the old cell that each new one is part of."""
        wall = self.at[-1]
        ends = starts + length
        stands = -(-ends // self.step) * self.step
        at = np.unique(np.concatenate([self.at, starts, ends, stands[stands <= wall]]))
        corner = np.isin(at, np.concatenate([self.at[self.corner], stands]))
        return Lines(at, corner, self.step), np.searchsorted(self.at, at[:-1], "right") - 1


def pitch(lines: Lines, length: int) -> int:
    """From one item to the next of this length beside it."""
    return -(-length // lines.step) * lines.step


def windows_of(lines: Lines, length: int) -> tuple[np.ndarray, np.ndarray]:
    """The cells from .. to (not included) that an item covers, for every corner it fits at."""
    near = np.flatnonzero(lines.corner & (lines.at + length <= lines.at[-1]))
    return near, np.searchsorted(lines.at, lines.at[near] + length, "left")


def blocks_of(lines: Lines, lengths: np.ndarray) -> tuple[np.ndarray, ...]:
    """(near, far, long, outside) [I, C] of every corner: two blocks of 2^long cells, from the cells
    near and far on, are the window of an item, unless it is outside.
    """
    corner = np.flatnonzero(lines.corner)
    ends = lines.at[corner] + lengths[:, None]
    outside = ends > lines.at[-1]
    last = np.searchsorted(lines.at, np.minimum(ends, lines.at[-1]), "left")
    near = np.broadcast_to(np.minimum(corner, len(lines.at) - 2), ends.shape)
    long = np.frexp(np.maximum(last - near, 1))[1] - 1
    return near, np.maximum(last - (1 << long), 0), long, outside


def whole_items(lines: Lines, level: np.ndarray, first: int, length: int) -> int:
    """How many items fit side by side on level cells from the first on."""
    end = len(level) if level.all() else int(level.argmin())
    free = int(lines.at[first + end] - lines.at[first]) - length
    return free // pitch(lines, length) + 1 if free >= 0 else 0


def covered(lines: Lines, starts: np.ndarray, length: int) -> np.ndarray:
    """bool [C], whether one of the items lies on the cell."""
    item = np.searchsorted(starts, lines.at[:-1], "right") - 1
    covered: np.ndarray = (item >= 0) & (lines.at[:-1] < starts[item] + length)
    return covered
