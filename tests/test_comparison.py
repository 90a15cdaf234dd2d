"""Comparisons: the same figures however they are batched, padded or split."""

from dataclasses import replace
from threading import Barrier

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpack import (
    Cell,
    Comparison,
    Distribution,
    MethodOptions,
    UserError,
    compare,
    load_policy,
    make_method,
    preset,
)
from jaxpack.comparison import grid_cells, grid_problem, make_instances
from jaxpack.methods import Method
from jaxpack.model.packing_check import InvalidPackingError
from jaxpack.search.breeding import BrkgaConfig
from jaxpack.search.protocol import Search
from jaxpack.tables import paper_row, write_table

PAPER = preset("paper-2d")
CELL = Cell(PAPER.problem.bin, PAPER.distribution)
FIGURES = ("compactness", "pyramid", "bins", "utilisation", "lower_bound", "gap")


def figures(row):
    return [getattr(row, name) for name in FIGURES]


@pytest.mark.parametrize(
    "name",
    [
        *("random", "pointer", "bin-aware"),
        *(
            pytest.param(name, marks=pytest.mark.long)
            for name in ("best-of-30", "brkga", "bin-aware-best-of-2")
        ),
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("brkga-seeded", "bin-aware-beam-3", "bin-aware-search")
        ),
    ],
)
def test_the_batch_size_does_not_change_the_figures(name):
    options = MethodOptions(brkga=BrkgaConfig(10, 3), kinds=25, width=2, draws=2, rounds=3)
    method = make_method(name, PAPER.problem, options)
    rows = [
        compare(Comparison(PAPER.problem, instances=60, batch=batch), name, method, [CELL])[0]
        for batch in (7, 60)
    ]
    assert figures(rows[0]) == figures(rows[1])


def test_more_instances_extend_the_set():
    few, _ = make_instances(Comparison(PAPER.problem, instances=5), CELL, 40)
    many, _ = make_instances(Comparison(PAPER.problem, instances=9), CELL, 40)
    np.testing.assert_array_equal(few.size, many.size[:5])
    other, _ = make_instances(Comparison(PAPER.problem, instances=5, seed=1), CELL, 40)
    assert not (few.size == other.size).all()


def test_a_cell_has_the_same_figures_inside_a_grid_and_alone():
    cells = grid_cells(PAPER.problem, [10, 40], [8, 12], [(1, 5), (2, 4)])
    assert len(cells) == 8
    grid = Comparison(grid_problem(PAPER.problem, cells), instances=20, batch=20)
    assert grid.problem.bin == (12, 1, 12)
    assert grid.problem.largest == (5, 1)
    method = make_method("height", grid.problem, MethodOptions())
    rows = compare(grid, "height", method, cells)
    assert [(row.items, row.bin, row.sides) for row in rows] == [
        (cell.distribution.items, cell.bin, (cell.distribution.low, cell.distribution.high))
        for cell in cells
    ]
    for cell, row in ((cells[0], rows[0]), (cells[-1], rows[-1])):
        problem = PAPER.problem.resized(cell.bin, cell.distribution.high)
        alone = compare(replace(grid, problem=problem), "height", method, [cell])[0]
        assert figures(row) == figures(alone)


def test_seeds_are_pooled_and_errors_are_those_of_the_mean():
    method = make_method("height", PAPER.problem, MethodOptions())
    both = Comparison(PAPER.problem, instances=40, seeds=2, batch=40)
    pooled = compare(both, "height", method, [CELL])[0]
    single = [
        compare(replace(both, seeds=1, seed=seed), "height", method, [CELL])[0] for seed in (0, 1)
    ]
    assert pooled.bins == pytest.approx(np.mean([row.bins for row in single]))
    # The variance of 80 values from the means and sample variances of its two halves.
    within = sum(39 * 40 * row.standard_error["bins"] ** 2 for row in single)
    between = sum(40 * (row.bins - pooled.bins) ** 2 for row in single)
    expected = ((within + between) / 79 / 80) ** 0.5
    assert pooled.standard_error["bins"] == pytest.approx(expected)


@pytest.mark.parametrize("seconds", [None, 1e-3])
def test_batches_are_solved_side_by_side(seconds, monkeypatch):
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1})
    both = Barrier(2)

    def in_order(keys, mask):
        both.wait(timeout=20)  # for the other batch
        return np.broadcast_to(np.arange(mask.shape[1], dtype=np.int32), mask.shape)

    def start(keys, instances):
        shape = jax.ShapeDtypeStruct(instances.mask.shape, jnp.int32)
        data = jax.random.key_data(keys)
        return jax.pure_callback(in_order, shape, data, instances.mask)

    search = Search(start, lambda instances, orders: orders, lambda orders: orders)
    comparison = Comparison(PAPER.problem, instances=8, batch=4)
    (row,) = compare(comparison, "in order", Method(start, search, seconds), [CELL])
    assert row.bins > 4


def test_an_impossible_packing_never_becomes_a_row():
    cheat = Method(lambda keys, instances: jnp.zeros(instances.mask.shape, jnp.int32))

    comparison = Comparison(PAPER.problem, instances=4, batch=4)
    with pytest.raises(InvalidPackingError, match="cheat packed against the rules: instance 0"):
        compare(comparison, "cheat", cheat, [CELL])  # item 0, forty times
    assert compare(replace(comparison, validate=False), "cheat", cheat, [CELL])


def test_bad_comparisons_are_refused():
    with pytest.raises(UserError, match="batch 0"):
        Comparison(PAPER.problem, batch=0)
    for seed, seeds in ((2**31, 1), (2**31 - 1, 2), (-(2**31) - 1, 1)):  # int32 would wrap
        with pytest.raises(UserError, match=f"seed {seed}: give at"):
            Comparison(PAPER.problem, seed=seed, seeds=seeds)
    with pytest.raises(UserError, match=r"larger than the bin \(4, 1, 4\)"):
        grid_cells(PAPER.problem, [10], [12, 4], [(1, 5)])
    with pytest.raises(UserError, match="unknown method"):
        make_method("best-of-x", PAPER.problem, MethodOptions())
    pointer = MethodOptions(policy=load_policy("pointer-2d"))
    with pytest.raises(UserError, match="the policy given is of kind pointer"):
        make_method("bin-aware", PAPER.problem, pointer)
    with pytest.raises(UserError, match="the policy given is for 2D, the problem is 3D"):
        make_method("pointer", preset("paper-3d").problem, pointer)


def test_the_papers_row_stands_beside_ours_only_where_it_belongs(tmp_path):
    method = make_method("volume", PAPER.problem, MethodOptions())
    comparison = Comparison(PAPER.problem, instances=5, batch=5)
    other = Cell(PAPER.problem.bin, Distribution(20, 1, 5))
    papers, ours = compare(comparison, "volume", method, [CELL, other])
    assert paper_row(papers) == (0.894, 0.964, 4.307, 0.927)
    assert paper_row(ours) is None
    write_table(tmp_path / "table.txt", [papers])
    assert "0.894/0.964/4.307" in (tmp_path / "table.txt").read_text()
