"""A rule, a method and an objective from outside the package: the lines of CONTRIBUTING."""

import re
from pathlib import Path

import jax
import pytest

import jaxpack
from jaxpack.methods import SORTS
from jaxpack.model.objectives import OBJECTIVES
from jaxpack.packing.rules import RULES

TEXT = (Path(__file__).parent.parent / "CONTRIBUTING.md").read_text()
BLOCKS = re.findall(r"^```python\n(.*?)^```$", TEXT, re.DOTALL | re.MULTILINE)
BIN = (10, 1, 10)


TABLES = (RULES, SORTS, OBJECTIVES)


@pytest.fixture(autouse=True)
def _added():
    before = [dict(table) for table in TABLES]
    assert len(BLOCKS) == 3
    for block in BLOCKS:
        assert block.count("\n") < 80
        exec(compile(block, "CONTRIBUTING.md", "exec"), {})
    yield
    for table, entries in zip(TABLES, before, strict=True):
        table.clear()
        table.update(entries)


def test_a_rule_packs():
    sizes = [(4, 3), (4, 5), (6, 7)]
    corners = {}
    for rule in ("lowest", "leftmost"):
        problem = jaxpack.Problem(bin=BIN, rule=rule)
        instance = jaxpack.make_instance(problem, sizes)
        order = jax.numpy.arange(3)
        packing = jaxpack.pack(problem, instance, order)
        jaxpack.check_packings(problem, instance, order, packing)
        corners[rule] = packing.position.tolist()
    assert corners["lowest"] == [[0, 0, 0], [4, 0, 0], [0, 0, 0]]
    assert corners["leftmost"] == [[0, 0, 0], [0, 0, 3], [4, 0, 0]]


def test_a_method_makes_orders():
    problem = jaxpack.Problem(bin=BIN)
    instance = jaxpack.make_instance(problem, [(1, 2), (5, 1), (2, 3), (1, 5)])
    batch = jax.tree.map(lambda leaf: leaf[None], instance)
    method = jaxpack.make_method("longest", problem, jaxpack.MethodOptions())
    keys = jax.random.split(jax.random.key(0), 1)
    assert method.orders(keys, batch).tolist() == [[1, 3, 2, 0]]


def test_an_objective_is_what_a_plan_is_for():
    items = {"X": [1], "Y": [1], "Z": [1], "COPIES": [8]}
    bins = {"X": [2, 1], "Y": [2, 2], "Z": [2, 2], "COST": [9, 1]}
    cheap = jaxpack.solve(items, bins, time_limit=5)
    few = jaxpack.solve(items, bins, time_limit=5, objective="drivers")
    assert (cheap.figures.bins, cheap.figures.cost) == (2, 2)
    assert (few.figures.bins, few.figures.cost) == (1, 9)
    assert few.gap == 0
