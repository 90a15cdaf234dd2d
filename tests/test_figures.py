"""What a plan amounts to: exact, however many items it has, and in what order plans are better."""

import math
import random
import time
from fractions import Fraction
from itertools import pairwise

import pytest

from jaxpack.model.exact import exact
from jaxpack.model.figures import (
    PlanFigures,
    fill,
    plan_figures,
    total_cost,
)
from jaxpack.model.job import BinType, ItemType, Job, PackedBin, Placement, Plan
from jaxpack.model.objectives import objective_of


def plan_worth(job, plan):
    return objective_of(job).worth(job, plan)


def minimised(job):
    return objective_of(job).minimised


def plan_of(*bins, left_out=()):
    """A plan of (bin type, items)."""
    corner = (0.0, 0.0, 0.0)
    return Plan(
        tuple(
            PackedBin(kind, tuple(Placement(item, "XYZ", corner) for item in items))
            for kind, items in bins
        ),
        left_out,
    )


def volume(size):
    return math.prod(map(exact, size))


@pytest.mark.parametrize("dimension", [2, 3])
def test_figures_are_those_of_fractions(dimension):
    rng = random.Random(dimension)

    def size(most):
        digits = rng.choice((0, 1, 3))
        sides = [round(rng.uniform(1, most), digits) for _ in range(3)]
        return (sides[0], 1 if dimension == 2 else sides[1], sides[2])

    for _ in range(100):
        items = tuple(ItemType(size(50), 9, round(rng.uniform(0, 99), 3)) for _ in range(20))
        kinds = tuple(
            BinType(size(1000), rng.choice((None, round(rng.uniform(0, 9), 2)))) for _ in range(3)
        )
        job = Job(items, kinds, dimension)
        bins = [(rng.randrange(3), rng.choices(range(20), k=rng.randint(1, 9))) for _ in range(4)]
        plan = plan_of(*bins, left_out=(0, 3))
        inside = [sum(volume(job.items[item].size) for item in held) for _, held in bins]
        rooms = [volume(job.bins[kind].size) for kind, _ in bins]
        cost = sum(job.bins[kind].price_of() for kind, _ in bins)
        weight = sum(exact(job.items[item].weight) for _, held in bins for item in held)
        figures = plan_figures(job, plan)
        assert figures == PlanFigures(
            4,
            pytest.approx(float(sum(inside) / sum(rooms)), rel=1e-12),
            pytest.approx(float(weight), rel=1e-12),
            pytest.approx(float(cost), rel=1e-12),
            2,
        )
        assert total_cost(job, plan) == figures.cost
        for packed, held, room in zip(plan.bins, inside, rooms, strict=True):
            assert fill(job, packed) == pytest.approx(float(held / room), rel=1e-12)
        assert plan_worth(job, plan) == (2, *([cost] if job.priced else []), 4, sum(rooms))


def test_a_full_bin_is_full():
    """In floats, 3 x 0.1 x 0.1 x 0.1 are not 0.3 x 0.1 x 0.1."""
    job = Job((ItemType((0.1, 0.1, 0.1), 3),), (BinType((0.3, 0.1, 0.1)),))
    plan = plan_of((0, [0, 0, 0]))
    assert fill(job, plan.bins[0]) == plan_figures(job, plan).utilisation == 1


def test_no_bins():
    job = Job((ItemType((1, 1, 1), 3),), (BinType((1, 1, 1), cost=2),))
    assert plan_figures(job, Plan((), (0, 0, 0))) == PlanFigures(0, 0.0, 0.0, 0.0, 3)
    assert plan_worth(job, Plan((), (0, 0, 0))) == (3, 0, 0, 0)


def test_many_items_take_no_time():
    """100,000 items of 5,000 rows, in 2,000 bins."""
    rng = random.Random(0)

    def size():
        return tuple(rng.randint(10**6, 5 * 10**6) / 1000 for _ in range(3))

    items = tuple(ItemType(size(), 20, rng.randint(1, 10**6) / 1000) for _ in range(5000))
    job = Job(items, (BinType((9999.999, 9999.999, 9999.999)),))
    held = [(0, range(first, first + 50)) for first in range(0, 5000, 50)]
    plan = plan_of(*held * 20)
    for figure in (plan_figures, plan_worth, total_cost):
        begun = time.thread_time()
        figure(job, plan)
        assert time.thread_time() - begun < 0.5
    begun = time.thread_time()
    assert all(fill(job, packed) > 0 for packed in plan.bins)
    assert time.thread_time() - begun < 2


def test_without_cost_the_fewest_bins_are_best_then_the_smallest():
    bins = (BinType((2, 2, 2)), BinType((5, 5, 5)), BinType((4, 4, 4)))
    job = Job((ItemType((1, 1, 1), 9),), bins)
    plans = [
        plan_of((2, [0] * 9)),
        plan_of((1, [0] * 9)),
        plan_of((0, [0] * 8), (0, [0])),
        plan_of((0, [0] * 8), left_out=(0,)),
    ]
    worths = [plan_worth(job, plan) for plan in plans]
    assert all(better < worse for better, worse in pairwise(worths))
    assert minimised(job) == "fewest bins, then the least volume of bins"


def test_with_cost_the_cheapest_bins_are_best_then_the_fewest_then_the_smallest():
    bins = (
        BinType((2, 2, 2), cost=0.1),
        BinType((5, 5, 5), cost=0.3),
        BinType((4, 4, 4), cost=0.3),
        BinType((9, 9, 9), cost=0.2),
    )
    job = Job((ItemType((1, 1, 1), 9),), bins)
    plans = [
        plan_of((3, [0] * 9)),
        plan_of((2, [0] * 9)),
        plan_of((1, [0] * 9)),
        plan_of((0, [0] * 3), (0, [0] * 3), (0, [0] * 3)),  # 0.1 + 0.1 + 0.1 is 0.3 here
        plan_of((2, [0] * 8), (0, [0])),
        plan_of((0, [0] * 8), left_out=(0,)),
    ]
    worths = [plan_worth(job, plan) for plan in plans]
    assert all(better < worse for better, worse in pairwise(worths))
    assert plan_worth(job, plans[3])[1] == Fraction(3, 10)
    assert minimised(job) == "least cost, then the fewest bins, then the least volume of bins"
