"""`pack` against the plain-Python packer, cell by cell, and how it composes with JAX."""

from operator import itemgetter

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest
from cases import packer, random_cases

from jaxpack.errors import UserError
from jaxpack.learning.presets import preset
from jaxpack.model.metrics import paper_cost
from jaxpack.model.packing_check import check_packings
from jaxpack.model.problem import Instance, Problem, make_instance
from jaxpack.packing.decode import MANY_ITEMS
from jaxpack.packing.first_fit import LANES, pack
from jaxpack.packing.height_map import empty_map, rest

SMALL_3D = Problem(bin=(4, 3, 5), support=0.5, inclusive=False)


def assert_equals_oracle(problem, support, instances, orders):
    packings = jax.tree.map(np.asarray, packer(problem)(instances, orders))
    for case in range(len(orders)):
        bin, sizes = instances.bin[case].tolist(), instances.size[case].tolist()
        bins, positions = oracle.pack(
            bin,
            sizes,
            orders[case].tolist(),
            support,
            problem.inclusive,
            problem.largest,
            instances.mask[case].tolist(),
        )
        expected = f"case {case}: bin {bin}, sizes {sizes}, order {orders[case].tolist()}"
        assert packings.bin[case].tolist() == bins, expected
        assert [tuple(corner) for corner in packings.position[case].tolist()] == positions, expected
        contents = oracle.bin_contents(bin, sizes, bins, positions)
        contents += [(0, 0, 0)] * (len(sizes) - len(contents))
        found = (packings.volume[case], packings.top[case], packings.shadow[case])
        assert list(zip(*(slots.tolist() for slots in found), strict=True)) == contents, expected


@pytest.mark.parametrize(
    ("bin", "largest", "support", "inclusive"),
    [
        ((6, 4, 7), None, (1, 2), True),
        ((6, 4, 7), None, (1, 2), False),
        ((6, 4, 7), None, (3, 10), True),
        ((10, 1, 6), (6, 1), (3, 10), False),
        ((6, 4, 7), None, (3, 4), False),
        ((3, 6, 5), (2, 4), (3, 4), True),
        ((6, 4, 7), None, (1, 1), False),  # "more than 100 %" is true nowhere: nothing fits
        ((16, 9, 4), (6, 5), (1, 1), True),  # int16 for the 144 cells of the plane
        ((3, 2, 130), None, (0, 1), True),  # int16 for the height
        ((1, 150, 8), (1, 40), (0, 1), False),
        ((2, 1, 126), None, (3, 4), True),  # the tallest bin with cells of int8
        ((100, 1, 8), (40, 1), (1, 2), True),  # int8, with walls at coordinates beyond 127
        ((130, 1, 8), None, (1, 2), True),  # a large window, put together from blocks
    ],
)
def test_pack_equals_the_oracle(bin, largest, support, inclusive):
    # Each row is one compiled packer; the bins of its 200 instances go down to 1 x 1 x 1, and
    # those of the 3D rows are in part flat.
    problem = Problem(bin, largest, support[0] / support[1], inclusive)
    instances, orders = random_cases(problem, seed=sum(bin), count=200, items=10)
    assert_equals_oracle(problem, support, instances, orders)


@pytest.mark.parametrize("support", [(1, 2), (1, 1)])
def test_of_many_items_those_like_a_refused_one_are_packed_as_if_offered(support):
    problem = Problem((6, 4, 7), None, support[0] / support[1])
    instances, orders = random_cases(problem, seed=1, count=12, items=MANY_ITEMS)
    assert_equals_oracle(problem, support, instances, orders)


def test_an_item_that_fits_no_bin_gets_bin_minus_one():
    # The second item goes where it would go without the first. Sides far beyond the bin matter:
    # they are the ones that wrap round in narrow integers, 258 to 2 in int8.
    sides = [6, 127, 128, 129, 200, 255, 256, 257, 258, 261, 65_537]
    large = [(side, axis) for side in sides for axis in range(3)]
    size = np.full((len(large), 6, 3), 1, np.int32)
    for case, (side, axis) in enumerate(large):
        size[case, 0, axis] = side
    mask = np.tile(np.arange(6) < 2, (len(large), 1))
    bins = np.tile(np.array(SMALL_3D.bin, np.int32), (len(large), 1))
    orders = np.tile(np.arange(6, dtype=np.int32), (len(large), 1))
    packings = packer(SMALL_3D)(Instance(size, mask, bins), orders)
    placed = [large[case] for case in np.argwhere(np.asarray(packings.bin[:, 0]) != -1)[:, 0]]
    assert placed == [], "(side, axis) of the items that were placed"
    assert (packings.bin[:, 1] == 0).all()
    assert (packings.position[:, 1] == 0).all()


