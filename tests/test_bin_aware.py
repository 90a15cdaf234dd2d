"""The policy that sees the bin: what it saw is what `pack` packs, and its choices are fair."""

from dataclasses import replace
from functools import cache, partial
from itertools import permutations, product

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import packer, random_cases

from jaxpack import (
    Distribution,
    MethodOptions,
    Policy,
    Problem,
    TrainConfig,
    UserError,
    make_method,
)
from jaxpack.learning import rollout
from jaxpack.learning.bin_aware import BinAwareConfig
from jaxpack.learning.bin_network import init_network, look, scores
from jaxpack.learning.presets import PAPER_2D, PAPER_3D
from jaxpack.learning.trainer import policy_gradient
from jaxpack.model.instances import sample
from jaxpack.model.metrics import bins_first_cost
from jaxpack.model.packing_check import check_packings
from jaxpack.model.problem import Instance, in_orientation
from jaxpack.packing.env import (
    Choice,
    Decisions,
    choice_of,
    compact,
    decisions_of,
    observe,
    reset,
    step,
)
from jaxpack.packing.first_fit import pack_decisions
from jaxpack.packing.height_map import empty_map, lowest, rest
from jaxpack.packing.surface_view import view_of
from jaxpack.packing.table import Table, footprints, rests, rests_in_a_loop, surroundings
from jaxpack.search.breeding import BrkgaConfig
from jaxpack.search.protocol import lying, pack_orders

PROBLEMS = {
    "2d": replace(PAPER_2D, largest=None),
    "3d": Problem(bin=(6, 5, 7), largest=(4, 5), inclusive=False),
    "int16": Problem(bin=(12, 11, 9), largest=(5, 4), support=0.3),
}
NETWORK = BinAwareConfig(hidden=16)
ITEMS, COUNT = 14, 1000  # of what is played at random: one program per problem


def batch_last(instances):
    return jax.tree.map(lambda leaf: jnp.moveaxis(jnp.asarray(leaf), 0, -1), instances)


@cache
def random_play(problem, items, kinds):
    """Plays uniformly among what is allowed: (all states, all choices, chosen kinds, their corners
    and orientations).
    """
    view = Table(problem)

    def play(key, instances):
        def turn(state, key):
            choices = observe(view, state)
            noise = jax.random.uniform(key, choices.allowed.shape)
            row = jnp.argmax(jnp.where(choices.allowed, noise, -1), 0).astype(jnp.int32)
            choice = state.kinds.choice(row)
            corner = [jnp.take_along_axis(c, row[None], 0)[0] for c in choices.candidates.corner]
            kind = jnp.where(choices.allowed.any(0), choice.kind, items)
            seen = (state, choices, kind, jnp.stack(corner), choice.orientation)
            return step(view, state, choice), seen

        start = reset(view, batch_last(instances), kinds)
        return jax.lax.scan(turn, start, jax.random.split(key, items))[1]

    return jax.jit(play)


def few_played(problem, seed, count):
    """(states, choices) of the first of the random plays, all steps of them."""
    instances, _ = random_cases(problem, seed, COUNT, ITEMS)
    states, choices, *_ = random_play(problem, ITEMS, None)(jax.random.key(2), instances)
    return jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)[..., :count]), (states, choices))


def first_of(many):
    return jax.tree.map(lambda leaf: leaf[0], many)


def all_may_turn(problem, instances):
    """Every item in three ways, of which two may be the same."""
    ways = [(0, 1, 2), (2, 1, 0), (1, 0, 2) if problem.bin[1] > 1 else (0, 1, 2)]
    return instances._replace(turned=jnp.stack([instances.size[..., way] for way in ways], 2))


def may_turn(problem, instances):
    """Half of the items in three ways, of which two may be the same; the others in one."""
    turned = np.array(all_may_turn(problem, instances).turned)
    turned[:, ::2] = np.asarray(instances.size)[:, ::2, None]
    return instances._replace(turned=jnp.asarray(turned))


