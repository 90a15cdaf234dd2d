"""Orders of files as instances: evaluated on, and learned from."""

import json
from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import packer

from jaxpack import Cell, Comparison, MethodOptions, UserError, compare, make_method, preset
from jaxpack.evaluate import main as evaluate
from jaxpack.io.jobs import read_job
from jaxpack.io.order_files import read_again
from jaxpack.io.runs import RunConfig, create_run, read_policy, read_run
from jaxpack.learning.bin_aware import BinAwareConfig
from jaxpack.model.encoding import Genes, load_job, padded_genes
from jaxpack.model.instances import sample
from jaxpack.model.metrics import bins_used
from jaxpack.orders import order_instances
from jaxpack.search.heuristics import footprint_order, height_order, volume_order
from jaxpack.search.packer import encode, pack_lanes
from jaxpack.train import TrainOptions, start_or_resume
from jaxpack.training import train_run

GIVEN = {"items": None, "bin": None, "sides": None}
ORDERS = """ORDER,X,Y,Z,COPIES,ROTATION_XYZ,ROTATION_YXZ,ROTATION_ZXY
a,300,200,150,4,1,1,1
b,250,225,200,2,1,0,0
a,200,150,100,7,0,1,0
b,155,105,95,9,1,1,1
c,390,290,100,1,1,0,0
c,120,395,30,4,1,1,0
"""
SHEETS = "ORDER,WIDTH,HEIGHT,COPIES,ORIENTED\n" + "".join(
    f"{order},{wide},{high},3,0\n{order},{high},{wide + 7},2,1\n"
    for order, wide, high in (("p", 25, 40), ("q", 61, 33), ("r", 90, 12), ("s", 47, 58))
)


def given(folder, table, other, **options):
    """What a command line says that names these tables."""
    paths = {}
    for name, text in (("orders", table), ("bins", other)):
        paths[name] = folder / f"{name}.csv"
        paths[name].write_text(text)
    rest = {"bin_type": "", "ignore": (), "skip_unfit": False}
    return SimpleNamespace(**(GIVEN | rest | paths | options))


@pytest.fixture
def boxes(tmp_path):
    return given(tmp_path, ORDERS, "X,Y,Z,NAME\n400,300,250,carton\n")


@pytest.fixture
def sheets(tmp_path):
    return given(tmp_path, SHEETS, "WIDTH,HEIGHT\n100,100\n")


def instances_of(orders, count=None):
    indices = jnp.arange(count or orders.count)
    one = jax.vmap(
        lambda i: orders.make(
            orders.problem(), orders.items, jax.random.key(0), i, orders.numbers, orders.bin
        )
    )
    return one(indices)


@pytest.mark.long
def test_every_sort_packs_an_order_as_the_job_is_packed(boxes):
    orders = order_instances(boxes)
    assert (orders.count, orders.items, orders.bin) == (3, 11, (80, 60, 50))
    instances = instances_of(orders)
    jobs = read_job(boxes.orders, boxes.bins, by_order=True)
    assert [job.name for job in jobs] == ["a", "b", "c"]
    for sort in (volume_order, footprint_order, height_order):
        order = jax.vmap(sort)(instances)
        packings = packer(orders.problem())(instances, order)
        for number, job in enumerate(jobs):
            loading, count = load_job(job), job.count
            decoding, stock = encode(loading)
            own = np.asarray(order[number][:count])
            genes = Genes(own, np.zeros(count, np.int32), np.arange(count, dtype=np.int32))
            lane = padded_genes(genes, len(stock.mask), len(stock.price))
            bin, corner = pack_lanes(decoding, stock, Genes(*(part[None] for part in lane)))
            np.testing.assert_array_equal(packings.bin[number][:count], bin[0, :count])
            np.testing.assert_array_equal(
                packings.position[number][:count] * 5, corner[0, :count] * int(loading.units.length)
            )


def test_an_instance_has_what_its_order_has(boxes):
    orders = order_instances(boxes)
    instances = instances_of(orders)
    np.testing.assert_array_equal(instances.mask.sum(1), [11, 11, 5])
    assert orders.kinds(orders.problem()) == 2
    # Of b: what may not be turned is there as often as there are orientations.
    np.testing.assert_array_equal(instances.turned[1, 0], [[50, 45, 40]] * 6)
    assert {tuple(way) for way in instances.turned[1, 2].tolist()} == {
        (31, 21, 19), (21, 31, 19), (19, 31, 21)}  # fmt: skip
    drawn = sample(orders.problem(), orders, jax.random.key(1), 40)
    numbers = set(drawn.mask.sum(1).tolist())
    assert numbers == {5, 11}


@pytest.mark.long
@pytest.mark.parametrize("method", ["brkga", "bin-aware-best-of-2", "bin-aware-search"])
def test_methods_pack_orders_by_the_rules(method, sheets):
    orders = order_instances(sheets)
    problem, cell = orders.problem(), Cell(orders.bin, orders)
    options = MethodOptions(shipped="bin-aware-2d-turned", width=2, draws=2, rounds=1)
    options = replace(options, brkga=replace(options.brkga, population=8, generations=2))
    comparison = Comparison(problem, orders.count, batch=orders.count)
    (row,) = compare(comparison, method, make_method(method, problem, options), [cell])
    assert (row.instances, row.items, row.bin) == (4, 5, (100, 1, 100))
    assert row.lower_bound <= row.bins <= 3
    assert 0 < row.compactness <= row.pyramid <= 1