def test_the_papers_figures_4a_and_5a():
    # Fig. 4A: a bin of length 5 with the height map [5 5 2 3 3], from items of height 5, 2 and 3.
    # An item of length 2, stable on "over 50 %" of its base, may rest at
    #   x = 0: z = 5 on 2 of 2 cells, allowed      x = 1: z = 5 on 1 of 2 cells, not allowed
    #   x = 2: z = 3 on 1 of 2 cells, not allowed  x = 3: z = 3 on 2 of 2 cells, allowed
    # which is the caption of Fig. 5A, allowable (0, 5) and (3, 2), target (3, 2), but for the
    # last height: x = 3 stands at 3 in Fig. 4A and at 2 in Fig. 5A, so the two show different
    # maps. On [5 5 1 2 2], the same with its last three cells one lower, the caption holds to
    # the letter. With "at least 50 %" x = 2 is allowed too, as low as x = 3: it wins.
    over = Problem(bin=(5, 1, 8), support=0.5, inclusive=False)
    tables = [[[2, 5], [1, 2], [2, 3], [2, 1]], [[2, 5], [1, 1], [2, 2], [2, 1]]]
    instances = stack([make_instance(over, table) for table in tables])
    orders = np.tile(np.arange(4, dtype=np.int32), (2, 1))
    corners = packer(over)(instances, orders).position
    assert corners[:, :3].tolist() == [[[0, 0, 0], [2, 0, 0], [3, 0, 0]]] * 2
    assert corners[:, 3].tolist() == [[3, 0, 3], [3, 0, 2]]
    assert positions_allowed(over, [5, 5, 2, 3, 3], 2) == [(0, 5), (3, 3)]
    assert positions_allowed(over, [5, 5, 1, 2, 2], 2) == [(0, 5), (3, 2)]
    least = Problem(bin=(5, 1, 8), support=0.5, inclusive=True)
    assert packer(least)(instances, orders).position[:, 3].tolist() == [[2, 0, 3], [2, 0, 2]]


def positions_allowed(problem, map_2d, length):
    """[(x, z)] at which the kernel lets an item of height 1 rest on a 2D height map."""
    heights = empty_map(problem, jnp.array(problem.bin))
    heights = heights.at[: len(map_2d), 0].set(jnp.array(map_2d, heights.dtype))
    length, one, ceiling = (jnp.array(n, heights.dtype) for n in (length, 1, problem.bin[2]))
    needed = problem.cells_needed(length)
    compiled = jax.jit(rest, static_argnums=0)
    z = compiled(problem, heights, (length, one, one), needed, ceiling)[:, 0].tolist()
    return [(x, z[x]) for x in range(problem.bin[0]) if z[x] <= problem.bin[2]]


def test_a_smaller_bin_is_the_same_as_a_problem_with_that_bin():
    large, small = Problem(bin=(6, 4, 7)), Problem(bin=(5, 2, 6))
    instances, orders = random_cases(small, seed=3, count=200, items=10, shrink=False)
    assert_same(packer(large)(instances, orders), packer(small)(instances, orders))


def test_padding_is_inert_wherever_it_stands():
    # 6 real items and 4 of padding, of any size, at random places in the table and in the order.
    instances, orders = random_cases(SMALL_3D, seed=4, count=200, items=10, padding=0)
    rng = np.random.default_rng(5)
    real = np.sort(rng.permuted(np.tile(np.arange(10), (200, 1)), axis=1)[:, :6], axis=1)
    mask = np.zeros((200, 10), bool)
    np.put_along_axis(mask, real, True, axis=1)
    padded = packer(SMALL_3D)(instances._replace(mask=mask), orders)
    rank = np.cumsum(mask, axis=1) - 1  # an item's row in the table without padding
    kept = np.array([rank[case][order[mask[case][order]]] for case, order in enumerate(orders)])
    size = np.take_along_axis(instances.size, real[..., None], axis=1)
    alone = packer(SMALL_3D)(Instance(size, np.ones((200, 6), bool), instances.bin), kept)
    assert (np.asarray(padded.bin)[~mask] == -1).all()
    assert not np.asarray(padded.position)[~mask].any()
    np.testing.assert_array_equal(np.asarray(padded.bin)[mask].reshape(200, 6), alone.bin)
    np.testing.assert_array_equal(
        np.asarray(padded.position)[mask].reshape(200, 6, 3), alone.position
    )
    for slots, expected in [
        (padded.volume, alone.volume),
        (padded.top, alone.top),
        (padded.shadow, alone.shadow),
    ]:
        np.testing.assert_array_equal(slots[:, :6], expected)
        assert not slots[:, 6:].any()


