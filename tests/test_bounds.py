"""Bounds: never above the optimum, as high as can be proved, and soon found."""

import math
import random
import time
import tracemalloc
from dataclasses import replace
from fractions import Fraction

import pytest
from optimum import optimum

import jaxpack
from jaxpack.model.bounds import volume_bound
from jaxpack.model.job import ORIENTATIONS, UPRIGHT, BinType, ItemType, Job, PackedBin, Plan
from jaxpack.model.limits import ItemLimits
from jaxpack.model.objectives import bounds, gap, objective_of

ANY = tuple(ORIENTATIONS)
AS_GIVEN = ("XYZ",)
FREE = (UPRIGHT, ANY, AS_GIVEN)
FLAT = (AS_GIVEN, ("XYZ", "ZYX"))


def job_of(bin, *sizes, copies=1, ways=ANY, dimension=3):
    items = tuple(ItemType(size, copies, orientations=ways) for size in sizes)
    return Job(items, (BinType(bin),), dimension)


@pytest.mark.parametrize(
    ("job", "by_volume", "bins"),
    [
        (job_of((320, 490, 290), (330, 88, 88), copies=17), 1, 2),
        (job_of((320, 490, 290), (88, 330, 88), copies=17, ways=AS_GIVEN), 1, 2),
        (job_of((282, 222, 190), (213, 187, 180), (217, 170, 78), (129, 102, 71)), 1, 2),
        (
            job_of(
                (236, 1, 1190),
                *((115, 1, length) for length in (300, 330, 360)),
                copies=12,
                ways=FLAT[1],
                dimension=2,
            ),
            5,
            6,
        ),
        (
            job_of(
                (1190, 236, 40), *((n, 115, 40) for n in (300, 330, 360)), copies=12, ways=UPRIGHT
            ),
            5,
            6,
        ),
        # 115.5 + 120.6 are 0.1 too long for 236; of 80 two fit, not four.
        (job_of((236, 10, 10), (115.5, 10, 10), (120.6, 10, 10), ways=AS_GIVEN), 2, 2),
        (job_of((236.1, 10, 10), (115.5, 10, 10), (120.6, 10, 10), ways=AS_GIVEN), 1, 1),
        (job_of((236, 10, 10), (80, 10, 10), copies=4, ways=AS_GIVEN), 2, 2),
    ],
)
def test_what_is_provable_is_proved(job, by_volume, bins):
    assert (volume_bound(job), bounds(job).bins) == (by_volume, bins)


def tiny_job(rng):
    dimension = rng.choice((2, 3))
    largest = 5 if dimension == 3 else 9
    heavy, priced = rng.random() < 0.4, rng.random() < 0.5

    def size(low, high):
        width = rng.randint(low, high) if dimension == 3 else 1
        return rng.randint(low, high), width, rng.randint(low, high)

    bins = tuple(
        BinType(
            size(2, largest),
            cost=rng.choice((None, rng.randint(0, 20), rng.randint(1, 9))) if priced else None,
            copies=rng.choice((None, None, 0, 1, 2)),
            max_weight=rng.choice((math.inf, rng.randint(0, 20))) if heavy else math.inf,
        )
        for _ in range(rng.choice((1, 1, 2, 3)))
    )
    items = tuple(
        ItemType(
            size(1, largest - 1),
            weight=rng.randint(0, 9) if heavy else 0,
            orientations=rng.choice(FREE if dimension == 3 else FLAT),
        )
        for _ in range(rng.randint(2, 5))
    )
    return Job(items, bins, dimension)


@pytest.mark.parametrize("seed", range(8))
def test_bounds_are_never_above_the_optimum_and_mostly_reach_it(seed):
    rng, reached, solved = random.Random(seed), 0, 0
    for _ in range(200):
        job = tiny_job(rng)
        best, unfit = optimum(job)
        found = bounds(job)
        assert found.unfit == unfit
        if best is None:  # too few bins
            continue
        bins, cost, worth = best
        assert found.bins <= bins, job
        assert found.cost <= cost, job
        assert found.worth <= (unfit, *worth), job
        solved, reached = solved + 1, reached + (found.worth == (unfit, *worth))
    assert solved > 100
    assert reached > 0.85 * solved


def pieces(rng, box, number, axes):
    """A box of whole sides sawn so many times, straight through what is long enough."""
    parts = [box]
    for _ in range(number):
        part = parts.pop(rng.randrange(len(parts)))
        axis = rng.choice(axes)
        if part[axis] == 1:
            parts.append(part)
            continue
        cut = rng.randint(1, part[axis] - 1)
        parts += [(*part[:axis], length, *part[axis + 1 :]) for length in (cut, part[axis] - cut)]
    return parts


def split(rng, total, number):
    """Whole numbers that come to the total."""
    cuts = sorted(rng.randint(0, total) for _ in range(number - 1))
    return [high - low for low, high in zip([0, *cuts], [*cuts, total], strict=True)]


