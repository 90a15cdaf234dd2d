"""Where instances come from: the random ones, a user's table, and the rules they obey."""

from dataclasses import replace
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpack.errors import UserError
from jaxpack.learning.presets import PAPER_2D, PAPER_3D
from jaxpack.model.instances import Distribution, sample, sample_at, uniform_instance
from jaxpack.model.problem import Problem, in_orientation, make_instance

KEY = jax.random.key(0)


@pytest.mark.parametrize(
    ("problem", "distribution"),
    [(PAPER_2D, Distribution(40, 1, 5)), (PAPER_3D, Distribution(70, 2, 5))],
)
def test_sides_are_uniform_within_bounds_and_flat_axes_are_one(problem, distribution):
    instances = sample(problem, distribution, KEY, 500)
    size = np.asarray(instances.size)
    assert size.shape == (500, distribution.items, 3)
    assert np.asarray(instances.mask).all()
    assert (np.asarray(instances.bin) == problem.bin).all()
    assert (size >= 1).all()
    for axis in range(3):
        if axis not in problem.axes:
            assert (size[..., axis] == 1).all()
            continue
        values, counts = np.unique(size[..., axis], return_counts=True)
        assert values.tolist() == list(range(distribution.low, distribution.high + 1))
        # Chi-square with 3 or 4 degrees of freedom: beyond 30 once in 100,000 keys.
        expected = counts.sum() / len(values)
        assert ((counts - expected) ** 2 / expected).sum() < 30
    # The sides of an item are independent of each other, and so are neighbouring items:
    # a correlation of 500 * 40 pairs beyond 0.04 is one of 5.6 standard deviations.
    first, last = (size[..., axis].ravel() for axis in (0, 2))
    assert abs(np.corrcoef(first, last)[0, 1]) < 0.04
    assert abs(np.corrcoef(first[:-1], first[1:])[0, 1]) < 0.04


def test_an_instance_depends_on_the_key_and_its_index_only():
    distribution = Distribution(40, 1, 5)
    many = jax.tree.map(np.asarray, sample(PAPER_2D, distribution, KEY, 100))
    few = sample(PAPER_2D, distribution, KEY, 10)
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a[:10], b), many, few)
    indices = np.array([70, 3, 99, 0, 3, 50, 51, 52, 53, 54])
    picked = sample_at(PAPER_2D, distribution, KEY, jnp.array(indices))
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a[indices], b), many, picked)
    other = sample(PAPER_2D, distribution, jax.random.key(1), 10)
    assert (np.asarray(other.size) != np.asarray(few.size)).any()
    assert len({size.tobytes() for size in np.asarray(many.size)}) == 100


def test_an_items_size_does_not_depend_on_the_padding():
    problem = Problem(bin=(10, 10, 10))
    short = uniform_instance(problem, KEY, 12, 12, 2, 5, problem.bin)
    long = uniform_instance(problem, KEY, 50, 12, 2, 5, (8, 9, 10))
    np.testing.assert_array_equal(long.size[:12], short.size)
    assert long.mask.tolist() == [True] * 12 + [False] * 38
    assert (np.asarray(long.size[12:]) == 1).all()
    assert long.bin.tolist() == [8, 9, 10]
    assert short.mask.all()


def test_the_number_of_items_and_the_sides_may_be_traced():
    problem = Problem(bin=(10, 1, 10))

    def go(items, low, high):
        return uniform_instance(problem, KEY, 8, items, low, high, problem.bin)

    traced = jax.jit(jax.vmap(go))(jnp.array([3, 8]), jnp.array([1, 4]), jnp.array([2, 4]))
    assert traced.mask.sum(1).tolist() == [3, 8]
    assert (np.asarray(traced.size[1]) == [4, 1, 4]).all()
    assert np.isin(traced.size[0], [1, 2]).all()


@pytest.mark.parametrize(
    ("items", "low", "high", "message"),
    [
        (0, 1, 5, "items 0: an instance needs at least 1 item"),
        (-3, 1, 5, "items -3"),
        (40, 0, 5, "sides 0-5: a side is at least 1 cell"),
        (40, -1, 5, "sides -1-5"),
        (40, 5, 4, "sides 5-4: give the smaller side first"),
        (40, 1, 2**40, "sides 1-1099511627776: no bin is longer than 1048576"),
        (10**12, 1, 5, "items 1000000000000: .* at most 1048576"),
    ],
)
def test_a_distribution_refuses_what_it_cannot_draw(items, low, high, message):
    with pytest.raises(UserError, match=message) as caught:
        Distribution(items, low, high)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("problem", "turns", "ways"),
    [
        (PAPER_3D, "all", 6),
        (PAPER_3D, "upright", 2),
        (PAPER_2D, "all", 2),
        (PAPER_2D, "upright", 1),
    ],
)
def test_items_that_may_be_turned_have_their_sides_in_other_places(problem, turns, ways):
    distribution = Distribution(20, 2, 5, turns)
    instances = sample(problem, distribution, KEY, 30)
    fixed = sample(problem, replace(distribution, turns="fixed"), KEY, 30)
    np.testing.assert_array_equal(instances.size, fixed.size)
    assert fixed.turned is None
    size, turned = np.asarray(instances.size), np.asarray(instances.turned)
    assert turned.shape == (30, 20, ways, 3)
    np.testing.assert_array_equal(turned[:, :, 0], size)
    np.testing.assert_array_equal(
        np.sort(turned, -1), np.sort(size, -1)[:, :, None].repeat(ways, 2)
    )
    different = [len({tuple(way) for way in item}) for item in turned.reshape(-1, ways, 3).tolist()]
    assert max(different) == ways
    for axis in {0, 1, 2} - set(problem.axes):
        assert (turned[..., axis] == 1).all()
    if turns == "upright":
        np.testing.assert_array_equal(turned[..., 2], size[..., None, 2].repeat(ways, -1))
    last = jnp.full(20, ways - 1)
    chosen = in_orientation(jax.tree.map(lambda leaf: leaf[0], instances), last)
    assert chosen.turned is None
    np.testing.assert_array_equal(chosen.size, turned[0, :, -1])


