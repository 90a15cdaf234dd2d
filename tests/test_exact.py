"""The kernel without a grid: against the grid kernel, and against a plain packer."""

from fractions import Fraction
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpack.model.encoding import Genes, load_job
from jaxpack.model.job import BinType, ItemType, Job
from jaxpack.model.rules import Rules
from jaxpack.packing.decode import Bins, Items, decode
from jaxpack.packing.rules import RULES
from jaxpack.packing.top_faces import TopFaces
from jaxpack.search.compiled import first_genes
from jaxpack.search.packer import encode, pack_lanes
from jaxpack.search.quick import pack_quickly


def overlap(low, high, other_low, other_high):
    return max(0, min(high, other_high) - max(low, other_low))


def contact(corner, size, boxes, room):
    """Area of the sides that touches walls and other boxes."""
    area = 0
    for axis, along in ((0, 1), (1, 0)):
        walls = (corner[axis] == 0) + (corner[axis] + size[axis] == room[axis])
        area += walls * size[along] * size[2]
        for low, high in boxes:
            touch = (high[axis] == corner[axis]) + (low[axis] == corner[axis] + size[axis])
            side = overlap(corner[along], corner[along] + size[along], low[along], high[along])
            area += touch * side * overlap(corner[2], corner[2] + size[2], low[2], high[2])
    return area


def waste(corner, size, boxes, room):
    """Volume below a box that no box fills."""
    filled = 0
    for low, high in boxes:
        x, y = (overlap(corner[n], corner[n] + size[n], low[n], high[n]) for n in (0, 1))
        filled += x * y * (high[2] - low[2])
    return size[0] * size[1] * corner[2] - filled


def distance(corner, size, boxes, room):
    """To the nearest vertical edge of the bin."""
    return sum(min(corner[n], room[n] - size[n] - corner[n]) for n in (0, 1))


KEYS = {  # name of a rule -> what it looks at, the most important first
    "lowest": lambda *at: (at[0][2],),
    "nearest-corner": lambda *at: (at[0][2], distance(*at)),
    "far-corner": lambda *at: (at[0][2], -at[0][1], -at[0][0]),
    "most-contact": lambda *at: (-contact(*at), at[0][2]),
    "least-wasted": lambda *at: (waste(*at), at[0][2]),
}


MARGIN = Fraction(1, 64)


def firm_part(base, firm):
    """What carries of the top of something that lies there, given what carries under it: a
    rectangle, or None where one quarter of the base has nothing beyond the centre and a margin.
    """
    (x0, x1), (y0, y1) = base
    middle = Fraction(x0 + x1, 2), Fraction(y0 + y1, 2)
    margin = (x1 - x0) * MARGIN, (y1 - y0) * MARGIN
    ends = {}
    for end_x in (0, 1):
        for end_y in (0, 1):
            reaches = []
            for ax, bx, ay, by in firm:
                if ax >= x1 or bx <= x0 or ay >= y1 or by <= y0:
                    continue
                end = (min(bx, x1) if end_x else max(ax, x0), min(by, y1) if end_y else max(ay, y0))
                out = [
                    (end[axis] - middle[axis]) * (1 if far else -1)
                    for axis, far in enumerate((end_x, end_y))
                ]
                if out[0] >= margin[0] and out[1] >= margin[1]:
                    reaches.append((out[0] * out[1], end))
            if not reaches:
                return None
            ends[end_x, end_y] = max(reaches, key=lambda one: one[0])[1]
    return (
        max(ends[0, 0][0], ends[0, 1][0]),
        min(ends[1, 0][0], ends[1, 1][0]),
        max(ends[0, 0][1], ends[1, 0][1]),
        min(ends[0, 1][1], ends[1, 1][1]),
    )


def plain_bin(items, room, limit, support, inclusive, rule="lowest", firm=False):
    """(index -> corner) of one bin, by the rule's own words; all numbers are Fractions."""
    faces, boxes, corners, load, firms = [], [], {}, 0, {}
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
                ends = (x, x + length), (y, y + width)
                if firm and z and firm_part(ends, firms.get(z, [])) is None:
                    enough = False
                if enough and z + height <= room[2]:
                    found.append((*KEYS[rule]((x, y, z), size, boxes, room), y, x, z))
        if found:
            *_, y, x, z = min(found)
            boxes.append(((x, y, z), (x + length, y + width, z + height)))
            faces.append((x, x + length, y, y + width, z + height))
            corners[index] = (x, y, z)
            ends = (x, x + length, y, y + width)
            part = firm_part((ends[:2], ends[2:]), firms.get(z, [])) if firm and z else ends
            firms.setdefault(z + height, []).append(part)
            load += weight
    return corners


@cache
def packer(surface, rule):
    return jax.jit(partial(decode, surface, RULES[rule]))


def packed(surface, share, sizes, weights, rooms, limits, wide=False, rule="lowest"):
    """(bin [N, B], corner [N, 3, B]) with all items waiting; areas and weights of 64 bits or 32."""
    count, _, batch = sizes.shape
    kind = np.int64 if wide else np.int32
    area = sizes[:, 0].astype(np.int64) * sizes[:, 1]
    needed = np.vectorize(lambda a: share.area_needed(int(a)))(area).astype(kind)
    order = np.arange(count, dtype=np.int32)[:, None].repeat(batch, 1)
    with jax.enable_x64(True):
        items = Items(
            tuple(np.moveaxis(sizes, 1, 0).astype(surface.dtype)),
            needed,
            np.ones((count, batch), bool),
            weights.astype(kind),
        )
        bins = Bins(tuple(np.moveaxis(rooms, 1, 0).astype(surface.dtype)), limits.astype(kind))
        items, bins, order = jax.tree.map(jnp.asarray, (items, bins, order))
    placed = packer(surface, rule)(items, bins, order)
    corner = np.stack([np.asarray(side) for side in placed.corner], 1)
    return np.asarray(placed.bin), corner.astype(np.int64)


