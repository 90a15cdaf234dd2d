"""One item at a time: places and stability against the independent check, and what may be known."""

import json
from dataclasses import replace
from functools import partial
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpack.errors import UserError
from jaxpack.evaluate import main
from jaxpack.learning.online_value import init_value
from jaxpack.model.box_check import Boxes
from jaxpack.model.online_check import Played, check_online
from jaxpack.model.packing_check import InvalidPackingError
from jaxpack.model.problem import Problem
from jaxpack.model.stability_check import off_centre
from jaxpack.online import OnlineComparison, compare_online, sequences_of
from jaxpack.packing.online import TURNS, Setting, empty, look, place
from jaxpack.packing.online_view import (
    NOWHERE,
    PIECE,
    after,
    at_edges,
    fits,
    places,
    roughness,
    scores,
)
from jaxpack.search.online import RULES, Known, by_rule, choice_of, play, scored, value_rule
from jaxpack.search.online_plan import planned

SMALL = Setting(Problem((6, 6, 6), (3, 3), support=0))
SMALL_ALL = replace(SMALL, turns="all", stable=False)
B = 8


def drawn(setting, count, seed=0, lanes=B):
    """Items int32 [count, 3, lanes]."""
    key = jax.random.key(seed)
    return jax.random.randint(key, (count, 3, lanes), 1, setting.high + 1, jnp.int32)


def keys(lanes=B):
    return jax.random.split(jax.random.key(9), lanes)


def meets(low, high, near, far):
    """Whether a box shares floor with a rectangle."""
    return (low[:2] < far).all() and (high[:2] > near).all()


def plain_offers(setting, laid, item):
    """{(turn, x, y): z} by brute force: boxes (low, high) in a bin, every position tried."""
    found = {}
    L, W, H = setting.problem.bin
    seen = set()
    for turn, axes in enumerate(TURNS[setting.turns]):
        side = np.array([item[axis] for axis in axes])
        if tuple(side) in seen:
            continue
        seen.add(tuple(side))
        for x in range(L - side[0] + 1):
            for y in range(W - side[1] + 1):
                low, high = np.array([x, y]), np.array([x, y]) + side[:2]
                under = [
                    box[1][2]
                    for box in laid
                    if (box[0][:2] < high).all() and (box[1][:2] > low).all()
                ]
                z = max(under, default=0)
                if z + side[2] > H:
                    continue
                boxes = [*laid, (np.array([x, y, z]), np.array([x, y, z]) + side)]
                lows, highs = np.array(boxes).swapaxes(0, 1)
                rows = Boxes(
                    np.zeros(len(boxes), int), lows, highs, np.array([[L, W, H]] * len(boxes))
                )
                if setting.stable and any(off_centre(rows, np.zeros(len(boxes), bool))):
                    continue
                found[turn, x, y] = z
    return found


@pytest.mark.parametrize("setting", [SMALL, SMALL_ALL])
def test_offers_are_what_may_be_placed(setting):
    """Without stability exactly; with it nothing that may tip, and nearly all that does not."""
    state, laid = empty(setting, 1), []
    random, missed, offered = np.random.default_rng(4), 0, 0
    see, put = jax.jit(partial(look, setting)), jax.jit(partial(place, setting))
    for item in random.integers(1, 4, (14, 3)):
        offers = see(state, jnp.asarray(item, jnp.int32)[:, None])
        mine = {
            tuple(map(int, at)): int(offers.z[(*at, 0)])
            for at in np.argwhere(np.asarray(offers.allowed[..., 0]))
        }
        truth = plain_offers(setting, laid, item)
        assert mine.items() <= truth.items()
        offered, missed = offered + len(truth), missed + len(truth) - len(mine)
        if not mine:
            break
        turn, x, y = list(mine)[random.integers(len(mine))]
        number = (turn * 6 + x) * 6 + y
        state = put(state, offers, jnp.array([number]), jnp.array([True]))
        side = np.array([item[axis] for axis in TURNS[setting.turns][turn]])
        low = np.array([x, y, mine[turn, x, y]])
        laid.append((low, low + side))
    assert len(laid) > 6
    assert missed <= (0.03 * offered if setting.stable else 0)


