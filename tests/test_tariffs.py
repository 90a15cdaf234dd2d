"""What bins cost by what is in them: against every way to split a few items over bins."""

import json
import math
from dataclasses import replace
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from job_files import assert_refused

import jaxpack
from jaxpack.io.jobs import job_from_columns
from jaxpack.io.plans import read_plan_json
from jaxpack.model.box_check import Rule
from jaxpack.model.exact import exact
from jaxpack.model.figures import total_cost
from jaxpack.model.job import BinType, ItemType, Job, PackedBin, Placement, Plan
from jaxpack.model.limits import ItemLimits
from jaxpack.model.objectives import OBJECTIVES, bounds, objective_of
from jaxpack.model.plan_check import plan_violations
from jaxpack.model.tariff import Tariff
from jaxpack.plan_tables import figures_of_one
from jaxpack.search.portfolio import SolveOptions, solve_job
from jaxpack.search.record import End
from jaxpack.solution import Status

ROOM = (10.0, 10.0, 10.0)  # more than all items need: only weights decide
PARCEL = Tariff(bands=((5, 4.99), (10, 6.99), (31.5, 12.49)))


@pytest.fixture(scope="module", autouse=True)
def _uncompiled():
    """The search in NumPy alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("jaxpack.search.portfolio.compiles", lambda loading: False)
        yield


def paid(kind, load):
    """What a bin costs with so much weight in it; None if it is not allowed."""
    tariff = kind.tariff
    if tariff is None:
        return exact(math.prod(kind.size)) if kind.cost is None else exact(kind.cost)
    billed = load + exact(tariff.own_weight)
    if tariff.divisor:
        x, y, z = map(exact, kind.size)
        billed = max(billed, x * y * z / exact(tariff.divisor))
    price = exact(kind.cost or 0) + exact(tariff.per_weight) * billed
    if not tariff.bands:
        return price
    allowed = [exact(each) for limit, each in tariff.bands if billed <= exact(limit)]
    return price + allowed[0] if allowed else None


def cheapest(job):
    """The least cost of all ways to split the items over bins; None if there is none."""
    weights = [exact(item.weight) for item in job.items for _ in range(item.copies)]
    stock = [len(weights) if kind.copies is None else kind.copies for kind in job.bins]
    known = {}

    def least(left, there):
        if not left:
            return Fraction(0)
        if (left, there) not in known:
            first, *rest = left
            found = []
            for mask in range(1 << len(rest)):
                some = [n for bit, n in enumerate(rest) if mask >> bit & 1]
                load = sum((weights[n] for n in some), weights[first])
                for number, kind in enumerate(job.bins):
                    if not there[number] or (price := paid(kind, load)) is None:
                        continue
                    fewer = tuple(n - (k == number) for k, n in enumerate(there))
                    after = least(tuple(n for n in rest if n not in some), fewer)
                    if after is not None:
                        found.append(price + after)
            known[left, there] = min(found, default=None)
        return known[left, there]

    return least(tuple(range(len(weights))), tuple(stock))


ANY = st.none()
numbers = st.integers(0, 40).map(lambda n: n / 4)
rising = st.lists(st.tuples(st.integers(1, 12), st.integers(0, 20)), min_size=1, max_size=3)


@st.composite
def tariffs(draw):
    weight, price, bands = 0, 0.0, []
    for more, dearer in draw(rising):
        weight, price = weight + more, price + dearer / 4
        bands.append((weight, price))
    return Tariff(
        bands=tuple(bands) if draw(st.booleans()) else (),
        per_weight=draw(st.sampled_from((0, 0, 0.25, 1.5))),
        divisor=draw(st.sampled_from((None, None, 1000, 250, 139))),
        own_weight=draw(st.sampled_from((0, 0, 0.5))),
    )


@st.composite
def jobs(draw, copies=ANY):
    kinds = []
    for _ in range(draw(st.integers(1, 2))):
        side = draw(st.sampled_from((10.0, 9.0, 12.0)))
        tariff = draw(st.none() | tariffs())
        if tariff and tariff.bands and side**3 / (tariff.divisor or 1e9) > tariff.bands[-1][0]:
            tariff = replace(tariff, divisor=None)
        cost = draw(numbers if tariff is None else st.none() | numbers)
        kinds.append(BinType((side,) * 3, cost, draw(copies), tariff=tariff))
    items = tuple(
        ItemType((1, 1, 1), draw(st.integers(1, 2)), weight=draw(numbers))
        for _ in range(draw(st.integers(1, 3)))
    )
    return Job(items, tuple(kinds), objective="price")


@settings(max_examples=300, deadline=None)
@given(jobs(st.none() | st.integers(1, 3)))
def test_no_plan_is_cheaper_than_the_bound(job):
    least = cheapest(job)
    if least is not None:
        assert bounds(job).worth[1] <= least
        assert bounds(replace(job, objective="bins")).cost <= float(least)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(jobs())
def test_the_plan_is_the_cheapest_one(job):
    least = cheapest(job)
    if least is None:
        assert_refused(lambda: solve_job(job), "is over the limit of every bin")
        return
    found = solve_job(job, SolveOptions(packings=300))
    assert sum(paid(job.bins[one.bin], weight_in(job, one)) for one in found.plan.bins) == least
    assert total_cost(job, found.plan) == float(least)


def weight_in(job, packed):
    return sum((exact(job.items[put.item].weight) for put in packed.placements), Fraction(0))


def parcels(weights, *kinds):
    """The plan that `solve` finds for cubes of these weights."""
    items = tuple(ItemType((1, 1, 1), weight=weight) for weight in weights)
    return jaxpack.solve(Job(items, kinds), packings=100)


def held(found):
    """What is in each bin, by weight: of each its type and the weights."""
    weights = [item.weight for item in found.job.items]
    bins = found.plan.bins
    return sorted((b.bin, *sorted(weights[put.item] for put in b.placements)) for b in bins)


def test_two_light_parcels_are_cheaper_than_a_heavy_one():
    found = parcels((4, 4, 4), BinType(ROOM, tariff=PARCEL))
    assert held(found) == [(0, 4), (0, 4, 4)]  # 11.98; all in one are 12.49
    assert (found.figures.cost, found.least_cost, found.gap) == (11.98, 11.98, 0)
    assert found.status is Status.OPTIMAL


def test_a_heavy_parcel_is_cheaper_than_two_light_ones():
    found = parcels((4, 4.5), BinType(ROOM, tariff=PARCEL))
    assert held(found) == [(0, 4, 4.5)]  # 6.99; two are 9.98
    assert (found.figures.cost, found.end) == (6.99, End.BOUND)
    # Each carton costs something too.
    found = parcels((4, 4.5, 4), BinType(ROOM, cost=0.6, tariff=PARCEL))
    assert held(found) == [(0, 4, 4, 4.5)]
    assert (found.figures.cost, found.end) == (13.09, End.BOUND)


def test_a_smaller_carton_is_cheaper_by_its_dimensional_weight():
    large, small = (40.0, 30.0, 20.0), (30.0, 20.0, 20.0)  # 24,000 and 12,000 cm3
    by_weight = Tariff(bands=((5, 4.99), (10, 6.99)))
    kinds = [
        BinType(size, cost=cost, tariff=by_weight) for size, cost in ((large, 0), (small, 0.5))
    ]
    assert held(parcels((2, 2), *kinds)) == [(0, 2, 2)]
    kinds = [replace(kind, tariff=replace(by_weight, divisor=4000)) for kind in kinds]
    found = parcels((2, 2), *kinds)  # 6 and 3 kg are billed
    assert held(found) == [(1, 2, 2)]
    assert found.figures.cost == 5.49
    by_rate = Tariff(per_weight=2, divisor=4000)
    found = parcels((2, 3), BinType(large, tariff=by_rate), BinType(small, tariff=by_rate))
    assert (held(found), found.figures.cost) == ([(1, 2, 3)], 10)


def test_the_weight_of_a_bin_counts():
    found = parcels((4, 1), BinType(ROOM, tariff=replace(PARCEL, own_weight=0.5)))
    assert held(found) == [(0, 1, 4)]
    assert found.figures.cost == 6.99
    assert found.job.bins[0].max_weight == 31


def test_few_bins_are_not_exceeded():
    few = BinType(ROOM, copies=2, tariff=PARCEL)
    found = parcels((5, 5, 5, 5), few)
    assert len(found.plan.bins) <= 2
    assert found.figures.cost <= 2 * 12.49
    assert found.status in (Status.OPTIMAL, Status.FEASIBLE)


def test_rules_and_tariffs_hold_together():
    apart = ItemLimits(apart="a")
    items = tuple(ItemType((1, 1, 1), weight=2, limits=apart) for _ in range(2))
    more = ItemType((1, 1, 1), weight=3), ItemType((1, 1, 1), weight=3)
    found = jaxpack.solve(Job((*items, *more), (BinType(ROOM, tariff=PARCEL),)), packings=100)
    assert held(found) == [(0, 2, 3), (0, 2, 3)]
    assert found.figures.cost == 9.98


def test_costs_of_other_objectives_are_by_load_too():
    job = Job((ItemType((1, 1, 1), 3, weight=4),), (BinType(ROOM, copies=1, tariff=PARCEL),))
    for objective in ("bins", "value", "height"):
        found = jaxpack.solve(replace(job, objective=objective), packings=5)
        assert (len(found.plan.bins), found.figures.cost) == (1, 12.49)


def test_a_bin_above_its_last_band_is_too_heavy():
    job = Job((ItemType((1, 1, 1), 8, weight=4),), (BinType(ROOM, tariff=PARCEL),))
    puts = tuple(Placement(0, "XYZ", (float(n), 0.0, 0.0)) for n in range(8))
    (found,) = plan_violations(job, Plan((PackedBin(0, puts),)))
    assert (found.rule, found.found, found.allowed) == (Rule.WEIGHT, 32, 31.5)
    light = Plan((PackedBin(0, puts[:7]), PackedBin(0, puts[7:])))
    assert not list(plan_violations(job, light))
    assert total_cost(job, light) == 17.48


GOODS = {"X": [1], "Y": [1], "Z": [1], "WEIGHT": [4], "COPIES": [2]}
SHELF = {"X": [30], "Y": [20], "Z": [20]}


def read(say=[].append, **columns):
    """The type of bins of a table with these cells."""
    more = {name: [cell] for name, cell in columns.items()}
    return job_from_columns(GOODS, SHELF | more, say=say).bins[0]


def test_tariffs_are_columns():
    kind = read(
        COST=0.5, BANDS=" 5:4.99  10:6.99 31.5:12.49", COST_PER_WEIGHT="0.1", DIVISOR=5000,
        OWN_WEIGHT=0.4,
    )  # fmt: skip
    assert kind.tariff == replace(PARCEL, per_weight=0.1, divisor=5000, own_weight=0.4)
    assert (kind.cost, kind.max_weight) == (0.5, 31.1)
    assert kind.price_of(Fraction(4)) == Fraction("5.93")
    assert kind.price_of(Fraction(10)) == Fraction("14.03")
    assert read(BANDS="", COST_PER_WEIGHT=-1, DIVISOR=None).tariff is None
    assert read(DIVISOR=5000).tariff == Tariff(divisor=5000)
    job = job_from_columns(GOODS, SHELF | {"BANDS": ["10:6.99"]})
    assert objective_of(job) is OBJECTIVES["price"]


def test_a_divisor_is_for_lengths_as_the_bins_have_them():
    millimetres = {"LENGTH (MM)": [10], "WIDTH (MM)": [10], "HEIGHT (MM)": [10]}
    centimetres = {"LENGTH (CM)": [30], "WIDTH (CM)": [20], "HEIGHT (CM)": [20]}
    rate = {"DIVISOR": [5000], "COST_PER_WEIGHT": [1]}
    kind = job_from_columns(millimetres, centimetres | rate).bins[0]
    assert kind.size == (300, 200, 200)
    assert kind.price_of() == Fraction("2.4")
    flat = {"WIDTH": [30], "HEIGHT": [20]} | {"DIVISOR": [100], "COST_PER_WEIGHT": [1]}
    kind = job_from_columns({"WIDTH": [3], "HEIGHT": [2]}, flat).bins[0]
    assert kind.price_of() == 6


@pytest.mark.parametrize(
    ("cells", "words"),
    [
        ({"BANDS": "5 10"}, ("row 0, column BANDS", "'5' is no band", "5:4.99")),
        ({"BANDS": 5}, ("column BANDS", "'5' is no band")),
        ({"BANDS": "five:4.99"}, ("column BANDS", "'five' is not a number")),
        ({"BANDS": "5:4,99"}, ("column BANDS", "'4,99' is not a number")),
        ({"BANDS": "5:"}, ("column BANDS", "empty")),
        ({"BANDS": "10:6.99 5:4.99"}, ("bands", "band 1 is not above the one before it")),
        ({"BANDS": "5:4.99 5:6.99"}, ("band 1 is not above",)),
        ({"BANDS": "5:4.99 10:3.99"}, ("band 1 is not above", "no price fall")),
        ({"BANDS": "-5:4.99"}, ("band 0, weight", "not a weight")),
        ({"BANDS": "5:-1"}, ("band 0, price", "not a cost")),
        ({"BANDS": "5:1", "DIVISOR": 1000}, ("12 is billed for an empty bin", "last band, 5")),
        ({"BANDS": "5:1", "OWN_WEIGHT": 6}, ("6 is billed for an empty bin",)),
        ({"BANDS": " ".join(f"{n}:{n}" for n in range(1, 300))}, ("299 of them", "at most 200")),
        ({"DIVISOR": 0}, ("divisor", "0: give")),
        ({"DIVISOR": "many"}, ("column DIVISOR", "'many' is not a number")),
        ({"COST_PER_WEIGHT": -2}, ("per_weight", "-2 is not a cost")),
        ({"OWN_WEIGHT": -2}, ("column OWN_WEIGHT", "not a weight")),
        ({"TARE": 1}, ("column TARE is not known", "is OWN_WEIGHT meant")),
        ({"COST_PER_WIEGHT": 1}, ("is COST_PER_WEIGHT meant",)),
    ],
)
def test_bad_cells_are_told(cells, words):
    assert_refused(lambda: read(**cells), *words)


@pytest.mark.parametrize(
    ("tariff", "words"),
    [
        (5, ("give Tariff",)),
        (Tariff(bands="5:1"), ("bands", "give a tuple")),
        (Tariff(bands=((5,),)), ("band 0", "give a weight and a price")),
        (Tariff(bands=((5, math.inf),)), ("band 0, price", "not a finite number")),
        (Tariff(per_weight=None), ("per_weight", "give a number")),
        (Tariff(divisor=math.nan), ("divisor", "not a finite number")),
    ],
)
def test_a_tariff_of_a_program_is_checked(tariff, words):
    items = (ItemType((1, 1, 1)),)
    assert_refused(lambda: Job(items, (BinType(ROOM, tariff=tariff),)), "bin 0", *words)


def test_an_open_bin_has_no_dimensional_weight():
    shelf = SHELF | {"Z": [-1], "DIVISOR": [5000]}
    assert_refused(lambda: job_from_columns(GOODS, shelf, objective="height"), "height is open")


def test_plans_in_files_say_what_each_bin_costs(tmp_path):
    found = parcels((4, 4.5, 4), BinType(ROOM, cost=0.1, tariff=PARCEL))
    found.write_json(tmp_path / "plan.json")
    bins = json.loads((tmp_path / "plan.json").read_text())["bins"]
    assert sorted(one["cost"] for one in bins) == [5.09, 7.09]
    assert bins[0]["tariff"] == {"bands": [[5, 4.99], [10, 6.99], [31.5, 12.49]]}
    assert figures_of_one(found)["cost"] == "12.18, at least 12.18"
    assert read_plan_json(tmp_path / "plan.json", found.job) == found.plan