def test_a_distribution_knows_which_bins_its_items_fit():
    Distribution(40, 1, 10).check_fits((10, 1, 10))
    Distribution(40, 1, 10).check_fits((10, 12, 11))
    for bin in [(9, 1, 10), (10, 1, 9), (10, 9, 10)]:
        with pytest.raises(UserError, match="sides 1-10: items of side 10 are larger than the bin"):
            Distribution(40, 1, 10).check_fits(bin)


def test_a_table_becomes_an_instance():
    three = make_instance(PAPER_3D, [[2, 3, 4], [5, 5, 10]])
    assert three.size.tolist() == [[2, 3, 4], [5, 5, 10]]
    assert three.size.dtype == jnp.int32
    assert three.mask.tolist() == [True, True]
    assert three.bin.tolist() == [10, 10, 10]
    flat = make_instance(PAPER_2D, [[2, 4], [5, 10]])
    assert flat.size.tolist() == [[2, 1, 4], [5, 1, 10]]
    assert make_instance(PAPER_2D, [[2, 1, 4], [5, 1, 10]]).size.tolist() == flat.size.tolist()
    for dtype in (float, np.float16, np.uint64, np.int8, object):
        assert make_instance(PAPER_2D, np.array([[2, 4]], dtype)).size.tolist() == [[2, 1, 4]]
    assert make_instance(PAPER_2D, jnp.array([[2, 4]])).size.tolist() == [[2, 1, 4]]


@pytest.mark.parametrize(
    ("problem", "sizes", "message"),
    [
        (PAPER_2D, [], "the instance has no items"),
        (PAPER_2D, np.zeros((0, 3)), "the instance has no items"),
        (PAPER_2D, [[1, 1], [0, 2]], "item 1: length 0 is not positive"),
        (PAPER_2D, [[1, 1], [1, -2]], "item 1: height -2 is not positive"),
        (PAPER_3D, [[1, 1, 1], [1, 0, 1]], "item 1: width 0 is not positive"),
        (PAPER_2D, [[1, 2.5]], "item 0: height 2.5 is not whole"),
        (PAPER_3D, [[1, 1, 1], [2, 2, 2], [1, float("nan"), 1]], "item 2: width nan is not a num"),
        (PAPER_2D, [[float("inf"), 1]], "item 0: length inf is not a number"),
        (PAPER_2D, [["2", "x"]], "give whole numbers"),
        (PAPER_2D, [[None, 1]], "give whole numbers"),
        (PAPER_2D, [[True, True]], "item 0: length True is not a number: give whole numbers"),
        (PAPER_2D, np.array([[1, 2], [True, 2]], object), "item 1: length True is not a number"),
        (PAPER_2D, [["2", "3"]], "item 0: length '2' is not a number: give whole numbers"),
        (PAPER_3D, [[1, 2, 3], [1, 2, None]], "item 1: height None is not a number"),
        (PAPER_2D, np.array([[b"2", b"3"]]), "item 0: length b'2' is not a number"),
        (PAPER_2D, [[1, 2 + 0j]], "item 0: length .1\\+0j. is not a number"),
        (PAPER_2D, np.array([[1, 2]], "m8[s]"), "item 0: length .* is not a number"),
        (PAPER_2D, np.array([[1, 2]], "M8[s]"), "item 0: length .* is not a number"),
        (PAPER_2D, np.zeros(2, "i4,i4"), "give one row of 2 sides per item"),
        (PAPER_2D, [[1, 2], [1, 10**30]], r"item 1: height 1e\+30 is larger than the bin"),
        (PAPER_2D, [[1, 10**400]], "item 0: height inf is not a number"),
        (PAPER_2D, [[1, -(10**30)]], r"item 0: height -1e\+30 is not positive"),
        (PAPER_2D, [[1, Fraction(5, 2)]], "item 0: height 2.5 is not whole"),
        (PAPER_2D, np.array([[1, 2**64 - 1]], np.uint64), "item 0: height 18446744073709551615 is"),
        (PAPER_2D, np.array([[1, np.nan]], np.float16), "item 0: height nan is not a number"),
        (PAPER_2D, [[1, 1e300]], r"item 0: height 1e\+300 is larger than the bin"),
        (PAPER_2D, np.zeros((0, 7)), "the instance has no items"),
        (PAPER_2D, np.zeros((3, 0)), r"sizes of shape \(3, 0\): give one row of 2 sides"),
        (PAPER_2D, 5, r"sizes of shape \(\): give one row of 2 sides"),
        (PAPER_2D, None, r"sizes of shape \(\): give one row of 2 sides"),
        (PAPER_2D, "ab", r"sizes of shape \(\): give one row of 2 sides"),
        (PAPER_2D, np.ones((2, 2, 2)), r"sizes of shape \(2, 2, 2\): give one row of 2 sides"),
        (PAPER_2D, [[1, 2], [1, 11]], r"item 1: height 11 is larger than the bin \(10, 1, 10\)"),
        (PAPER_2D, [[1, 2, 3]], r"item 0: width 2 is larger than the bin \(10, 1, 10\)"),
        (PAPER_3D, [[1, 1, 4_000_000_000]], "item 0: height 4000000000 is larger than the bin"),
        (PAPER_2D, [[5, 5], [6, 5]], r"item 1: .* larger than Problem.largest \(5, 1\)"),
        (PAPER_2D, [1, 2, 3], "give one row of 2 sides per item"),
        (PAPER_3D, [[1, 2]], "give one row of 3 sides per item"),
        (PAPER_2D, [[1, 2, 3, 4]], "give one row of 2 sides per item"),
    ],
)
def test_a_bad_table_is_refused_by_item_and_side(problem, sizes, message):
    with pytest.raises(UserError, match=message) as caught:
        make_instance(problem, sizes)
    assert "\n" not in str(caught.value)