@pytest.mark.parametrize("rule", RULES)
def test_every_rule_packs_by_the_rules(rule):
    for setting in (SMALL, SMALL_ALL):
        items = drawn(setting, 60)
        played = jax.jit(partial(play, setting, by_rule(setting, RULES[rule])))(items, keys())
        batch = [np.moveaxis(np.asarray(leaf), -1, 0) for leaf in played]
        check_online(setting.problem.bin, TURNS[setting.turns], setting.stable,
                     np.moveaxis(np.asarray(items), -1, 0), Played(*batch))  # fmt: skip
        assert ((played.item >= 0).sum(0) > 5).all()
        # It ends with the first item that has no place, and no bin was opened.
        assert (np.diff((played.item >= 0).astype(int), axis=0) <= 0).all()
        assert (played.bin == 0).all()


def test_a_least_z_place_is_the_lowest():
    items = drawn(SMALL, 30)
    played = jax.jit(partial(play, SMALL, by_rule(SMALL, RULES["least-z"])))(items, keys())
    state, see, put = empty(SMALL, B), *(jax.jit(partial(f, SMALL)) for f in (look, place))
    for turn in range(4):
        offers = see(state, items[turn])
        lowest = np.where(offers.allowed & at_edges(SMALL, state, offers), offers.z, 99).min(
            (0, 1, 2)
        )
        np.testing.assert_array_equal(played.corner[turn, 2], lowest)
        side, (x, y, _) = played.sides[turn], played.corner[turn]
        turned = (side != items[turn]).any(0).astype(jnp.int32)
        state = put(state, offers, (turned * 6 + x) * 6 + y, jnp.ones(B, bool))


def random_value(setting):
    """A value that knows nothing, but tells bins apart."""
    params = init_value(setting, jax.random.key(2))
    return params | {"out": jax.random.normal(jax.random.key(3), params["out"].shape) / 10}


def test_nothing_is_known_that_has_not_arrived():
    """Other items later change nothing before: greedy, with a buffer, and planned."""
    params, items = random_value(SMALL), drawn(SMALL, 20, lanes=2)
    others = items.at[9:].set(drawn(SMALL, 11, 5, lanes=2))
    for choose, buffer, lookahead in (
        (by_rule(SMALL, value_rule(params)), 3, 1),
        (planned(SMALL, params, 2, width=3, depth=2), 1, 3),
    ):
        go = jax.jit(partial(play, SMALL, choose, buffer=buffer, lookahead=lookahead))
        before = 9 - max(buffer, lookahead) + 1
        for one, other in zip(go(items, keys(2)), go(others, keys(2)), strict=True):
            np.testing.assert_array_equal(one[:before], other[:before])


def test_a_lookahead_of_one_is_none():
    """To the bit: nothing known beyond the item itself, and no futures, is the greedy policy."""
    params, items = random_value(SMALL), drawn(SMALL, 40, lanes=4)
    greedy = jax.jit(partial(play, SMALL, by_rule(SMALL, value_rule(params))))(items, keys(4))
    for lookahead, same in ((1, True), (3, False)):
        planner = planned(SMALL, params, 0)
        found = jax.jit(partial(play, SMALL, planner, lookahead=lookahead))(items, keys(4))
        alike = [np.array_equal(a, b) for a, b in zip(found, greedy, strict=True)]
        assert all(alike) == same


@pytest.mark.long
@pytest.mark.parametrize("setting", [SMALL, SMALL_ALL])
def test_a_plan_takes_what_is_best_in_the_mean_of_all_items_that_may_come(setting):
    """One by one, in every way to write them down, and not one for all that are alike."""
    params, width = random_value(setting), 4
    score, state, lanes = value_rule(params), empty(setting, 3), 3

    @jax.jit
    def filled(state, item):
        choice = by_rule(setting, score)(state, Known(item[None], item[:0, None]), keys(lanes))
        return place(setting, state, choice.offers, choice.number, choice.there)

    for item in drawn(setting, 4, lanes=lanes):
        state = filled(state, item)
    held = drawn(setting, 1, 7, lanes)
    every, numbers, scores = jax.jit(partial(scored, setting, score))(state, held)
    rows = np.argsort(-np.asarray(scores), 0, kind="stable")[:width]
    sums = np.zeros((width, lanes))
    best = jax.jit(lambda state, item: scored(setting, score, state, item[None])[2].max(0))
    for number, row in enumerate(rows):
        choice = choice_of(setting, every, numbers, jnp.asarray(row))
        after = place(setting, state, choice.offers, choice.number, choice.there)
        for sides in product(range(1, 4), repeat=3):
            item = jnp.broadcast_to(jnp.asarray(sides)[:, None], (3, lanes))
            most = np.asarray(best(after, item))
            sums[number] += np.where(most > NOWHERE, most, 0)
        assert choice.there.all()
    wanted = rows[sums.argmax(0), range(lanes)]
    known = Known(held, held[:0])
    found = jax.jit(planned(setting, params, None, width))(state, known, keys(lanes))
    np.testing.assert_array_equal(found.number, np.asarray(numbers)[wanted, range(lanes)])