# Sides that repeat make equal heights and common edges, odd ones make everything else.
MIXED, ALIKE = (200, 250, 300, 400, 333, 517), (250, 400)


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
@pytest.mark.parametrize(  # in 64 bits volumes, which the other rules look at, are floats
    ("rule", "unit"), [*((rule, 1) for rule in KEYS), ("lowest", 2**19 - 3)]
)
@pytest.mark.parametrize("stability", ["share", "centre"])
def test_it_packs_as_a_plain_packer_does(flat, support, inclusive, sides, unit, rule, stability):
    firm = stability == "centre"
    batch, count, slots = (40, 12, 4) if rule == "lowest" else (16, 12, 4)
    rng = np.random.default_rng(5)
    side = unit * np.array([1200, 800, 1000])
    sizes = unit * rng.choice(sides, (count, 3, batch))
    side[1] = 1 if flat else side[1]
    sizes[:, 1] = 1 if flat else sizes[:, 1]
    weights = rng.integers(0, 9, (count, batch))
    rooms = np.stack([side, side // [2, 1, 2], side, side], 0)[..., None].repeat(batch, 2)
    limits = np.array([30, 10, 25, 1000])[:, None].repeat(batch, 1)
    bins, corners = packed(
        TopFaces(16, flat, short=unit == 1, firm=firm),
        Rules(support, inclusive),
        sizes,
        weights,
        rooms,
        limits,
        wide=unit > 1,
        rule=rule,
    )
    for b in range(batch):
        waiting = list(range(count))
        for slot in range(slots):
            offered = [(i, (tuple(map(int, sizes[i, :, b])), int(weights[i, b]))) for i in waiting]
            room = tuple(map(int, rooms[slot, :, b]))
            placed = plain_bin(
                offered, room, int(limits[slot, b]), Fraction(str(support)), inclusive, rule, firm
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
    compiled = packed(TopFaces(16, True), Rules(1.0), items, weights, *bins_of_it)
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
    one = packed(TopFaces(32), Rules(), sizes, still, rooms, limits)
    for unit, wide in ((100, False), (2**30 // 10, True)):
        other = packed(TopFaces(32), Rules(), sizes * unit, still, rooms * unit, limits, wide=wide)
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1] * unit, other[1])
    assert (one[0] >= 0).all()


def test_corners_stand_on_the_grid_that_is_asked_for():
    rng = np.random.default_rng(8)
    sizes = rng.integers(1, 60, (20, 3, 30))
    rooms, limits, still = np.full((20, 3, 30), 100), np.full((20, 30), 1), np.zeros((20, 30))
    bins, corners = packed(TopFaces(32, step=7), Rules(), sizes, still, rooms, limits)
    assert (bins >= 0).all()
    assert not (corners[:, :2] % 7).any()
    assert (corners[:, 2] % 7).any(), "heights are what lies there"


def test_bins_without_a_limit_take_any_weight():
    weights = np.full((5, 1), 2**30)
    sizes, rooms = np.ones((5, 3, 1), int), np.full((5, 3, 1), 9)
    limits = np.full((5, 1), np.iinfo(np.int32).max)
    bins, _ = packed(TopFaces(8), Rules(), sizes, weights, rooms, limits)
    assert not bins.any()
    limits[0] = 2**30 + 1
    bins, _ = packed(TopFaces(8), Rules(), sizes, weights, rooms, limits)
    assert bins[:, 0].tolist() == [0, 1, 1, 1, 1]


@pytest.mark.parametrize(  # every two of them together
    ("rule", "dimension", "stability"),
    [
        ("lowest", 2, "share"),
        pytest.param("lowest", 3, "centre", marks=pytest.mark.long),
        ("nearest-corner", 2, "centre"),
        pytest.param("nearest-corner", 3, "share", marks=pytest.mark.long),
        ("most-contact", 2, "share"),
        pytest.param("most-contact", 3, "centre", marks=pytest.mark.long),
        pytest.param("least-wasted", 2, "centre", marks=pytest.mark.long),
        ("least-wasted", 3, "share"),
    ],
)
def test_in_numpy_every_rule_is_the_same(rule, dimension, stability):
    rng = np.random.default_rng(4)
    sides = rng.integers(2, 9, (30, 3)).astype(float)
    sides[:, 1] = 1 if dimension == 2 else sides[:, 1]
    room = (20.0, 1.0 if dimension == 2 else 16.0, 18.0)
    job = Job(tuple(ItemType(tuple(side)) for side in sides), (BinType(room),), dimension)
    loading = load_job(job, Rules(rule=rule, stability=stability))
    decoding, stock = encode(loading)
    genes = first_genes(loading, stock, 0, 4)
    bins, corners = pack_lanes(decoding, stock, genes)
    for lane in range(4):
        own = Genes(genes.order[lane][genes.order[lane] < 30], genes.turn[lane], genes.pool[lane])
        bin, corner = pack_quickly(loading, own, blocks=False)
        np.testing.assert_array_equal(bin, bins[lane, :30])
        np.testing.assert_array_equal(corner, corners[lane, :30])
