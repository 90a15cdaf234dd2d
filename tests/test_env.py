"""Packing as choices, as somebody uses it who writes a training loop of their own."""

from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import packer, random_cases

from jaxpack import (
    Choice,
    Decisions,
    Distribution,
    Problem,
    Table,
    UserError,
    choice_of,
    load_policy,
    observe,
    positions,
    reset,
    step,
)
from jaxpack.learning.rollout import decide
from jaxpack.model.instances import sample
from jaxpack.model.packing_check import check_packings
from jaxpack.model.problem import Instance, Packing, in_orientation
from jaxpack.packing.env import decisions_of
from jaxpack.packing.first_fit import pack_decisions
from jaxpack.packing.height_map import HeightMap
from jaxpack.packing.rules import RULES
from jaxpack.packing.surface_view import SurfaceView, blocks_of_cells, view_of
from jaxpack.packing.table import OF_FOOTPRINTS

PROBLEM = Problem(bin=(7, 6, 8), largest=(4, 4))
ITEMS, BATCH = 14, 16
CUBES = Distribution(ITEMS, 1, 4, "all")


def without_grid(most, scale=1):
    """The rules of bins in millimetres, that `pallets` has, or in parts of them."""
    return Problem((800 * scale, 600 * scale, 500 * scale), surface="faces", most=most)


def batch_last(instances):
    return jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), instances)


@cache
def pack_all(problem):
    return jax.jit(partial(pack_decisions, problem))


@cache
def player(view, free):
    """A random policy: instances, key -> (kinds, the end, (choice, bin, corner) of every step).
    Where it is `free` it chooses among all positions, and not among those of the rules.
    """

    def play(instances, key):
        batch, items = instances.mask.shape

        def turn(state, key):
            keys, choices = jax.random.split(key), observe(view, state)
            allowed = choices.allowed
            row = jnp.argmax(jax.random.uniform(keys[0], allowed.shape) * allowed, 0)
            choice, done = choice_of(view, state, choices, row), ~allowed.any(0)
            corner = [jnp.take_along_axis(c, row[None], 0)[0] for c in choices.candidates.corner]
            if free:
                places = positions(view, state, choice.kind, choice.orientation)
                noise = jax.random.uniform(keys[1], places.allowed.shape) * places.allowed
                i, j = jnp.divmod(noise.reshape(-1, batch).argmax(0), noise.shape[1])
                lane = jnp.arange(batch)
                x, y = (jnp.broadcast_to(at, noise.shape)[i, j, lane] for at in places[:2])
                choice = choice._replace(position=(x, y))
                corner = [x, y, places.z[i, j, lane]]
            noted = choice._replace(kind=jnp.where(done, items, choice.kind))
            return step(view, state, choice), (noted, state.opened - 1, jnp.stack(corner, -1))

        start = reset(view, batch_last(instances))
        return start.kinds, *jax.lax.scan(turn, start, jax.random.split(key, items))

    return jax.jit(play)


def checked(problem, instances, played, label):
    """(order, turned instances, packing) of what was played, which keeps every rule."""
    kinds, end, (choices, bins, corners) = played
    assert not np.asarray(end.remaining).any()
    decisions = decisions_of(kinds, choices)
    order, orientation, _ = decisions
    turned, replayed = pack_all(problem)(instances, decisions)
    batch, items = instances.mask.shape
    lane = np.arange(batch)[:, None]
    nothing = np.zeros((batch, items), int)
    bin, position = nothing.copy(), np.zeros((batch, items, 3), int)
    bin[lane, order] = np.asarray(bins).T
    position[lane, order] = np.asarray(corners).swapaxes(0, 1)
    packing = Packing(bin, position, nothing, nothing, nothing)
    check_packings(problem, turned, order, packing, label)
    assert same(packing, replayed), "what was decided packs to what was played"
    assert (np.asarray(orientation) > 0).any()
    return order, turned, packing