@pytest.mark.parametrize("turns", [False, True])
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.long if name == "int16" else ()) for name in PROBLEMS],
)
def test_the_order_packs_to_what_the_policy_saw(name, turns):
    problem, items, count = PROBLEMS[name], ITEMS, COUNT
    instances, _ = random_cases(problem, 7, count, items)
    if turns:
        instances = may_turn(problem, instances)
    states, _, label, corner, way = random_play(problem, items, None)(jax.random.key(1), instances)
    opened = states.opened
    orders, chosen, _ = decisions_of(first_of(states.kinds), Choice(label, way))
    orders = np.asarray(orders)
    assert (np.sort(orders, 1) == np.arange(items)).all()
    if turns:
        turning = np.asarray(chosen)[:, 1::2][np.asarray(instances.mask)[:, 1::2]]
        assert 0.2 < (turning > 0).mean() < 0.8
    given, instances = instances, jax.vmap(in_orientation)(instances, chosen)
    packing = packer(problem)(instances, orders)
    placed = items > np.asarray(label).T  # [count, steps]
    member = np.arange(count)[:, None]
    bins, positions = np.asarray(packing.bin), np.asarray(packing.position)
    np.testing.assert_array_equal(
        bins[member, orders], np.where(placed, np.asarray(opened).T - 1, -1)
    )
    np.testing.assert_array_equal(
        positions[member, orders][placed],
        np.moveaxis(np.asarray(corner), 1, -1).swapaxes(0, 1)[placed],
    )
    # All that fits an empty bin is placed, padding never.
    ways = np.asarray(given.size[:, :, None] if given.turned is None else given.turned)
    fits_bin = (ways <= np.asarray(instances.bin)[:, None, None]).all(-1)
    if problem.largest:
        fits_bin &= (ways[..., :2] <= problem.largest).all(-1)
    fits_bin = fits_bin.any(-1)
    np.testing.assert_array_equal(bins >= 0, np.asarray(instances.mask) & fits_bin)


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_candidate_table_equals_the_kernel_kind_by_kind(name):
    problem = PROBLEMS[name]
    states, choices = few_played(problem, 8, 200)

    @jax.jit
    def kernel(states):
        fixed, sides = first_of(states.kinds), states.kinds.sides
        needed = problem.cells_needed(sides[0].astype(jnp.int32) * sides[1]).astype(sides[0].dtype)
        heights = jnp.moveaxis(states.inside.heights, 0, 2)[:, :, :, None]  # [L', W', T, 1, count]
        ceiling = fixed.bin[2].astype(sides[0].dtype)
        return lowest(problem, rest(problem, heights, tuple(sides), needed, ceiling))

    corner, fits = kernel(states)
    present = np.asarray(states.remaining > 0)
    allowed = np.asarray(choices.allowed)
    np.testing.assert_array_equal(allowed, np.asarray(fits) & present)
    assert 0.2 < allowed[present].mean() < 0.98
    for ours, theirs in zip(choices.candidates.corner, corner, strict=True):
        np.testing.assert_array_equal(np.asarray(ours)[allowed], np.asarray(theirs)[allowed])


def look_at(problem, heights, bins):
    """Where every footprint rests, found in two ways, and what is around it there."""
    (at,) = rests(problem, heights, bins)
    return at, rests_in_a_loop(problem, heights), surroundings(problem, heights, bins, at)


@pytest.mark.parametrize("name", PROBLEMS)
def test_surroundings_are_what_a_look_cell_by_cell_finds(name):
    problem = PROBLEMS[name]
    (L, W, _), count = problem.bin, 40
    rng = np.random.default_rng(3)
    bins = rng.integers(1, np.array(problem.bin) + 1, (count, 3)).T.astype(np.int32)
    empty = np.asarray(empty_map(problem, jnp.asarray(bins)))
    wall = np.iinfo(empty.dtype).max
    heights = np.where(empty == wall, wall, rng.integers(0, 4, empty.shape)).astype(empty.dtype)
    heights = np.where(empty == wall, wall, np.minimum(heights, np.asarray(bins)[2]))
    at, again, around = jax.tree.map(np.asarray, jax.jit(partial(look_at, problem))(heights, bins))
    chex.assert_trees_all_equal(at, again)
    checked = 0
    for row, (length, width) in enumerate(footprints(problem)):
        for b in range(count):
            x, y, z = (int(side[row, b]) for side in at[:3])
            if z == wall:
                continue
            checked += 1
            bin_x, bin_y, top = (int(side) for side in bins[:, b])
            full = np.full((L + 2, W + 2), top)  # one cell of wall around the bin
            full[1 : bin_x + 1, 1 : bin_y + 1] = heights[:bin_x, :bin_y, b]
            cells = full[x + 1 : x + length + 1, y + 1 : y + width + 1]
            found = {name: int(values[row, b]) for name, values in around._asdict().items()}
            assert found["under"] == cells.sum()
            assert int(at.supported[row, b]) == (cells == z).sum()
            assert found["left"] == full[x, y + 1 : y + width + 1].sum()
            assert found["right"] == full[x + length + 1, y + 1 : y + width + 1].sum()
            assert found["front"] == full[x + 1 : x + length + 1, y].sum()
            assert found["back"] == full[x + 1 : x + length + 1, y + width + 1].sum()
            line_x, line_y = heights[:bin_x, y, b], heights[x, :bin_y, b]

            def run(line, z=z):
                higher = np.flatnonzero(line > z)
                return len(line) if len(higher) == 0 else int(higher[0])

            assert found["gap_left"] == run(line_x[:x][::-1])
            assert found["gap_right"] == run(line_x[x + length :])
            assert found["gap_front"] == run(line_y[:y][::-1])
            assert found["gap_back"] == run(line_y[y + width :])
    assert checked > 100