def test_many_bins_hold_all():
    items = drawn(SMALL_ALL, 40)
    choose = by_rule(SMALL_ALL, RULES["flattest"])
    played = jax.jit(partial(play, SMALL_ALL, choose, many=True))(items, keys())
    batch = [np.moveaxis(np.asarray(leaf), -1, 0) for leaf in played]
    check_online(
        (6, 6, 6), TURNS["all"], False, np.moveaxis(np.asarray(items), -1, 0), Played(*batch)
    )
    assert (np.sort(batch[0], 1)[:, -40:] == np.arange(40)).all()
    assert batch[1].max() > 0


def test_the_check_finds_what_is_wrong():
    items = drawn(SMALL, 40)
    played = jax.jit(partial(play, SMALL, by_rule(SMALL, RULES["flattest"])))(items, keys())
    right = Played(*(np.moveaxis(np.asarray(leaf), -1, 0) for leaf in played))
    item, bins, sides, corner = right
    given = np.moveaxis(np.asarray(items), -1, 0)

    def damaged(what, **changes):
        wrong = right._replace(**changes)
        with pytest.raises(InvalidPackingError, match=what):
            check_online((6, 6, 6), TURNS["upright"], True, given, wrong)

    twice, early = item.copy(), item.copy()
    twice[0, 1] = 0
    early[0, :2] = early[0, 1::-1]
    damaged("placed twice", item=twice)
    damaged("before it had arrived", item=early)
    lying = sides.copy()
    lying[0, 0] += 1
    damaged("orientation", sides=lying)
    up, out = corner.copy(), corner.copy()
    up[0, 0, 2] += 1
    out[0, 0, 0] = 6
    damaged("floating", corner=up)
    damaged("outside", corner=out)
    later = bins.copy()
    later[0, 0] = 1
    damaged("opened again", bin=later)
    tower = np.array([[[1, 1, 1], [3, 1, 1]]])
    on_one_end = np.array([[[0, 0, 0], [0, 0, 1]]])
    laid = Played(np.array([[0, 1]]), np.zeros((1, 2), int), tower, on_one_end)
    with pytest.raises(InvalidPackingError, match="stands firm"):
        check_online((6, 6, 6), TURNS["upright"], True, tower, laid)


def test_what_footprints_find():
    """Against every window looked at by hand."""
    random = np.random.default_rng(1)
    heights = random.integers(0, 3, (6, 6, 5)).astype(np.int8)
    firm = random.random((6, 6, 5)) < 0.9
    found = fits(SMALL, jnp.asarray(heights), jnp.asarray(firm), (3, 3))
    steps, number = roughness(jnp.asarray(heights))
    for b in range(5):
        level, solid = heights[..., b].astype(int), firm[..., b]
        for f, (length, width) in enumerate(product((1, 2, 3), repeat=2)):
            parts = [
                (slice(x, x + length), slice(y, y + width))
                for x in range(7 - length)
                for y in range(7 - width)
            ]
            windows = [(level[part], solid[part]) for part in parts]
            flat = [h.max() for h, s in windows if h.min() == h.max() and s.all()]
            assert found.flat[f, b] == min(flat, default=6)
            assert found.flats[f, b] == len(flat)
            assert found.space[f, b] == sum(6 - h for h in flat)
            assert found.lowest[f, b] == min(h.max() for h, _ in windows)
        both = np.abs(np.diff(level, axis=0)), np.abs(np.diff(level, axis=1))
        assert steps[b] == sum(step.sum() for step in both)
        assert number[b] == sum((step > 0).sum() for step in both)


def test_places_are_the_lowest_at_edges():
    items = drawn(SMALL, 12)
    played = jax.jit(partial(play, SMALL, by_rule(SMALL, RULES["least-z"])))(items[:8], keys())
    state, see = empty(SMALL, B), jax.jit(partial(look, SMALL))
    offers = see(state, items[8])
    found = jax.jit(partial(places, SMALL))(state, offers)
    # In an empty bin: the four corners of the floor, for each orientation that looks different.
    same = np.asarray(items[8][0] == items[8][1])
    np.testing.assert_array_equal(found.there.sum(0), np.where(same, 4, 8))
    assert played.item.shape == (8, B)