def same(packing, other):
    return bool(
        (np.asarray(packing.bin) == other.bin).all()
        and (np.asarray(packing.position) == other.position).all()
    )


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize(
    ("rule", "more"),
    [
        ("lowest", ()),
        pytest.param("lowest", OF_FOOTPRINTS, marks=pytest.mark.long),
        ("nearest-corner", ()),
        ("nearest-corner", ("most-contact",)),
    ],
)
def test_a_random_policy_packs_by_the_rules(rule, more, free):
    problem = replace(PROBLEM, rule=rule)
    instances = sample(problem, CUBES, jax.random.key(0), BATCH)
    played = player(view_of(problem, more), free)(instances, jax.random.key(1))
    order, turned, packing = checked(problem, instances, played, "the random policy")
    # `pack` fills in the rule's positions, and only those.
    assert same(packing, packer(problem)(turned, order)) == (not free and not more)


def test_a_table_names_the_rules_that_it_can_have():
    with pytest.raises(UserError, match="'most-contact': choose nearest-corner, far-corner"):
        Table(PROBLEM, more=("most-contact",))


def test_no_place_of_its_own_is_the_place_of_the_rule():
    instances, orders = random_cases(PROBLEM, 3, 64, ITEMS)
    by_rule = packer(PROBLEM)(instances, orders)
    decide = partial(Decisions, orders, np.zeros_like(orders))
    for place in (None, np.full_like(orders, -1), np.full_like(orders, 7 * 6)):  # beyond the bin
        _, packing = pack_all(PROBLEM)(instances, decide(place))
        jax.tree.map(np.testing.assert_array_equal, packing, by_rule)


def test_what_is_not_allowed_changes_nothing():
    view = Table(PROBLEM)
    instances = batch_last(sample(PROBLEM, CUBES, jax.random.key(0), BATCH))
    state = jax.jit(partial(reset, view))(instances)
    first = state.kinds.choice(jnp.argmax(state.remaining > 0, 0))
    place = jax.jit(partial(step, view))
    before = place(state, first)
    corner = jnp.zeros(BATCH, jnp.int32)
    assert positions(view, before, first.kind, first.orientation).allowed.any((0, 1)).all()
    for x, y in ((corner + 7, corner), (corner - 1, corner), (corner, corner + 60)):
        after = place(before, first._replace(position=(x, y)))
        jax.tree.map(np.testing.assert_array_equal, after, before)
    gone = Choice(jnp.full(BATCH, ITEMS), corner)
    jax.tree.map(np.testing.assert_array_equal, place(before, gone), before)


@pytest.mark.parametrize("bin", [(10, 1, 9), (6, 5, 7)])
@pytest.mark.parametrize("more", [(), pytest.param(OF_FOOTPRINTS, marks=pytest.mark.long)])
def test_any_surface_shows_what_the_table_shows(bin, more):
    """What lies beyond the ceiling the table does not replace by what else the rule would like."""
    problem = Problem(bin=bin, largest=(4, min(bin[1], 4)), inclusive=False)
    any_surface = SurfaceView(
        HeightMap(problem),
        blocks_of_cells,
        inclusive=False,
        more=tuple(RULES[name] for name in more),
    )
    views = Table(problem, more=more), any_surface
    instances = batch_last(sample(problem, Distribution(18, 1, 4, "all"), jax.random.key(2), 24))
    states = [jax.jit(partial(reset, view))(instances) for view in views]
    looks = [jax.jit(partial(observe, view)) for view in views]
    steps = [
        jax.jit(
            lambda state, choices, row, view=view: step(
                view, state, choice_of(view, state, choices, row)
            )
        )
        for view in views
    ]
    resting = waiting = 0
    for number in range(18):
        table, other = (look(state) for look, state in zip(looks, states, strict=True))
        present = np.asarray(states[0].remaining > 0)
        present = np.concatenate([present, np.asarray(table.allowed)[len(present) :]])
        jax.tree.map(
            lambda ours, theirs, at=present: np.testing.assert_array_equal(
                np.asarray(ours)[at], np.asarray(theirs)[at]
            ),
            (table.allowed, *table.candidates),
            (other.allowed, *other.candidates),
        )
        jax.tree.map(np.testing.assert_array_equal, tuple(table.outline), tuple(other.outline))
        resting, waiting = resting + table.allowed.sum(), waiting + present.sum()
        noise = jax.random.uniform(jax.random.key(number), present.shape)
        row = jnp.argmax(noise * table.allowed, 0)
        states = [go(state, table, row) for go, state in zip(steps, states, strict=True)]
    assert 0.3 < resting / waiting < 0.99, "all of it rests, or nothing: the test shows little"


