"""The kernel without a grid: against the grid kernel, and against a plain packer."""

from fractions import Fraction
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpack.model.encoding import Genes, Rules, load_job
from jaxpack.model.job import BinType, ItemType, Job
from jaxpack.model.problem import Problem
from jaxpack.packing.first_fit_exact import Bins, ExactRules, Items, pack_exact
from jaxpack.packing.height_map import cell_dtype, drop, empty_map, lowest, rest
from jaxpack.packing.top_faces import lowest_corner, no_faces, put_on, rest_on
from jaxpack.search.quick import pack_quickly


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


def packed(rules, share, sizes, weights, rooms, limits, step=1, wide=False):
    """(bin [N, B], corner [N, 3, B]) with all items waiting; areas and weights of 64 bits or 32."""
    count, _, batch = sizes.shape
    kind = np.int64 if wide else np.int32
    area = sizes[:, 0].astype(np.int64) * sizes[:, 1]
    needed = np.vectorize(lambda a: share.area_needed(int(a)))(area).astype(kind)
    with jax.enable_x64(True):
        items = Items(
            sizes.astype(np.int32), needed, weights.astype(kind), np.ones((count, batch), bool)
        )
        bins = Bins(rooms.astype(np.int32), limits.astype(kind), np.int32(step))
        items, bins = jax.tree.map(jnp.asarray, (items, bins))
    layout = packer(rules)(items, bins)
    return np.asarray(layout.bin), np.asarray(layout.corner)


# Sides that repeat make equal heights and common edges, odd ones make everything else.
MIXED, ALIKE = (200, 250, 300, 400, 333, 517), (250, 400)


@pytest.mark.parametrize("unit", [1, 2**19 - 3], ids=["32 bits", "64 bits"])
@pytest.mark.parametrize(
    ("flat", "support", "inclusive", "sides"),
    [
        (False, 0.5, True, MIXED),
        (False, 0.5, True, ALIKE),  # copies of what was refused, and what is only higher
        (False, 0.5, False, ALIKE),  # halves do not carry
        (False, 0.6, False, MIXED),
        (True, 1.0, True, MIXED),
        (True, 0.0, True, MIXED),
    ],
)
def test_it_packs_as_a_plain_packer_does(flat, support, inclusive, sides, unit):
    batch, count, slots = 40, 12, 4
    rng = np.random.default_rng(5)
    side = unit * np.array([1200, 800, 1000])
    sizes = unit * rng.choice(sides, (count, 3, batch))
    side[1] = 1 if flat else side[1]
    sizes[:, 1] = 1 if flat else sizes[:, 1]
    weights = rng.integers(0, 9, (count, batch))
    rooms = np.stack([side, side // [2, 1, 2], side, side], 0)[..., None].repeat(batch, 2)
    limits = np.array([30, 10, 25, 1000])[:, None].repeat(batch, 1)
    bins, corners = packed(
        ExactRules(16, flat),
        Rules(support, inclusive),
        sizes,
        weights,
        rooms,
        limits,
        wide=unit > 1,
    )
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
    bins, corners = [0, 1, 0, 0, 1], [0, 0, 6, 0, 0]
    room, limit = np.tile([10, 1, 6], (2, 1)), np.zeros(2, int)
    items, weights = sizes[..., None], np.zeros((5, 1))
    bins_of_it = room[..., None], limit[:, None]
    compiled = packed(ExactRules(16, True), Rules(1.0), items, weights, *bins_of_it)
    job = Job(tuple(ItemType((x, 1, z)) for x, _, z in sizes), (BinType((10, 1, 6), copies=2),), 2)
    genes = Genes(np.arange(5), np.zeros(5, int), np.arange(2))
    quickly = pack_quickly(load_job(job, Rules(1.0)), genes, blocks=False)
    for bin, corner in ((compiled[0][:, 0], compiled[1][..., 0]), quickly):
        assert bin.tolist() == bins
        assert corner[:, 0].tolist() == corners


def test_a_finer_unit_changes_nothing():
    rng = np.random.default_rng(7)
    sizes = rng.integers(1, 6, (20, 3, 50))
    rooms, limits, still = np.full((6, 3, 50), 10), np.full((6, 50), 1), np.zeros((20, 50))
    one = packed(ExactRules(32), Rules(), sizes, still, rooms, limits)
    for unit, wide in ((100, False), (2**30 // 10, True)):
        other = packed(
            ExactRules(32), Rules(), sizes * unit, still, rooms * unit, limits, wide=wide
        )
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1] * unit, other[1])
    assert (one[0] >= 0).all()


def test_corners_stand_on_the_grid_that_is_asked_for():
    rng = np.random.default_rng(8)
    sizes = rng.integers(1, 60, (20, 3, 30))
    rooms, limits, still = np.full((20, 3, 30), 100), np.full((20, 30), 1), np.zeros((20, 30))
    bins, corners = packed(ExactRules(32), Rules(), sizes, still, rooms, limits, step=7)
    assert (bins >= 0).all()
    assert not (corners[:, :2] % 7).any()
    assert (corners[:, 2] % 7).any(), "heights are what lies there"


def test_bins_without_a_limit_take_any_weight():
    weights = np.full((5, 1), 2**30)
    sizes, rooms = np.ones((5, 3, 1), int), np.full((5, 3, 1), 9)
    limits = np.full((5, 1), np.iinfo(np.int32).max)
    bins, _ = packed(ExactRules(8), Rules(), sizes, weights, rooms, limits)
    assert not bins.any()
    limits[0] = 2**30 + 1
    bins, _ = packed(ExactRules(8), Rules(), sizes, weights, rooms, limits)
    assert bins[:, 0].tolist() == [0, 1, 1, 1, 1]
