"""The kernel without a grid: against the grid kernel, and against a plain packer."""

from fractions import Fraction
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpack.loading.quick import Rows, pack_quickly
from jaxpack.packing.first_fit_exact import Bins, ExactRules, Items, pack_exact
from jaxpack.packing.height_map import cell_dtype, drop, empty_map, lowest, rest
from jaxpack.packing.problem import Problem
from jaxpack.packing.top_faces import lowest_corner, no_faces, put_on, rest_on


@pytest.mark.parametrize("problem", [
    Problem(bin=(7, 5, 6), support=0.5, inclusive=False),
    Problem(bin=(6, 6, 8), support=0.75),
    Problem(bin=(9, 1, 9), support=0.5),
    Problem(bin=(5, 4, 6), support=0.0),
], ids=str)  # fmt: skip
def test_with_all_cells_as_candidates_it_is_the_grid_kernel(problem):
    batch, count = 200, 14
    rng = np.random.default_rng(3)
    L, W, _ = problem.bin
    room = tuple(jnp.full(batch, side, jnp.int32) for side in problem.bin)
    xs, ys = (jnp.broadcast_to(jnp.arange(n)[:, None], (n, batch)) for n in (L, W))
    dtype = cell_dtype(problem)

    @jax.jit
    def both(heights, faces, size):
        needed = problem.cells_needed(size[0] * size[1])
        narrow = tuple(side.astype(dtype) for side in size)
        z = rest(problem, heights, narrow, needed.astype(dtype), room[2].astype(dtype))
        grid, fits = lowest(problem, z)
        exact = lowest_corner(xs, ys, rest_on(faces, xs, ys, size, needed, room))
        after = drop(problem, heights, narrow, grid, fits), put_on(faces, size, *exact)
        return (grid, fits), exact, after

    heights = empty_map(problem, jnp.broadcast_to(jnp.asarray(problem.bin)[:, None], (3, batch)))
    faces = no_faces(count, batch)
    placed = 0
    for _ in range(count):
        size = tuple(
            jnp.asarray(rng.integers(1, side // 2 + 2, batch), jnp.int32) for side in problem.bin
        )
        (grid, fits), (exact, also), (heights, faces) = both(heights, faces, size)
        np.testing.assert_array_equal(fits, also)
        for one, other in zip(grid, exact, strict=True):
            np.testing.assert_array_equal(np.where(fits, one, 0), np.where(fits, other, 0))
        placed += int(fits.sum())
    assert batch * 4 < placed < batch * count, "nothing was refused, or all"


def plain_bin(items, room, limit, support, inclusive):
    """(index -> corner) of one bin, by the rule's own words; all numbers are Fractions."""
    faces, corners, load = [], {}, 0
    for index, (size, weight) in items:
        length, width, height = size
        if load + weight > limit:
            continue
        found = []
        for x in sorted({0, *(f[1] for f in faces)}):
            for y in sorted({0, *(f[3] for f in faces)}):
                if x + length > room[0] or y + width > room[1]:
                    continue
                under = [
                    (top, (min(x + length, x1) - max(x, x0)) * (min(y + width, y1) - max(y, y0)))
                    for x0, x1, y0, y1, top in faces
                    if x < x1 and x0 < x + length and y < y1 and y0 < y + width
                ]
                z = max((top for top, _ in under), default=0)
                carried = sum(area for top, area in under if top == z) if z else length * width
                share = Fraction(carried, length * width)
                enough = share >= support if inclusive else share > support
                if enough and z + height <= room[2]:
                    found.append((z, y, x))
        if found:
            z, y, x = min(found)
            faces.append((x, x + length, y, y + width, z + height))
            corners[index] = (x, y, z)
            load += weight
    return corners


@cache
def packer(rules):
    return jax.jit(partial(pack_exact, rules))


# Sides that repeat make equal heights and common edges, odd ones make everything else.
MIXED, ALIKE = (200, 250, 300, 400, 333, 517), (250, 400)


@pytest.mark.parametrize(
    ("flat", "support", "inclusive", "sides"),
    [
        (False, 0.5, True, MIXED),
        (False, 0.5, True, ALIKE),  # copies of what was refused, and what is only higher
        (False, 0.6, False, MIXED),
        (True, 1.0, True, MIXED),
        (True, 0.0, True, MIXED),
    ],
)
def test_it_packs_as_a_plain_packer_does(flat, support, inclusive, sides):
    batch, count, slots = 40, 12, 4
    rng = np.random.default_rng(5)
    side = np.array([1200, 1 if flat else 800, 1000])
    sizes = rng.choice(sides, (count, 3, batch))
    sizes[:, 1] = 1 if flat else sizes[:, 1]
    weights = rng.integers(0, 9, (count, batch))
    rooms = np.stack([side, side // [2, 1, 2], side, side], 0)[..., None].repeat(batch, 2)
    limits = np.array([30, 10, 25, 1000])[:, None].repeat(batch, 1)
    rules = ExactRules(16, flat, support, inclusive)
    layout = packer(rules)(
        Items(jnp.asarray(sizes), jnp.asarray(weights), jnp.ones((count, batch), bool)),
        Bins(jnp.asarray(rooms), jnp.asarray(limits)),
    )
    bins, corners = np.asarray(layout.bin), np.asarray(layout.corner)
    for b in range(batch):
        waiting = list(range(count))
        for slot in range(slots):
            offered = [(i, (tuple(map(int, sizes[i, :, b])), int(weights[i, b]))) for i in waiting]
            room = tuple(map(int, rooms[slot, :, b]))
            placed = plain_bin(
                offered, room, int(limits[slot, b]), Fraction(str(support)), inclusive
            )
            assert {i for i in range(count) if bins[i, b] == slot} == set(placed)
            for i, corner in placed.items():
                assert tuple(corners[i, :, b]) == corner
            waiting = [i for i in waiting if i not in placed]
        assert all(bins[i, b] == -1 for i in waiting)


def test_a_copy_of_what_was_refused_fits_once_something_else_has_come_in():
    # Two of 7 lie on nothing wide enough until a gap of 4 beside 6 is filled. The second does then.
    sizes = np.array([[6, 1, 3], [7, 1, 2], [4, 1, 3], [7, 1, 2], [7, 1, 3]])
    rules, bins, corners = ExactRules(16, True, 1.0), [0, 1, 0, 0, 1], [0, 0, 6, 0, 0]
    room, limit = np.tile([10, 1, 6], (2, 1)), np.zeros(2, int)
    layout = packer(rules)(
        Items(jnp.asarray(sizes)[..., None], jnp.zeros((5, 1), int), jnp.ones((5, 1), bool)),
        Bins(jnp.asarray(room)[..., None], jnp.asarray(limit)[:, None]),
    )
    rows = Rows(sizes, np.zeros(5, int), room, limit)
    quickly = pack_quickly(rules, rows, lambda: False)
    for bin, corner in ((layout.bin[:, 0], layout.corner[..., 0]), quickly):
        assert bin.tolist() == bins
        assert corner[:, 0].tolist() == corners


def test_a_finer_unit_changes_nothing():
    rng = np.random.default_rng(7)
    sizes = rng.integers(1, 6, (20, 3, 50))
    bins = Bins(jnp.full((6, 3, 50), 10), jnp.full((6, 50), 1))
    fine = Bins(bins.size * 100, bins.limit)
    still = jnp.zeros((20, 50), int)
    coarse = Items(jnp.asarray(sizes), still, jnp.ones((20, 50), bool))
    one = packer(ExactRules(32))(coarse, bins)
    other = packer(ExactRules(32))(coarse._replace(size=coarse.size * 100), fine)
    np.testing.assert_array_equal(one.bin, other.bin)
    np.testing.assert_array_equal(one.corner * 100, other.corner)
    assert (np.asarray(one.bin) >= 0).all()