def test_vmap_and_jit_agree_with_one_by_one():
    # 3 instances with 4 orders each; `one[i][o]` is the packing of instance i in its order o.
    instances, _ = random_cases(SMALL_3D, seed=6, count=3, items=6)
    rng = np.random.default_rng(7)
    orders = rng.permuted(np.tile(np.arange(6, dtype=np.int32), (3, 4, 1)), axis=2)

    def go(instance, order):
        return pack(SMALL_3D, instance, order)

    def instance(i):
        return jax.tree.map(lambda leaf: leaf[i], instances)

    one_by_one = jax.jit(go)
    one = [[one_by_one(instance(i), orders[i, o]) for o in range(4)] for i in range(3)]
    table = stack([stack(row) for row in one])
    over_orders = jax.jit(jax.vmap(go, (None, 0)))
    assert_same(over_orders(instance(1), orders[1]), stack(one[1]))
    over_instances = jax.jit(jax.vmap(go, (0, None)))
    same = stack([one_by_one(instance(i), orders[2, 0]) for i in range(3)])
    assert_same(over_instances(instances, orders[2, 0]), same)
    nested = jax.jit(jax.vmap(jax.vmap(go, (None, 0)), (0, 1)))
    assert_same(nested(instances, orders.swapaxes(0, 1)), table)