def pallets(count, items, scale=1):
    """Orders of boxes that may be turned upright, in millimetres (times `scale`)."""
    rng = np.random.default_rng(5)
    kinds = rng.integers((120, 100, 60), (501, 401, 301), (count, 6, 3))
    size = scale * np.take_along_axis(kinds, rng.integers(0, 6, (count, items, 1)), 1)
    turned = jnp.asarray(np.stack([size, size[..., [1, 0, 2]]], 2), jnp.int32)
    bins = jnp.full((count, 3), scale) * jnp.asarray([800, 600, 500])
    return Instance(turned[:, :, 0], jnp.ones((count, items), bool), bins.astype(jnp.int32), turned)


@pytest.mark.parametrize("stability", ["share", pytest.param("centre", marks=pytest.mark.long)])
@pytest.mark.parametrize("free", [pytest.param(False, marks=pytest.mark.long), True])
def test_orders_in_millimetres_need_no_grid(free, stability):
    instances = pallets(3, 18)
    problem = replace(without_grid(18), stability=stability)
    more = () if free else ("far-corner", "most-contact")
    for rules in {(), more}:
        played = player(view_of(problem, rules), free)(instances, jax.random.key(1))
        order, turned, packing = checked(problem, instances, played, "the random policy")
        assert packing.bin.max() > 0
        alike = same(packing, packer(problem)(turned, order))
        assert alike == (not free and not rules)


def test_what_lies_off_its_centre_is_not_allowed():
    """On a block of 200 one of 500 is carried by two fifths, off its centre; beside it by all."""
    allowed = {}
    for stability in ("share", "centre"):
        problem = Problem((800, 400, 500), None, 0.1, surface="faces", most=2, stability=stability)
        view = view_of(problem)
        size = jnp.asarray([[[200], [400], [300]], [[500], [400], [100]]])
        bins = jnp.asarray([[800], [400], [500]])

        @jax.jit
        def places_on_it(instance, view=view):
            kind = jnp.asarray([0])
            state = step(view, reset(view, instance), Choice(kind, kind))
            return positions(view, state, kind + 1, kind)

        places = places_on_it(Instance(size, jnp.ones((2, 1), bool), bins))
        low, high = np.asarray(places.x)[:, 0, 0], np.asarray(places.allowed)[:, 0, 0]
        allowed[stability] = dict(zip(low.tolist(), high.tolist(), strict=True))
    on_it = {stability: places[0] for stability, places in allowed.items()}
    assert on_it == {"share": True, "centre": False}
    assert all(places[200] for places in allowed.values())


@pytest.mark.long
def test_the_shipped_policy_packs_millimetres_whatever_the_unit():
    policy = load_policy("bin-aware-3d-turned")
    network, instances = policy.config.policy, pallets(6, 50)
    problem = without_grid(50)
    play = jax.jit(partial(decide, network, view_of(problem), kinds=6))
    decisions = play(policy.params, instances)
    finer = play(policy.params, pallets(6, 50, scale=2))
    jax.tree.map(np.testing.assert_array_equal, decisions, finer)
    turned = jax.vmap(in_orientation)(instances, decisions.orientation)
    packing = packer(problem)(turned, decisions.order)
    check_packings(problem, turned, decisions.order, packing, "the policy")
    as_given = instances._replace(turned=None)
    volume = jnp.argsort(-as_given.size.prod(-1), axis=1).astype(jnp.int32)
    assert packing.bin.max(1).sum() < packer(problem)(as_given, volume).bin.max(1).sum()