def test_bins_side_by_side_are_looked_at_as_alone():
    """Places in pieces, the last of them not full, of bins with few places and with many."""
    lanes = 24
    items, alone = drawn(SMALL_ALL, 9, lanes=lanes), jax.jit(partial(look, SMALL_ALL))
    params = init_value(SMALL_ALL, jax.random.key(5))
    # Positive, so that no difference of large terms is left to rounding.
    params["out"] = jnp.abs(jax.random.normal(jax.random.key(6), params["out"].shape))
    score = value_rule(params)
    see, judge = (jax.jit(partial(f, SMALL_ALL)) for f in (places, partial(scores, score=score)))
    state, put = empty(SMALL_ALL, lanes), jax.jit(partial(place, SMALL_ALL))
    for item in items[:8]:
        offers = alone(state, item)
        first = see(state, offers)
        may = first.there[0] & (jnp.arange(lanes) % 4 > 0)  # every fourth stays empty
        state = put(state, offers, first.number[0], may)
    found = see(state, alone(state, items[8]))
    assert 2 * PIECE < found.there.sum() < found.there.size
    together = judge(state=state, found=found)
    for b in range(lanes):
        one = jax.tree.map(lambda leaf, b=b: leaf[..., b : b + 1], (state, found))
        np.testing.assert_allclose(judge(state=one[0], found=one[1])[:, 0], together[:, b], 2e-5)
    offers = alone(state, items[8])
    for row in (0, 3):
        there = jax.tree.map(lambda leaf, row=row: leaf[row], found)
        then = put(state, offers, there.number, there.there)
        heights, _ = jax.jit(partial(after, SMALL_ALL))(state, there)
        same = (heights == then.heights[:6, :6]).all((0, 1))
        assert same[there.there].all()
        assert there.there.any()
    assert (together[~found.there] == NOWHERE).all()


def test_a_bin_may_have_fewer_places_than_are_looked_at():
    tiny = Setting(Problem((4, 4, 4), (2, 2), support=0))
    assert tiny.most > 2 * 4 * 4
    items = drawn(tiny, 30)
    played = jax.jit(partial(play, tiny, by_rule(tiny, RULES["least-z"])))(items, keys())
    batch = [np.moveaxis(np.asarray(leaf), -1, 0) for leaf in played]
    check_online((4, 4, 4), TURNS["upright"], True, np.moveaxis(np.asarray(items), -1, 0),
                 Played(*batch))  # fmt: skip
    assert ((played.item >= 0).sum(0) > 3).all()


@pytest.mark.slow
def test_the_value_fills_more_than_the_rules():
    """On sequences that it was not trained on, each packing checked."""
    rows = [
        compare_online(OnlineComparison(setting, sequences=48, batch=16), name)
        for setting in ("online-1", "online-2")
        for name in ("flattest", "online")
    ]
    use = [row.use for row in rows]
    assert use[1] > use[0] + 0.05
    assert use[3] > use[2] + 0.05
    assert use[1] > 0.75
    assert use[3] > 0.85


def test_a_sequence_depends_on_the_seed_and_its_number_alone():
    few, more = (sequences_of(OnlineComparison("online-3", n)) for n in (3, 7))
    np.testing.assert_array_equal(few, more[:3])
    assert (sequences_of(OnlineComparison("online-3", 3, seed=1)) != few).any()
    assert {1, 2, 3, 4, 5} == set(np.unique(more))


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("online-1 --methods pointer", "unknown method 'pointer': choose from least-z"),
        ("online-1 --rule most-contact", "--rule: not for online-1"),
        ("online-1 --items 10,20", "give one number for online-1"),
        ("online-1 --buffer 0", "buffer 0"),
        ("online-4", "unknown preset 'online-4': choose online-1, online-2, online-3"),
        ("bin-aware-2d --lookahead 2", "--lookahead: only for online-1, online-2, online-3"),
    ],
)
def test_the_command_refuses_what_does_not_go_together(command, message):
    with pytest.raises(UserError, match=message):
        main(command.split())


@pytest.mark.long
def test_the_command_writes_its_rows(tmp_path):
    path = tmp_path / "rows.json"
    given = f"--methods least-z,online --instances 20 --json {path}"
    main(["online-3", *given.split()])
    rows = json.loads(path.read_text())
    assert [row["method"] for row in rows] == ["least-z", "online"]
    assert all(row["sequences"] == 20 and 0.5 < row["use"] < 1 for row in rows)