@pytest.mark.parametrize("seed", range(6))
def test_bounds_are_never_above_bins_sawn_into_items(seed):
    """Up to 2^30 thousandths a side, full to the last, of volume and of weight."""

    def lengths(sides):
        return tuple(side / 1000 if axis in axes else 1 for axis, side in enumerate(sides))

    rng = random.Random(seed)
    for _ in range(25):
        dimension = rng.choice((2, 3))
        axes = (0, 2) if dimension == 2 else (0, 1, 2)
        finest = rng.choice((12, 1000, 10**6, 2**30))
        limit = rng.choice((math.inf, 10**9, 1000))
        ways = FLAT if dimension == 2 else FREE
        items, kinds, cost, used = [], [], 0, 0
        for _ in range(rng.choice((1, 1, 3))):
            box = tuple(rng.randint(6, finest) if axis in axes else 1 for axis in range(3))
            copies = rng.randint(1, 6)
            kinds.append(
                BinType(lengths(box), rng.randint(1, 99), rng.choice((copies, None)), limit)
            )
            cost, used = cost + copies * kinds[-1].cost, used + copies
            for _ in range(copies):
                parts = pieces(rng, box, rng.randint(1, 40), axes)
                weights = split(rng, 0 if limit == math.inf else limit, len(parts))
                for part, weight in zip(parts, weights, strict=True):
                    way = rng.choice(rng.choice(ways))
                    # Given so that it is turned like that in the plan.
                    given = tuple(part[ORIENTATIONS[way].index(side)] for side in range(3))
                    allowed = {way, *rng.choice(ways)}
                    items.append(ItemType(lengths(given), 1, weight, tuple(allowed)))
        job = Job(tuple(items), tuple(kinds), dimension)
        found = bounds(job)
        assert found.unfit == 0
        assert found.bins <= used
        assert found.cost <= cost
        if len(kinds) == 1:
            assert (found.bins, found.cost) == (used, cost)


def test_an_item_that_fits_the_dear_bin_alone():
    """The large one needs a bin of 50; beside it are 7 of the small ones, no more by volume."""
    bins = (BinType((10, 10, 10), cost=50), BinType((4, 4, 4), cost=1, copies=3))
    job = Job((ItemType((5, 5, 5)), ItemType((4, 4, 4), copies=10)), bins)
    found = bounds(job)
    assert (found.bins, found.cost) == (2, 53)
    assert bounds(Job(job.items[:1], bins)).cost == 50
    assert bounds(Job(job.items[1:], bins)).cost == 52  # eight in the truck


def test_weights_of_several_bins():
    """A bin without limit may be there: the cheap ones have one."""
    bins = (BinType((9, 9, 9), cost=10, max_weight=100), BinType((9, 9, 9), cost=35))
    job = Job((ItemType((1, 1, 1), 7, weight=40),), bins)
    found = bounds(job)
    assert (found.bins, found.cost) == (1, 35)
    assert bounds(Job((ItemType((1, 1, 1), 6, weight=40),), bins)).cost == 30


def test_a_bin_holds_a_whole_number_of_equal_items():
    """Six by volume, not 6.7; eight by weight, not 8.5."""
    book = ItemType((5, 6, 3), 50, 1.0, ANY)
    narrow, large = BinType((5, 6, 20), 1.0), BinType((10, 10, 20), 1.0, max_weight=8.5)
    assert bounds(Job((book,), (narrow,))).bins == 9
    assert bounds(Job((book,), (narrow, large))).bins == 7
    assert bounds(Job((replace(book, copies=6),), (narrow, large))).bins == 1


@pytest.mark.parametrize(("light", "bins"), [(1e-9, 2), (0, 1)])
def test_a_weight_that_is_a_billionth_too_much(light, bins):
    """1e9 + 1e-9 is 1e9 in floats."""
    box = BinType((2, 2, 2), max_weight=1e9)
    items = (ItemType((1, 1, 1), weight=1e9), ItemType((1, 1, 1), weight=light))
    assert bounds(Job(items, (box,))).bins == bins


def test_what_is_out_of_stock_holds_nothing():
    job = Job(
        (ItemType((5, 5, 5)), ItemType((2, 2, 2), 3)),
        (BinType((9, 9, 9), copies=0), BinType((2, 2, 4))),
    )
    found = bounds(job)
    assert (found.bins, found.unfit, found.worth) == (2, 1, (1, 2, 32))


def reached(job, plan):
    return objective_of(job).worth(job, plan) <= bounds(job).worth


def packed(*kinds, left_out=()):
    return Plan(tuple(PackedBin(kind, ()) for kind in kinds), left_out)


def test_a_plan_is_at_its_bound_when_nothing_is_left_to_win():
    alike = (BinType((9, 9, 9), cost=5), BinType((6, 6, 6), cost=5), BinType((3, 3, 3), cost=1))
    job = Job((ItemType((6, 6, 6)), ItemType((12, 1, 1))), alike)
    assert reached(job, packed(1, left_out=(1,)))
    assert not reached(job, packed(0, left_out=(1,)))  # of equal price, but larger
    assert not reached(job, packed(left_out=(0, 1)))
    # Eight boxes or one for the same price in sum.
    bins = (BinType((1, 1, 1), cost=1), BinType((2, 2, 2), cost=8))
    job = Job((ItemType((1, 1, 1), 8),), bins)
    assert reached(job, packed(1))
    assert not reached(job, packed(*[0] * 8))
    free = Job(job.items, tuple(BinType(kind.size) for kind in bins))
    assert reached(free, packed(1))
    assert not reached(free, packed(0, 1))


