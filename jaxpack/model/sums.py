"""What copies of lengths come to, side by side."""

import numpy as np


def sums(lengths: np.ndarray, copies: np.ndarray, most: int) -> int:
    """The sums up to `most`, as bits.

    Args:
        lengths: int [..., n]; what is not above 0 does not count.
        copies: int [n], of each length.
        most: the longest sum.
    """
    short = (lengths > 0) & (lengths <= most)
    count = np.bincount(lengths[short], (short * copies)[short]).astype(int)
    reached, mask = 1, (2 << most) - 1
    for length in np.flatnonzero(count).tolist():
        left, together = int(count[length]), 1
        while left and length * together <= most:
            taken = min(together, left)
            reached |= reached << (length * taken) & mask
            left, together = left - taken, 2 * together
    return reached
