"""The metrics against numbers worked out by hand, and what they promise for every packing."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest
from cases import packer, random_cases
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxpack.errors import UserError
from jaxpack.model.metrics import (
    bins_first_cost,
    bins_used,
    compactness,
    lower_bound,
    paper_cost,
    pyramid,
    utilisation,
)
from jaxpack.model.problem import Instance, Packing, Problem, make_instance
from jaxpack.packing.first_fit import pack


def packed(problem, sizes):
    """(instance, packing) of the items in the order of the table."""
    instance = make_instance(problem, sizes)
    fully = {"xla_backend_optimization_level": 3}  # the largest bins have a million cells
    packs = jax.jit(partial(pack, problem), compiler_options=fully)
    return instance, packs(instance, jnp.arange(len(sizes)))


def test_the_height_map_of_figure_4a():
    # [5 5 2 3 3] in a bin of length 5 from items of 2 x 5, 1 x 2 and 2 x 3: volume 10 + 2 + 6
    # = 18, highest point 5, sum of the map 5 + 5 + 2 + 3 + 3 = 18. C = 18 / (5 * 5), P = 1.
    problem = Problem(bin=(5, 1, 8))
    instance, packing = packed(problem, [[2, 5], [1, 2], [2, 3]])
    assert (packing.volume[0], packing.top[0], packing.shadow[0]) == (18, 5, 18)
    assert float(compactness(instance, packing)) == pytest.approx(18 / 25)
    assert float(pyramid(packing)) == pytest.approx(1)
    # Of the bin's 5 * 8 cells 18 are filled: utilisation sees the space on top.
    assert float(utilisation(instance, packing)) == pytest.approx(18 / 40)


def test_two_bins_in_2d():
    # Bin 4 x 4, items l x h in this order, stable on at least half:
    #   3 x 2  bin 0 at (0, 0)                              map [2 2 2 0]
    #   4 x 1  bin 0 at (0, 2), 3 of 4 cells supported      map [3 3 3 3], one cell trapped
    #   2 x 3  too high on bin 0 (3 + 3 > 4): bin 1 (0, 0)  map [3 3 0 0]
    #   1 x 1  first fit, back to bin 0 at (0, 3)           map [4 3 3 3]
    # Bin 0: volume 6 + 4 + 1 = 11, top 4, sum 13: C = 11/16, P = 11/13.
    # Bin 1: volume 6, top 3, sum 6:               C = 6/12,  P = 1.
    problem = Problem(bin=(4, 1, 4), support=0.5, inclusive=True)
    instance, packing = packed(problem, [[3, 2], [4, 1], [2, 3], [1, 1]])
    assert packing.bin.tolist() == [0, 0, 1, 0]
    assert packing.position.tolist() == [[0, 0, 0], [0, 0, 2], [0, 0, 0], [0, 0, 3]]
    assert packing.volume.tolist() == [11, 6, 0, 0]
    assert packing.top.tolist() == [4, 3, 0, 0]
    assert packing.shadow.tolist() == [13, 6, 0, 0]
    assert int(bins_used(packing)) == 2
    c, p = (11 / 16 + 6 / 12) / 2, (11 / 13 + 1) / 2
    assert float(compactness(instance, packing)) == pytest.approx(c)
    assert float(pyramid(packing)) == pytest.approx(p)
    assert float(utilisation(instance, packing)) == pytest.approx(17 / 32)
    assert int(lower_bound(instance)) == 2  # ceil(17 / 16)
    assert float(paper_cost(instance, packing)) == pytest.approx(
        5 * (0.5 - 0.5 * c + 0.5 - 0.5 * p)
    )
    assert float(paper_cost(instance, packing, alpha=1, beta=0)) == pytest.approx(5 * (1 - c))
    assert float(paper_cost(instance, packing, alpha=0.2, beta=3)) == pytest.approx(
        5 * (0.2 * (1 - c) + 3 * (1 - p))
    )
    assert float(bins_first_cost(instance, packing)) == pytest.approx(
        2 + 0.5 * (1 - c) + 0.05 * (1 - p)
    )


def test_two_bins_in_3d():
    # Bin 3 x 2 x 3, items l x w x h in this order, stable on more than half:
    #   2 x 2 x 1  bin 0 at (0, 0, 0)
    #   3 x 2 x 1  bin 0 at (0, 0, 1), 4 of 6 cells supported, two trapped: all cells at 2
    #   3 x 2 x 2  too high on bin 0 (2 + 2 > 3): bin 1 at (0, 0, 0)
    #   3 x 1 x 1  bin 1 has room on top as well, bin 0 comes first: (0, 0, 2), by minimum y
    # Bin 0: volume 4 + 6 + 3 = 13, top 3, sum 3 * 3 + 3 * 2 = 15: C = 13/18, P = 13/15.
    # Bin 1: volume 12, top 2, sum 12:                            C = 1,     P = 1.
    problem = Problem(bin=(3, 2, 3), support=0.5, inclusive=False)
    instance, packing = packed(problem, [[2, 2, 1], [3, 2, 1], [3, 2, 2], [3, 1, 1]])
    assert packing.bin.tolist() == [0, 0, 1, 0]
    assert packing.position.tolist() == [[0, 0, 0], [0, 0, 1], [0, 0, 0], [0, 0, 2]]
    assert float(compactness(instance, packing)) == pytest.approx((13 / 18 + 1) / 2)
    assert float(pyramid(packing)) == pytest.approx((13 / 15 + 1) / 2)
    assert float(utilisation(instance, packing)) == pytest.approx(25 / 36)
    assert int(lower_bound(instance)) == 2  # ceil(25 / 18)


@pytest.mark.parametrize(("length", "bins"), [(5, 1), (6, 2), (1, 1), (10, 2), (11, 3)])
def test_lower_bound_rounds_up_and_leaves_padding_out(length, bins):
    # Bin 5 x 1 x 4; `length` cells of floor, 4 high, in items of one cell, and padding up to 21.
    size = jnp.tile(jnp.array([1, 1, 4]), (21, 1))
    mask = jnp.arange(21) < length
    assert int(lower_bound(Instance(size, mask, jnp.array([5, 1, 4])))) == bins


def contents():
    """The slots of a packing of up to six bins: 0 < volume <= sum of the map <= 12 * top."""

    def bin_slot(top):
        shadow = st.integers(top, 12 * top)
        return shadow.flatmap(
            lambda cells: st.tuples(st.integers(1, cells), st.just(top), st.just(cells))
        )

    return st.lists(st.integers(1, 9).flatmap(bin_slot), min_size=1, max_size=6)


# Only the bin of the instance is read here: 4 x 3 x 9.
ROOM = Instance(np.ones((6, 3), np.int32), np.ones(6, bool), np.array([4, 3, 9], np.int32))
JUDGE = jax.jit(
    lambda instance, packing: (
        bins_used(packing),
        bins_first_cost(instance, packing),
        paper_cost(instance, packing),
    )
)


def of_contents(slots):
    columns = np.zeros((3, 6), np.int32)
    columns[:, : len(slots)] = np.array(slots).T
    nowhere = np.zeros(6, np.int32)
    return Packing(nowhere, np.zeros((6, 3), np.int32), *columns)


@settings(max_examples=100, deadline=None)
@given(contents(), contents())
def test_bins_first_cost_prefers_fewer_bins_whatever_their_quality(one, other):
    few, many = sorted((one, other), key=len)
    (few_bins, few_cost, few_paper), (many_bins, many_cost, _) = (
        JUDGE(ROOM, of_contents(slots)) for slots in (few, many)
    )
    assert (few_bins, many_bins) == (len(few), len(many))
    if len(few) < len(many):
        assert few_cost < many_cost
    assert 0 <= few_paper < 5
    assert len(few) <= few_cost < len(few) + 1


def test_bounds_and_the_oracles_means_on_random_packings():
    problem = Problem(bin=(6, 4, 7))
    instances, orders = random_cases(problem, seed=11, count=200, items=10, oversize=0)
    instances.mask[:, 0] = True  # a packing of nothing has no means
    packings = packer(problem)(instances, orders)
    c = np.asarray(jax.jit(jax.vmap(compactness))(instances, packings))
    p = np.asarray(jax.jit(jax.vmap(pyramid))(packings))
    bins = np.asarray(jax.jit(jax.vmap(bins_used))(packings))
    full = np.asarray(jax.jit(jax.vmap(utilisation))(instances, packings))
    floor = np.asarray(jax.jit(jax.vmap(lower_bound))(instances))
    assert ((c > 0) & (c <= 1)).all()
    assert ((p > 0) & (p <= 1)).all()
    assert (c <= p + 1e-6).all()  # the map's sum is at most L * W * top, bin by bin
    assert ((full > 0) & (full <= 1)).all()
    assert (full <= c + 1e-6).all()  # C leaves out the space above the highest point
    assert (bins >= floor).all()
    for case in range(200):
        bin, sizes = instances.bin[case].tolist(), instances.size[case].tolist()
        found = packings.bin[case].tolist(), packings.position[case].tolist()
        assert c[case] == pytest.approx(oracle.compactness(bin, sizes, *found))
        assert p[case] == pytest.approx(oracle.pyramid(bin, sizes, *found))
        assert bins[case] == oracle.bins_used(found[0])


MANY = 50
ALL = jax.jit(
    lambda instance, packing: {
        "bins": bins_used(packing),
        "compactness": compactness(instance, packing),
        "pyramid": pyramid(packing),
        "utilisation": utilisation(instance, packing),
        "bound": lower_bound(instance),
    }
)


def large_bins():
    """Bins up to the limits: height below 2^15 - 1, plane up to 2^20, volume below 2^31 cells."""
    lengths = st.sampled_from([1, 2, 300, 1000, 1 << 20]) | st.integers(1, 1 << 20)
    shapes = st.tuples(lengths, st.integers(1, 2000), st.integers(1, 32_766))

    def within(bin):
        length, width, height = bin
        width = min(width, (1 << 20) // length)
        return length, width, min(height, (2**31 - 1) // (length * width))

    return shapes.map(within)


@pytest.mark.long
@settings(max_examples=150, deadline=None)
@given(large_bins(), st.data())
def test_figures_of_large_bins_are_those_of_pythons_integers(bin, data):
    Problem(bin=bin)  # not refused
    length, width, height = bin
    whole, plane = length * width * height, length * width
    top = st.integers(1, height)
    used = data.draw(st.integers(1, MANY))
    slots = []
    for _ in range(used):
        highest = data.draw(st.just(height) | top)
        shadow = data.draw(st.just(plane * highest) | st.integers(highest, plane * highest))
        slots.append((data.draw(st.just(shadow) | st.integers(1, shadow)), highest, shadow))
    side = [st.just(most) | st.integers(1, most) for most in bin]
    sizes = data.draw(st.lists(st.tuples(*side), min_size=MANY, max_size=MANY))
    mask = np.array(data.draw(st.lists(st.booleans(), min_size=MANY, max_size=MANY)))
    columns = np.zeros((3, MANY), np.int32)
    columns[:, :used] = np.array(slots).T
    packing = Packing(np.zeros(MANY, np.int32), np.zeros((MANY, 3), np.int32), *columns)
    found = ALL(Instance(np.array(sizes, np.int32), mask, np.array(bin, np.int32)), packing)
    volume = sum(int(np.prod(size, dtype=object)) for size in np.array(sizes)[mask].tolist())
    assert int(found["bound"]) == -(-volume // whole)
    assert int(found["bins"]) == used
    for name, expected in (
        ("compactness", sum(v / (plane * highest) for v, highest, _ in slots) / used),
        ("pyramid", sum(v / shadow for v, _, shadow in slots) / used),
        ("utilisation", sum(v for v, _, _ in slots) / (used * whole)),
    ):
        assert float(found[name]) == pytest.approx(expected, rel=1e-5)
        assert 0 < float(found[name]) <= 1 + 1e-6


@given(st.tuples(*[st.sampled_from([1, 300, 1024, 1025, 20_000, 32_766, 1 << 40])] * 3))
def test_a_bin_is_right_or_refused_by_name(bin):
    length, width, height = bin
    named = {
        "height": height >= 32_767,
        "length times width": length * width > 1 << 20,
        "volume": length * width * height >= 2**31,
    }
    if not any(named.values()):
        Problem(bin=bin)
        return
    with pytest.raises(UserError, match=r"too many cells, its .* use a coarser grid") as caught:
        Problem(bin=bin)
    assert any(f"its {name} is" in str(caught.value) for name, broken in named.items() if broken)


@pytest.mark.parametrize(
    ("bin", "sizes"),
    [
        ((300, 300, 23_860), [(300, 300, 12_000), (299, 300, 11_860), (300, 300, 24_000 - 200)]),
        ((1024, 1024, 2047), [(1024, 1024, 2000), (1024, 700, 47), (1000, 1000, 40)]),
        ((2, 1, 32_766), [(2, 1, 32_766), (1, 1, 32_765), (2, 1, 1)]),
    ],
)
def test_packings_of_large_items_have_their_figures(bin, sizes):
    problem = Problem(bin=bin)
    instance, packing = packed(problem, sizes)
    assert (packing.bin >= 0).all()
    volumes = np.zeros(len(sizes), object)
    for (length, width, height), slot in zip(sizes, np.asarray(packing.bin), strict=True):
        volumes[slot] += length * width * height
    assert packing.volume.tolist() == volumes.tolist()
    found, whole = ALL(instance, packing), bin[0] * bin[1] * bin[2]
    assert float(found["utilisation"]) == pytest.approx(
        sum(volumes) / (whole * len({*packing.bin.tolist()})), rel=1e-5
    )
    assert int(found["bound"]) == -(-sum(volumes) // whole)
    assert 0 < float(found["compactness"]) <= float(found["pyramid"]) <= 1


def test_figures_of_many_large_bins():
    problem, count = Problem(bin=(1000, 1, 1000)), 3000
    instance = make_instance(problem, np.full((count, 2), 1000))
    full = [np.full(count, cells, np.int32) for cells in (1_000_000, 1000, 1_000_000)]
    packing = Packing(np.arange(count), np.zeros((count, 3), np.int32), *full)
    found = {name: float(value) for name, value in ALL(instance, packing).items()}
    ones = dict.fromkeys(("compactness", "pyramid", "utilisation"), pytest.approx(1, rel=1e-5))
    assert found == {"bins": count, "bound": count} | ones