def test_the_gap_is_of_what_is_minimised():
    items = (ItemType((5, 5, 5), 3), ItemType((20, 1, 1), 2))
    free = Job(items, (BinType((5, 5, 5)), BinType((5, 5, 10))))
    priced = Job(items, (BinType((5, 5, 5), cost=2), BinType((5, 5, 10), cost=3)))
    for job, least in ((free, 2), (priced, 5)):
        found = bounds(job)
        assert (found.cost if job.priced else found.bins) == least
        assert found.best == least
        assert gap(job, packed(0, 1, left_out=(1, 1)), found) == 0
        assert gap(job, packed(0, 1, left_out=(1, 1, 0)), found) is None
    assert gap(free, packed(0, 0, 0, left_out=(1, 1)), bounds(free)) == 0.5
    three = packed(0, 0, 0, left_out=(1, 1))
    assert gap(priced, three, bounds(priced)) == pytest.approx(0.2)
    assert gap(priced, three, replace(bounds(priced), best=6.000000001)) == 0
    nothing = Job(items, (BinType((5, 5, 5), cost=0), BinType((5, 5, 5), cost=1)))
    assert gap(nothing, packed(0, 0, 0, left_out=(1, 1)), bounds(nothing)) == 0
    assert gap(nothing, packed(0, 0, 1, left_out=(1, 1)), bounds(nothing)) == math.inf


@pytest.mark.parametrize("kinds", [1, 5, 60])
@pytest.mark.parametrize("ways", [ANY, AS_GIVEN])
def test_many_rows_take_no_time_and_no_room(ways, kinds):
    """100,000 items in 4,000 rows of seven digits: 54 s and 2 GB it was."""
    rng = random.Random(0)

    def sides(most):
        return tuple(rng.randint(10**6, most) / 1000 for _ in range(3))

    items = tuple(
        ItemType(sides(5 * 10**6), 25, rng.randint(1, 10**7) / 1000, ways) for _ in range(4000)
    )
    bins = (
        BinType((9999.999 - 2 * n, 9999.999, 9999.999 - n), 100 + n, None, 99999.0)
        for n in range(kinds)
    )
    job = Job(items, tuple(bins))
    begun = time.thread_time()
    found = bounds(job)
    assert time.thread_time() - begun < 1
    assert found.bins >= volume_bound(job) > 2000
    tracemalloc.start()
    bounds(job)
    assert tracemalloc.get_traced_memory()[1] < 200 * 2**20
    tracemalloc.stop()


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_has_to_stand_on_the_floor_is_not_above_each_other(dimension):
    wide, depth = (6, 1, 1) if dimension == 2 else (6, 6, 1), (1, 10)[dimension == 3]
    floor, bins = ItemLimits(floor=True), (BinType((10, depth, 10), cost=3), BinType((5, depth, 9)))
    items = ItemType(wide, 5, orientations=AS_GIVEN, limits=floor), ItemType((1, 1, 1), 9)
    job = Job(items, bins, dimension)
    assert bounds(job).bins == 5
    assert bounds(job).cost == 15
    without = replace(job, items=(replace(items[0], limits=ItemLimits()), items[1]))
    assert bounds(without).bins == 1


@pytest.mark.parametrize("seed", range(12))
def test_no_plan_has_fewer_bins_than_its_floor_allows(seed):
    rng = random.Random(seed)
    items = tuple(
        ItemType(
            tuple(rng.randint(1, 5) for _ in "XYZ"),
            rng.randint(1, 3),
            orientations=rng.choice(FREE),
            limits=ItemLimits(floor=rng.random() < 0.7),
        )
        for _ in range(6)
    )
    job = Job(items, (BinType((8, 7, 12)), BinType((6, 6, 6))))
    found = jaxpack.solve(job, packings=20, seed=seed)
    assert bounds(job).bins <= len(found.plan.bins)
    assert not jaxpack.check_plan(job, found.plan)


def test_a_bound_in_no_time_is_a_bound():
    job = job_of((282, 222, 190), (213, 187, 180), (217, 170, 78), (129, 102, 71))
    assert bounds(job, seconds=0).bins == 1
    assert bounds(job, seconds=60) == bounds(job)


def test_the_bound_of_what_a_plan_is_worth_is_exact():
    """2^30 units a side: volumes are beyond whole floats and int64."""
    side = 1073.741824
    job = Job((ItemType((side, side, side), 3),), (BinType((side, side, side)),))
    assert bounds(job).worth == objective_of(job).worth(job, packed(0, 0, 0))
    assert bounds(job).worth[2] == 3 * Fraction("1073.741824") ** 3