@pytest.mark.parametrize("attention", [0, 2])
def test_probabilities_are_over_what_fits_and_sum_to_one(attention):
    problem = PROBLEMS["3d"]
    config = replace(NETWORK, attention=attention, sees="all" if attention else "surroundings")
    params = init_network(config, problem, jax.random.key(0))
    params["score"] = jax.random.normal(jax.random.key(9), params["score"].shape)
    states, choices = few_played(problem, 9, 50)

    def log_probs(state):
        return scores(
            config, params, look(config, Table(problem), state, observe(Table(problem), state))
        )

    found = np.asarray(jax.jit(jax.vmap(log_probs))(states))  # [steps, K, B]
    fits = np.asarray(choices.allowed)
    probability = np.where(fits, np.exp(found), 0).sum(1)
    np.testing.assert_allclose(probability[fits.any(1)], 1, rtol=1e-5)
    assert (found[~fits] < -1e8).all()
    assert np.isfinite(found).all()
    assert found[fits].std() > 0.1, "all the same: the test shows nothing"


def test_sampled_orders_never_hold_what_is_masked_before_what_is_not():
    problem, items = PROBLEMS["2d"], 12
    params = init_network(NETWORK, problem, jax.random.key(0))
    instances, _ = random_cases(problem, 10, 70, items, oversize=0)
    keys = jax.random.split(jax.random.key(4), 70)
    instances = jax.tree.map(jnp.asarray, instances)
    for kinds in (None, items):
        orders = np.asarray(NETWORK.orders(problem, params, instances, keys, kinds).order)
        assert (np.sort(orders, 1) == np.arange(items)).all()
        placed = np.take_along_axis(np.asarray(instances.mask), orders, 1)
        assert (placed[:, :-1] >= placed[:, 1:]).all()


def test_the_policy_turns_items_as_it_saw_them():
    problem, items = PROBLEMS["3d"], 12
    params = init_network(NETWORK, problem, jax.random.key(0))
    params["score"] = jax.random.normal(jax.random.key(9), params["score"].shape)
    instances, _ = random_cases(problem, 11, 64, items, oversize=0)
    keys = jax.random.split(jax.random.key(5), 64)
    fixed = jax.tree.map(jnp.asarray, instances)
    turned = may_turn(problem, fixed)
    orders, ways, _ = jax.jit(partial(NETWORK.orders, problem))(params, turned, keys)
    assert (np.sort(orders, 1) == np.arange(items)).all()
    assert not np.asarray(ways)[:, ::2].any()
    assert 0.2 < (np.asarray(ways)[:, 1::2] > 0).mean() < 0.9
    free = packer(problem)(jax.vmap(in_orientation)(turned, ways), orders)
    assert (np.asarray(free.bin) >= 0)[np.asarray(fixed.mask)].all()


