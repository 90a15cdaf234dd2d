"""Packing as choices, as somebody uses it who writes a training loop of their own."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import packer

from jaxpack import Choice, Distribution, Problem, Table, observe, positions, reset, step
from jaxpack.model.instances import sample
from jaxpack.model.packing_check import check_packings
from jaxpack.model.problem import Packing, in_orientation
from jaxpack.packing.env import decisions_of

PROBLEM = Problem(bin=(7, 6, 8), largest=(4, 4))
ITEMS, BATCH = 14, 16


@pytest.fixture(scope="module")
def instances():
    return sample(PROBLEM, Distribution(ITEMS, 1, 4, "all"), jax.random.key(0), BATCH)


def played(instances, key, free):
    """A random policy: (kind, orientation, bin, corner) of every step, and the kinds.

    Args:
        free: it chooses the position too, and not the rule.
    """
    view = Table(PROBLEM)

    def turn(state, key):
        keys = jax.random.split(key)
        allowed = observe(view, state).allowed
        row = jnp.argmax(jax.random.uniform(keys[0], allowed.shape) * allowed, 0)
        choice, done = state.kinds.choice(row), ~allowed.any(0)
        if free:
            places = positions(view, state, choice.kind, choice.orientation)
            noise = jax.random.uniform(keys[1], places.allowed.shape) * places.allowed
            x, y = jnp.divmod(noise.reshape(-1, BATCH).argmax(0), noise.shape[1])
            choice = Choice(choice.kind, choice.orientation, (x, y))
            corner = (x, y, places.z[x, y, jnp.arange(BATCH)])
        else:
            corner = observe(view, state).candidates.corner
            corner = [jnp.take_along_axis(along, row[None], 0)[0] for along in corner]
        kind = jnp.where(done, ITEMS, choice.kind)
        seen = kind, choice.orientation, state.opened - 1, jnp.stack(corner, -1)
        return step(view, state, choice), seen

    last = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), instances)
    start = reset(view, last)
    end, seen = jax.lax.scan(turn, start, jax.random.split(key, ITEMS))
    return start.kinds, end, seen


def packing_of(order, seen):
    """What the steps placed: they went through the items in their order."""
    _, _, bins, corners = (np.asarray(leaf) for leaf in seen)
    lane = np.arange(BATCH)[:, None]
    bin, position = np.zeros((BATCH, ITEMS), int), np.zeros((BATCH, ITEMS, 3), int)
    bin[lane, order], position[lane, order] = bins.T, corners.swapaxes(0, 1)
    nothing = np.zeros((BATCH, ITEMS), int)
    return Packing(bin, position, nothing, nothing, nothing)


@pytest.mark.parametrize("free", [False, True])
def test_a_random_policy_packs_by_the_rules(instances, free):
    kinds, end, seen = jax.jit(partial(played, free=free))(instances, jax.random.key(1))
    assert not np.asarray(end.remaining).any()
    order, orientation = decisions_of(kinds, *seen[:2])
    turned = jax.vmap(in_orientation)(instances, orientation)
    packing = packing_of(np.asarray(order), seen)
    check_packings(PROBLEM, turned, order, packing, "the random policy")
    assert (np.asarray(orientation) > 0).any()
    again = packer(PROBLEM)(turned, order)
    same = (np.asarray(again.position) == packing.position).all() and (
        np.asarray(again.bin) == packing.bin
    ).all()
    assert same == (not free), "pack fills in the rule's positions, and only those"


def test_what_is_not_allowed_changes_nothing(instances):
    view = Table(PROBLEM)
    last = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), instances)
    state = reset(view, last)
    first = state.kinds.choice(jnp.argmax(observe(view, state).allowed, 0))
    before = jax.jit(partial(step, view))(state, first)
    corner = jnp.zeros(BATCH, jnp.int32)
    places = positions(view, before, first.kind, first.orientation)
    assert np.asarray(places.allowed).any((0, 1)).all()
    for x, y in ((corner + 7, corner), (corner - 1, corner), (corner, corner + 60)):
        after = step(view, before, first._replace(position=(x, y)))
        jax.tree.map(np.testing.assert_array_equal, after, before)
    gone = Choice(jnp.full(BATCH, ITEMS), corner)
    jax.tree.map(np.testing.assert_array_equal, step(view, before, gone), before)


def test_positions_are_where_an_item_comes_to_rest(instances):
    view = Table(PROBLEM)
    last = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), instances)
    state = reset(view, last)
    for _ in range(5):
        choices = observe(view, state)
        row = jnp.argmax(choices.allowed, 0)
        choice = state.kinds.choice(row)
        places = positions(view, state, choice.kind, choice.orientation)
        lowest = np.where(places.allowed, places.z, 99).min((0, 1))
        rule = jnp.take_along_axis(choices.candidates.corner[2], row[None], 0)[0]
        np.testing.assert_array_equal(lowest, rule)
        state = step(view, state, choice)
