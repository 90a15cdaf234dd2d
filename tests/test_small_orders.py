"""Small orders that people asked packers about: each comes out right, in so many packings."""

import importlib.util
import sys
from pathlib import Path

import pytest

from jaxpack.search.portfolio import SolveOptions, solve_job

SCRIPT = Path(__file__).parents[1] / "experiments" / "small_orders.py"
PACKINGS = 200
MORE = {"a container's worth": 6, "weights alone": 2000}
"""Packings of those that take other numbers of them: one of a best subset is a beam."""


def table():
    spec = importlib.util.spec_from_file_location("small_orders", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules["small_orders"] = module
    spec.loader.exec_module(module)
    return module.orders()


ORDERS = table()


MARKS = {
    "two kinds of pieces on a sheet": pytest.mark.long,  # ten seeds
    **dict.fromkeys(MORE, pytest.mark.slow),
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=MARKS.get(name, ())) for name in ORDERS])
def test_it_comes_out_right(name):
    order = ORDERS[name]
    for seed in order.seeds:
        found = solve_job(order.job, SolveOptions(None, seed, packings=MORE.get(name, PACKINGS)))
        assert order.right(found), f"{order.wanted} wanted: {order.got(found)}"