def test_dropping_kinds_of_which_nothing_remains_changes_nothing():
    problem, items = PROBLEMS["2d"], 16
    instances = sample(problem, Distribution(items, 1, 3), jax.random.key(5), 64)
    view = Table(problem)
    state = jax.jit(lambda some: reset(view, some, 9))(batch_last(instances))  # 3 x 3 sizes
    assert (state.remaining.sum(0) == items).all()

    @jax.jit
    def turn(state):
        first = jnp.argmax(observe(view, state).allowed, 0).astype(jnp.int32)
        return step(view, state, state.kinds.choice(first))

    for _ in range(8):
        state = turn(state)
    kept = jax.jit(compact, static_argnums=1)(state, 8)
    assert kept.remaining.shape[0] == 8
    sizes = jnp.stack(state.kinds.sides)
    np.testing.assert_array_equal(
        jnp.take_along_axis(sizes, kept.kinds.kind[None], 1)[:, kept.remaining > 0],
        jnp.stack(kept.kinds.sides)[:, kept.remaining > 0],
    )
    assert (kept.remaining.sum(0) == state.remaining.sum(0)).all()


@pytest.mark.long
@pytest.mark.parametrize("name", ["2d", "3d"])
def test_a_policy_of_orders_is_one_of_positions_that_has_one_to_choose(name):
    """Of a rule that is named twice the second position is never another."""
    problem, network = PROBLEMS[name], replace(NETWORK, attention=4)
    instances = sample(problem, Distribution(ITEMS, 1, 4), jax.random.key(5), 40)
    # No two kinds are one another turned: they would be as good as each other, and rounding would
    # say which comes first.
    kind = (0, 2) if problem.bin[1] == 1 else (0, 1, 2)
    size = instances.size.at[..., kind].set(jnp.sort(instances.size[..., kind], -1))
    instances = all_may_turn(problem, instances._replace(size=size))
    params = init_network(network, problem, jax.random.key(0))
    params["score"] = 2 * jax.random.normal(jax.random.key(2), params["score"].shape)
    found = {}
    for positions in ((), (problem.rule,)):
        chooses = replace(network, positions=positions)
        greedy = chooses.orders(problem, params, instances)
        beams = chooses.beams(problem, params, instances, 3)
        first = jax.tree.map(lambda leaf: leaf[:, 0], beams)
        packed = [pack_decisions(problem, instances, decided)[1] for decided in (greedy, first)]
        found[positions] = (greedy[:2], beams[:2], packed)
        assert (greedy.place is None) == (beams.place is None) == (not positions)
    jax.tree.map(np.testing.assert_array_equal, *found.values())


@pytest.mark.long
@pytest.mark.parametrize("positions", [("far-corner",), ("least-wasted", "most-contact")])
def test_a_policy_of_positions_packs_where_it_says(positions):
    problem, network = PROBLEMS["3d"], replace(NETWORK, positions=positions)
    instances = may_turn(problem, sample(problem, Distribution(ITEMS, 1, 4), jax.random.key(5), 40))
    params = init_network(network, problem, jax.random.key(0))
    decided = network.orders(problem, params, instances, jax.random.split(jax.random.key(1), 40))
    turned, packing = pack_decisions(problem, instances, decided)
    check_packings(problem, turned, decided.order, packing, "the policy")
    x, y, _ = jnp.moveaxis(packing.position, -1, 0)
    np.testing.assert_array_equal(x + y * problem.bin[0], decided.place)
    _, by_rule = pack_decisions(problem, instances, decided._replace(place=None))
    assert (packing.position != by_rule.position).any()


@pytest.mark.parametrize("most", [None, 40])
def test_what_fills_whole_bins_leaves_nothing_over(most):
    """However it is summed: rounded down, it would be nearly a bin."""
    problem = replace(PAPER_2D, surface="faces", most=most) if most else PAPER_2D
    instances = sample(problem, Distribution(40, 1, 5), jax.random.key(5), 4000)
    volume = np.asarray(instances.size).prod(-1).sum(1)
    over = volume % 100 / 100
    view = view_of(problem)

    @jax.jit
    def see(some):
        state = reset(view, batch_last(some), 25)
        return look(NETWORK, view, state, observe(view, state)).context[:, 3]

    for size in (4000, 40):  # programs sum in orders of their own
        some = jax.tree.map(lambda leaf, size=size: leaf[:size], instances)
        np.testing.assert_allclose(see(some), over[:size], atol=1e-4)


