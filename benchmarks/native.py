"""The native loop that `pack` is measured against: the same rules, compiled by Numba.

Written as one would write it in C: every bin stays open, every item tries them in turn, a
position is given up as soon as it cannot be the lowest, and instances are spread over all cores.
"""

import numba
import numpy as np


@numba.njit(cache=True)
def _lowest(heights, bin, size, needed):
    """(x, y, z) of the item's place on one height map [W, L]; z is the bin's height if none."""
    best_x, best_y, best_z = 0, 0, bin[2] - size[2] + 1  # the first height that is too high
    too_high = best_z
    for y in range(bin[1] - size[1] + 1):
        for x in range(bin[0] - size[0] + 1):
            z, count = 0, 0
            for j in range(y, y + size[1]):
                for i in range(x, x + size[0]):
                    height = heights[j, i]
                    if height > z:
                        z, count = height, 1
                    elif height == z:
                        count += 1
                if z >= best_z:
                    break
            if z < best_z and count >= needed:
                best_x, best_y, best_z = x, y, z
                if z == 0:
                    return best_x, best_y, best_z
    return best_x, best_y, best_z if best_z < too_high else bin[2]


@numba.njit(cache=True)
def pack_one(bin, size, order, needed, heights, free, bins, position):
    """Packs one instance without padding, all of whose items fit an empty bin.

    Args:
        bin: int32 [3].
        size: int32 [N, 3], cells.
        order: int32 [N].
        needed: int32 [L * W + 1], cells that must carry a footprint of so many cells.
        heights: int32 [N, W, L], room for the maps of the open bins.
        free: int32 [N], room for the free volumes of the open bins.
        bins: int32 [N], written: the bin of each item.
        position: int32 [N, 3], written: its corner.
    """
    used = 0
    for item in order:
        length, width, height = size[item]
        for slot in range(used + 1):
            if slot == used:
                heights[slot] = 0
                free[slot] = bin[0] * bin[1] * bin[2]
                used += 1
            if length * width * height > free[slot]:
                continue
            x, y, z = _lowest(heights[slot], bin, size[item], needed[length * width])
            if z < bin[2]:
                heights[slot, y : y + width, x : x + length] = z + height
                free[slot] -= length * width * height
                bins[item] = slot
                position[item, 0], position[item, 1], position[item, 2] = x, y, z
                break
    return used


@numba.njit(parallel=True)
def _pack_all(bin, size, order, needed, bins, position):
    batch, items, _ = size.shape
    pieces = min(batch, 8 * numba.get_num_threads())  # a few per core, so that all end together
    for piece in numba.prange(pieces):
        heights = np.empty((items, bin[1], bin[0]), np.int32)
        free = np.empty(items, np.int32)
        for i in range(piece * batch // pieces, (piece + 1) * batch // pieces):
            pack_one(bin, size[i], order[i], needed, heights, free, bins[i], position[i])


def pack_native(problem, size, order):
    """(bins int32 [B, N], position int32 [B, N, 3]) of `pack` over a batch, on all cores.

    Args:
        problem: the rules, a `jaxpack.Problem`; every instance has its bin.
        size: int32 [B, N, 3], cells; no padding, and every item fits an empty bin.
        order: int32 [B, N].
    """
    bins, position = np.empty(order.shape, np.int32), np.empty(size.shape, np.int32)
    _pack_all(np.array(problem.bin), size, order, needed_cells(problem), bins, position)
    return bins, position


def needed_cells(problem):
    """int32 [L * W + 1]: cells that must carry a footprint of so many cells."""
    areas = np.arange(problem.bin[0] * problem.bin[1] + 1, dtype=np.int32)
    return np.asarray(problem.cells_needed(areas), np.int32)