def test_a_ragged_table_is_refused():
    with pytest.raises(UserError):
        make_instance(PAPER_3D, [[1, 2, 3], [1, 2]])


@pytest.mark.parametrize(
    "bin", [(0, 1, 10), (10, -1, 10), (10, 10), (10, 1, 2.5), (10, 1, 40_000), (2000, 2000, 10)]
)
def test_a_problem_refuses_bad_bins(bin):
    with pytest.raises(UserError, match="bin ") as caught:
        Problem(bin=bin)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "bin",
    # A float that is whole is equal to the integer, and so finds the integer's compiled packer, but
    # is no length of an array.
    [(10.0, 1, 10), ("a", 1, 10), (float("nan"), 1, 10), (float("inf"), 1, 10)],
)
def test_a_problem_refuses_sides_that_are_no_integers(bin):
    with pytest.raises(UserError):
        Problem(bin=bin)


@pytest.mark.parametrize("largest", [(0, 1), (-1, 1), (2.5, 1), (5,)])
def test_a_problem_refuses_bad_bounds_on_the_items(largest):
    with pytest.raises(UserError):
        Problem(bin=(10, 1, 10), largest=largest)


@pytest.mark.parametrize("support", [-0.1, 1.1, float("nan")])
def test_a_problem_refuses_bad_supports(support):
    with pytest.raises(UserError, match=r"support .*: give a share from 0 to 1"):
        Problem(bin=(10, 1, 10), support=support)


def test_a_resized_problem_keeps_flat_axes_flat():
    assert PAPER_2D.resized((12, 9, 7), 4) == replace(PAPER_2D, bin=(12, 1, 7), largest=(4, 1))
    assert PAPER_3D.resized((12, 9, 7), 4) == replace(PAPER_3D, bin=(12, 9, 7), largest=(4, 4))
    with pytest.raises(UserError, match="at least 2 cells"):
        PAPER_3D.resized((12, 1, 7), 4)


@pytest.mark.parametrize(
    ("support", "inclusive", "cells"),
    # Of 1, 2, 3, 10 and 20 cells; 0.3 of 10 is 3 exactly, 3.0000000000000004 is not asked for.
    [
        (0.5, True, [1, 1, 2, 5, 10]),
        (0.5, False, [1, 2, 2, 6, 11]),
        (0.3, True, [1, 1, 1, 3, 6]),
        (0.3, False, [1, 1, 1, 4, 7]),
        (1.0, True, [1, 2, 3, 10, 20]),
        (0.0, True, [0, 0, 0, 0, 0]),
        (0.0, False, [1, 1, 1, 1, 1]),
    ],
)
def test_cells_needed_are_exact(support, inclusive, cells):
    problem = Problem(bin=(10, 10, 10), support=support, inclusive=inclusive)
    assert problem.cells_needed(jnp.array([1, 2, 3, 10, 20])).tolist() == cells


def test_cells_needed_are_exact_for_large_footprints():
    # 0.9999 of 250,000 cells are 249,975 cells: numerator times area is beyond 2^31.
    problem = Problem(bin=(1000, 1000, 10), support=0.9999)
    assert problem.cells_needed(jnp.array([250_000])).tolist() == [249_975]