@pytest.mark.long
def test_a_policy_decides_the_same_however_its_inputs_are_scaled():
    problem = PAPER_3D
    was = BinAwareConfig(hidden=16, sees="all", input_centre=0.1, input_scale=2.0)
    now = replace(was, input_centre=0.3, input_scale=4.0)
    leaves, tree = jax.tree.flatten(was.init(problem, jax.random.key(0)))
    keys = jax.random.split(jax.random.key(1), len(leaves))
    drawn = [jax.random.normal(k, leaf.shape) / 4 for k, leaf in zip(keys, leaves, strict=True)]
    params = tree.unflatten(drawn)
    view = view_of(problem)
    instances = sample(problem, Distribution(items=12, low=2, high=5), jax.random.key(2), 32)
    state = reset(view, batch_last(instances), 12)
    for _ in range(8):
        choices = observe(view, state)
        one, other = (
            scores(network, weights, look(network, view, state, choices))
            for network, weights in ((was, params), (now, now.adopt(was, params)))
        )
        np.testing.assert_allclose(one, other, atol=1e-4)
        unlike = scores(now, params, look(now, view, state, choices))
        assert np.abs(unlike - one).max() > 0.1, "whatever the scale, it would be the same"
        state = step(view, state, choice_of(view, state, choices, one.argmax(0).astype(jnp.int32)))


TINY = TrainConfig(
    problem=Problem(bin=(4, 1, 4), largest=(4, 1)),
    distribution=Distribution(items=3, low=1, high=4),
    policy=BinAwareConfig(hidden=8),
    train_instances=2048,
    valid_instances=8,
    batch=2048,
    epochs=1,
    objective="bins",
    alpha=1.0,
    learner="leave-one-out",
    samples=4,
)


def waste_of_choices(config, packings, orders):
    """What each choice of an order in bins of 4 x 1 x 4 answers for, bin by bin: [orders, 3]."""
    found = np.zeros(orders.shape)
    for row, order in enumerate(np.asarray(orders)):
        volume, top = packings.volume[row], packings.top[row]
        bins = int((np.asarray(volume) > 0).sum())
        waste = [1 - float(volume[b]) / 16 for b in range(bins)]
        waste[-1] = config.alpha * (1 - float(volume[bins - 1]) / (4 * float(top[bins - 1])))
        for place, item in enumerate(order):
            own = int(packings.bin[row, item])
            found[row, place] = sum(
                config.discount ** (b - own) * waste[b] for b in range(own, bins)
            )
    return found