def test_a_policy_turns_what_may_be_turned(sheets):
    orders = order_instances(sheets)
    problem, instances = orders.problem(), instances_of(orders)
    method = make_method("bin-aware", problem, MethodOptions(shipped="bin-aware-2d-turned"))
    keys = jax.random.split(jax.random.key(0), orders.count)
    decided = jax.jit(method.orders)(keys, instances)
    assert (np.asarray(decided.orientation) > 0).any()


def recipe_of(orders):
    network = BinAwareConfig(hidden=4, sees="placement")
    sizes = {"train_instances": 16, "valid_instances": 4, "batch": 4, "samples": 2}
    recipe = preset("bin-aware-2d")
    return replace(recipe, problem=orders.problem(), distribution=orders, policy=network, **sizes)


@pytest.mark.long
def test_a_run_learns_from_orders_and_goes_on_while_they_are_the_same(sheets, tmp_path):
    orders, run, other = order_instances(sheets), tmp_path / "run", tmp_path / "other"
    config = RunConfig("bin-aware-2d", 1, recipe_of(orders), chunk=2, checkpoint_every=4)
    for path in (run, other):
        create_run(path, config)
    list(train_run(other, config))
    first = next(iter(train_run(run, config, stop=lambda: True)))
    assert first["update"] == 2
    # Whoever uses the policy needs no orders, but who goes on does.
    kept = read_run(run).train
    assert kept == config.train
    assert kept.distribution.count == 0
    path, again, _ = start_or_resume(TrainOptions(resume=run))
    assert again.train.distribution.count == 4
    list(train_run(path, again))
    jax.tree.map(np.testing.assert_array_equal, read_policy(run).params, read_policy(other).params)
    sheets.orders.write_text(SHEETS.replace("61", "62"))
    with pytest.raises(UserError, match=r"orders\.csv: the orders, or their bin, are not what"):
        start_or_resume(TrainOptions(resume=run))
    sheets.orders.unlink()
    with pytest.raises(UserError, match=r"orders\.csv"):
        read_again(kept.distribution)


def test_the_command_evaluates_all_orders_or_says_how_many_there_are(sheets, capsys):
    files = ["--orders", str(sheets.orders), "--bins", str(sheets.bins), "--methods", "height"]
    table = sheets.orders.with_name("rows.json")
    evaluate([*files, "--json", str(table)])
    (row,) = json.loads(table.read_text())
    assert (row["instances"], row["items"], row["bin"]) == (4, 5, [100, 1, 100])
    with pytest.raises(UserError, match="--instances 5: there are 4 orders"):
        evaluate([*files, "--instances", "5"])


CARTONS = "X,Y,Z,NAME,COPIES,MAXIMUM_WEIGHT\n400,300,250,small,-1,\n500,300,250,large,-1,20\n"
HEAVY = "ORDER,X,Y,Z,WEIGHT\na,450,100,100,1\nb,100,100,100,1\n"


@pytest.mark.parametrize(
    ("orders", "bins", "options", "message"),
    [
        (HEAVY, CARTONS, {}, "2 types of bins.*choose small or large with --bin-type"),
        (HEAVY, CARTONS, {"bin_type": "huge"}, "--bin-type 'huge': .* has small or large"),
        (HEAVY, CARTONS, {"bin_type": "small"}, r"orders.csv: order 'a': row 2: no bin can hold"),
        (HEAVY, CARTONS, {"bin_type": "3"}, "MAXIMUM_WEIGHT.*--ignore MAXIMUM_WEIGHT"),
        (HEAVY, "X,Y,Z,COPIES\n500,300,250,3\n", {}, "COPIES 3.*--ignore COPIES"),
        (HEAVY, "X,Y,Z\n500,300,250.01\n", {}, "in units of 0.01.*coarser unit"),
        (HEAVY.replace("b,", ","), CARTONS, {}, "row 3, column ORDER: empty"),
        (HEAVY, CARTONS, {"bin": 8}, "--bin: does not go with --orders"),
        (HEAVY, CARTONS, {"orders": None}, "--bins: goes with --orders only"),
    ],
)
def test_what_orders_cannot_be_as_instances_is_said(orders, bins, options, message, tmp_path):
    with pytest.raises(UserError, match=message):
        order_instances(given(tmp_path, orders, bins, **options))


def test_items_that_do_not_fit_may_be_left_out_and_other_types_of_bins_not_used(tmp_path, capsys):
    options = given(tmp_path, HEAVY, CARTONS, bin_type="small", skip_unfit=True)
    orders = order_instances(options)
    assert (orders.count, orders.items, orders.bin) == (1, 1, (8, 6, 5))
    assert "1 items that the bin cannot hold are left out" in capsys.readouterr().err
    large = replace(orders.files, bin_type="large")
    assert orders != replace(orders, files=large)


def test_a_table_without_orders_is_one(tmp_path):
    options = given(tmp_path, "X,Y,Z,COPIES\n10,10,10,9\n", "X,Y,Z\n40,20,10\n")
    orders = order_instances(options)
    packing = packer(orders.problem())(instances_of(orders), jnp.arange(9)[None])
    assert jax.vmap(bins_used)(packing).tolist() == [2]