@pytest.mark.parametrize("bin", [(9, 7, 6), (21, 1, 30), (16, 18, 200)])
def test_a_window_of_blocks_rests_where_one_cell_by_cell_does(bin, monkeypatch):
    problem, rng = Problem(bin, support=0.4), np.random.default_rng(5)
    room = jnp.asarray(rng.integers(np.array(bin) // 2 + 1, np.array(bin) + 1, (60, 3)).T)
    empty = np.asarray(empty_map(problem, room))
    wall = np.iinfo(empty.dtype).max
    heights = np.where(empty == wall, wall, rng.integers(0, 3, empty.shape)).astype(empty.dtype)
    size = [jnp.asarray(rng.integers(1, side + 1, 60).astype(empty.dtype)) for side in bin]
    needed = problem.cells_needed(size[0].astype(jnp.int32) * size[1]).astype(empty.dtype)
    args = (problem, jnp.asarray(heights), tuple(size), needed, room[2].astype(empty.dtype))
    cell_by_cell = np.asarray(rest(*args))
    monkeypatch.setattr("jaxpack.packing.height_map.LARGE_WINDOW", 1)
    np.testing.assert_array_equal(rest(*args), cell_by_cell)
    assert 0.02 < (cell_by_cell < wall).mean() < 0.98


def test_a_batch_of_several_pieces_is_the_same_as_its_parts():
    # Two pieces and one member of padding; each part is packed in one piece.
    count = LANES + 1
    instances, orders = random_cases(SMALL_3D, seed=9, count=count, items=6)
    whole = packer(SMALL_3D)(instances, orders)
    for part in (slice(0, LANES), slice(count - LANES, count)):
        few, found = jax.tree.map(itemgetter(part), (instances, whole))
        assert_same(found, packer(SMALL_3D)(few, orders[part]))


def test_pack_composes_with_grad():
    # The cost of an order is a number to the gradient, even where the order comes from the
    # parameters: d/dw of cost * w is the cost.
    instances, _ = random_cases(SMALL_3D, seed=8, count=3, items=6, padding=0, oversize=0)

    def cost(weights, instance):
        order = jnp.argsort(weights).astype(jnp.int32)
        return paper_cost(instance, pack(SMALL_3D, instance, order))

    def loss(weights, instance):
        return jax.lax.stop_gradient(cost(weights, instance)) * weights.sum()

    @jax.jit
    def costs_and_slopes(weights, instances):
        return (
            jax.vmap(cost, (None, 0))(weights, instances),
            jax.vmap(jax.grad(loss), (None, 0))(weights, instances),
        )

    expected, slopes = costs_and_slopes(jnp.array([0.5, -1.0, 2.0, 0.0, 3.0, 1.0]), instances)
    assert (expected > 0).all()
    np.testing.assert_allclose(slopes, jnp.tile(expected[:, None], 6), rtol=1e-6)


def stack(trees):
    return jax.tree.map(lambda *leaves: np.stack(leaves), *trees)


def assert_same(found, expected):
    jax.tree.map(np.testing.assert_array_equal, found, expected)


@pytest.mark.parametrize("name", ["paper-2d", "paper-3d"])
def test_on_a_cpu_the_loop_is_one_program(name):
    """The doors ask for it; XLA says so where it complied. Packing takes several times as long
    without.
    """
    problem, items = preset(name).problem, preset(name).distribution.items
    cases = random_cases(problem, seed=0, count=LANES, items=items)
    program = packer(problem).lower(*cases).compile()
    assert jax.default_backend() != "cpu" or "xla_cpu_small_call" in program.as_text()


@pytest.mark.parametrize("place", ["a CPU, loops in parts", "a GPU"])
def test_packings_are_the_same_where_the_program_is_another(place, monkeypatch):
    problem = Problem(bin=(6, 5, 7), largest=(4, 4))
    cases = random_cases(problem, seed=1, count=20, items=12)
    whole = packer(problem)(*cases)
    if place == "a GPU":
        monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    monkeypatch.setenv("XLA_FLAGS", "")
    # Fewer: another shape is traced anew.
    count = {"a GPU": 18}.get(place, 19)
    plain = packer(problem)(*jax.tree.map(lambda leaf: leaf[:count], cases))
    assert_same(plain, jax.tree.map(lambda leaf: leaf[:count], whole))


def test_what_is_no_single_instance_or_no_order_is_refused():
    instances, orders = random_cases(SMALL_3D, seed=1, count=2, items=6)
    one = jax.tree.map(itemgetter(0), instances)
    for instance, order in (
        (instances, orders),
        (one, orders),
        (one, orders[0][:5]),
        (one, orders[0].astype(float)),
        (one._replace(size=one.size[:, :2]), orders[0]),
        (one._replace(size=one.size.astype(float)), orders[0]),
        (one._replace(mask=one.mask[:4]), orders[0]),
        (one._replace(bin=instances.bin), orders[0]),
    ):
        with pytest.raises(AssertionError):
            pack(SMALL_3D, instance, order)


@pytest.mark.parametrize("bin", [(14, 1, 12), (12, 10, 9)])
def test_a_bin_without_a_grid_is_packed_by_the_rules_and_summed_up_as_one_with_cells(bin):
    problem = Problem(bin, inclusive=False, surface="faces", most=12)
    instances, orders = random_cases(problem, 4, 60, 12, oversize=0)
    packings = packer(problem)(instances, orders)
    check_packings(problem, instances, orders, packings)
    for case, (size, room) in enumerate(zip(instances.size, instances.bin, strict=True)):
        bins, corners, *sums = (np.asarray(leaf)[case] for leaf in packings)
        contents = oracle.bin_contents(room, size, bins, corners)
        contents += [(0, 0, 0)] * (12 - len(contents))
        np.testing.assert_array_equal(np.stack(sums, 1), contents)


def test_a_bin_without_a_grid_takes_no_more_items_than_are_reckoned_with():
    problem = Problem((400, 300, 200), surface="faces", most=3)
    instance = make_instance(problem, [(100, 100, 100)] * 8)
    packing = pack(problem, instance, np.arange(8, dtype=np.int32))
    np.testing.assert_array_equal(packing.bin, [0, 0, 0, 1, 1, 1, 2, 2])


@pytest.mark.parametrize(
    ("bin", "options", "message"),
    [
        ((16_383, 10, 10), {"most": 5}, "longest side is 16,383.*coarser unit"),
        ((3000, 2000, 1000), {"most": 5}, "volume is 6,000,000,000.*coarser unit"),
        ((100, 80, 60), {}, "most None: give the most items"),
        ((100, 80, 60), {"surface": "spheres"}, "surface 'spheres': choose cells or faces"),
    ],
)
def test_what_a_bin_without_a_grid_cannot_be_is_said(bin, options, message):
    with pytest.raises(UserError, match=message):
        Problem(bin, **({"surface": "faces"} | options))