@pytest.mark.parametrize(
    ("learner", "loss_steps", "positions"),
    [
        pytest.param("leave-one-out", 1.0, (), marks=pytest.mark.long),
        pytest.param("leave-one-out-by-bin", 1.0, (), marks=pytest.mark.long),
        pytest.param("leave-one-out-by-bin", 1 / 3, (), marks=pytest.mark.long),
        ("leave-one-out-by-waste", 1.0, ()),
        pytest.param("leave-one-out", 1.0, ("far-corner",), marks=pytest.mark.long),
    ],
)
def test_leave_one_out_gradient_is_that_of_the_expected_cost(learner, loss_steps, positions):
    config = replace(TINY, learner=learner, beta=0.0, loss_steps=loss_steps, discount=0.3)
    problem, network = config.problem, replace(config.policy, positions=positions)
    config = replace(config, policy=network)
    params = init_network(network, problem, jax.random.key(1))
    params["score"] = 2 * jax.random.normal(jax.random.key(2), params["score"].shape)
    one = Instance(
        jnp.asarray([[3, 1, 2], [2, 1, 3], [1, 1, 2]]), jnp.ones(3, bool), jnp.asarray([4, 1, 4])
    )

    ways = product(permutations(range(3)), product(range(1 + len(positions)), repeat=3))
    orders, rules = (jnp.asarray(column) for column in zip(*ways, strict=True))

    def probability(params, way):
        """Of the choices of an order and its rules, [3]: zero where one does not fit."""
        view = Table(problem, more=positions)
        state = reset(view, jax.tree.map(lambda leaf: leaf[..., None], one))
        chances, places = [], jnp.full(3, -1)
        for item, rule in zip(*way, strict=True):
            choices = observe(view, state)
            sight = look(network, view, state, choices)
            kind = jnp.argmax(state.kinds.items[:, 0] == item)  # three kinds, an item each
            row = kind + 3 * rule
            found = scores(network, params, sight)
            chances.append(jnp.where(sight.fits[row, 0], jnp.exp(found[row, 0]), 0))
            choice = choice_of(view, state, choices, row[None].astype(jnp.int32))
            if choice.position is not None:
                places = places.at[item].set(choice.position[0][0])
            state = step(view, state, choice)
        return jnp.stack(chances), places

    played = jax.jit(lambda ways: jax.lax.map(partial(probability, params), ways))
    _, places = played((orders, rules))
    repeated = jax.tree.map(lambda leaf: jnp.stack([leaf] * len(orders)), one)
    decided = Decisions(orders, jnp.zeros_like(orders), places if positions else None)
    packed = pack_decisions(problem, repeated, decided)
    costs = jax.vmap(config.cost)(*packed)
    answers_for = waste_of_choices(config, packed[1], orders)

    @jax.jit
    @partial(jax.grad, has_aux=True)
    def expected_cost(params):
        chances, _ = jax.lax.map(partial(probability, params), (orders, rules))
        whole = chances.prod(1)
        if learner == "leave-one-out-by-waste":
            told = jnp.log(jnp.maximum(chances, 1e-9)) * answers_for
            return (jax.lax.stop_gradient(whole) * told.sum(1)).sum(), whole
        return (whole * costs).sum(), whole

    exact, chances = expected_cost(params)
    assert chances.sum() == pytest.approx(1, abs=1e-5)
    assert 2 <= (chances > 0).sum() < len(orders), "every order is possible, or only one"
    possible = np.asarray(chances) > 0
    assert len(set(np.asarray(costs)[possible].tolist())) > 1
    assert learner != "leave-one-out-by-waste" or len({*answers_for[possible].ravel()}) > 2
    many = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (config.batch, *leaf.shape)), one)
    sampled = jax.jit(partial(policy_gradient, config))
    seeds = 4 if loss_steps == 1 else 36  # a third of the steps tells less
    estimates = [sampled(params, many, jax.random.key(seed))[0] for seed in range(seeds)]
    for name, truth in exact.items():
        estimate = np.mean([np.asarray(e[name]) for e in estimates], 0)
        scale = np.abs(np.asarray(truth)).max()
        np.testing.assert_allclose(estimate, truth, atol=0.06 * scale + 2e-4, err_msg=name)


@pytest.mark.parametrize(
    "learner",
    [
        "leave-one-out-by-waste",
        *(
            pytest.param(name, marks=pytest.mark.long)
            for name in ("leave-one-out", "leave-one-out-by-bin", "self-label")
        ),
    ],
)
def test_the_mean_over_all_steps_that_may_be_drawn_is_the_whole_gradient(learner, monkeypatch):
    config = replace(TINY, learner=learner, entropy=0.3, batch=16, train_instances=16)
    params = init_network(config.policy, config.problem, jax.random.key(1))
    params["score"] = 2 * jax.random.normal(jax.random.key(2), params["score"].shape)
    instances = sample(config.problem, config.distribution, jax.random.key(3), config.batch)

    @partial(jax.jit, static_argnums=0)
    def gradient_of(config, steps):
        monkeypatch.setattr(rollout, "draw_steps", lambda *_: steps)
        return policy_gradient(config, params, instances, jax.random.key(4))

    whole, outcome = gradient_of(config, jnp.arange(3))
    for share, draws in ((1 / 3, ((0,), (1,), (2,))), (2 / 3, ((0, 1), (0, 2), (1, 2)))):
        some = replace(config, loss_steps=share)
        found = [gradient_of(some, jnp.asarray(steps)) for steps in draws]
        mean = jax.tree.map(lambda *leaves: sum(leaves) / len(leaves), *found)
        chex.assert_trees_all_close(mean, (whole, outcome), rtol=1e-4, atol=1e-6)
        assert not np.allclose(found[0][0]["deep"], whole["deep"], rtol=0.1)


def test_every_step_is_as_likely_to_be_drawn_as_any_other():
    for share, count in ((0.25, 2), (0.5, 4), (0.01, 1), (1.0, 8)):
        draw = jax.vmap(lambda key, share=share: rollout.draw_steps(key, 8, share))
        drawn = np.asarray(draw(jax.random.split(jax.random.key(0), 4000)))
        assert drawn.shape == (4000, count)
        assert (np.diff(drawn) > 0).all()
        often = np.bincount(drawn.ravel(), minlength=8) / 4000
        np.testing.assert_allclose(often, count / 8, atol=0.04)


@pytest.mark.parametrize(
    "learner", ["leave-one-out", pytest.param("self-label", marks=pytest.mark.slow)]
)
def test_a_few_updates_lower_the_cost(learner):
    from jaxpack.learning.trainer import init_state, train_chunk

    config = replace(
        TINY,
        problem=Problem(bin=(6, 1, 6), largest=(4, 1)),
        distribution=Distribution(items=12, low=1, high=4),
        train_instances=64 * 30,
        batch=64,
        learning_rate=2e-2,
        clip=1.0,
        entropy=0.001,
        schedule="cosine",
        learner=learner,
    )
    state, first = train_chunk(config, init_state(config, jax.random.key(0)), 5)
    for _ in range(5):
        state, last = train_chunk(config, state, 5)
    assert last.outcome.cost < 0.97 * first.outcome.cost
    assert last.finite == 1


def test_recipes_that_do_not_go_together_are_refused():
    for change, message in (
        ({"samples": 1}, "give samples 2 or more"),
        (
            {"learner": "critic"},
            "choose leave-one-out or leave-one-out-by-bin or leave-one-out-by-waste or self-label",
        ),
        ({"learner": "luck"}, "those that the bin-aware network has for objective bins"),
        ({"schedule": "steps"}, "choose constant or cosine"),
        ({"objective": "speed"}, "choose bins or paper"),
        ({"entropy": -1.0}, "give 0 or more"),
        ({"discount": 1.5}, "give a share, from 0 to 1"),
        ({"loss_steps": 0.0}, "give a share, above 0 and up to 1"),
        ({"loss_steps": 1.5}, "give a share, above 0 and up to 1"),
        (
            {"learner": "leave-one-out-by-bin", "objective": "paper"},
            "choose leave-one-out or self-label, those that the bin-aware network has",
        ),
    ):
        with pytest.raises(UserError, match=message):
            replace(TINY, **change)


@cache
def beams(width):
    problem = PAPER_3D
    params = init_network(NETWORK, problem, jax.random.key(6))
    params["score"] = jax.random.normal(jax.random.key(7), params["score"].shape)
    instances = sample(problem, Distribution(20, 2, 5), jax.random.key(8), 12)
    beams = jax.jit(partial(NETWORK.beams, problem, width=width, kinds=20))(params, instances)
    return problem, params, instances, np.asarray(beams.order)


def test_a_beam_of_width_one_is_greedy():
    problem, params, instances, orders = beams(1)
    greedy = NETWORK.orders(problem, params, instances).order
    np.testing.assert_array_equal(orders[:, 0], greedy)


@pytest.mark.long
def test_a_wider_beam_begins_with_the_narrower_and_is_never_worse():
    _, _, _, wide = beams(4)
    problem, _, instances, widest = beams(6)
    np.testing.assert_array_equal(widest[:, :4], wide)
    assert (np.sort(widest, -1) == np.arange(20)).all()
    costs = np.stack(
        [
            jax.vmap(bins_first_cost)(instances, packer(problem)(instances, widest[:, slot]))
            for slot in range(6)
        ]
    )
    best = np.minimum.accumulate(costs, 0)
    assert (best[1:] <= best[:-1]).all()
    assert (best[-1] < best[0]).any()
    assert len({tuple(order) for order in widest[0].tolist()}) > 1


@pytest.mark.long
@pytest.mark.parametrize("how", ["bin-aware-best-of-2", "bin-aware-search", "brkga-seeded"])
def test_every_search_takes_a_policy_of_positions(how):
    config = replace(TINY, policy=replace(TINY.policy, positions=("far-corner",)))
    params = init_network(config.policy, config.problem, jax.random.key(0))
    genetic = BrkgaConfig(population=12, generations=1)
    options = MethodOptions(policy=Policy(config, params), brkga=genetic, rounds=1)
    instances = sample(config.problem, config.distribution, jax.random.key(1), 4)
    method = make_method(how, config.problem, options)
    orders = jax.jit(method.orders)(jax.random.split(jax.random.key(2), 4), instances)
    packings = pack_orders(config.problem, instances, orders)
    check_packings(config.problem, *lying(instances, orders), packings, how)
