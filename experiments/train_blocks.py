"""Trains the policy that chooses blocks, over made orders, and puts it into the package.

python experiments/train_blocks.py [--minutes 10] [--seed 0] [--orders 1024] [--save PATH]

An update is one XLA program: it picks orders, fills a bin of each with every one of some policies
around the present one, in pairs that differ by opposite noise, and moves the weights towards those
that packed more than the others did of the same order (the score function's gradient in the space
of the weights, the mean of an order's policies being the baseline; Salimans et al., 2017). No set
of real orders is among what it sees. Prints a line every twenty updates: the mean share of the bin
that the policy fills greedily on orders that it is not trained on, beside the hand-made score.
"""

import argparse
import json
import platform
import time
from itertools import permutations
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxpack
from jaxpack.cli import prepare_jax
from jaxpack.io.atomic import replace_file
from jaxpack.model.encoding import load_job
from jaxpack.model.job import ORIENTATIONS, BinType, ItemType, Job
from jaxpack.model.rules import Rules
from jaxpack.search import filling
from jaxpack.search.block_policy import FEATURES, HIDDEN, Weights
from jaxpack.search.blocks import step
from jaxpack.search.draws import drawn
from jaxpack.search.filling import FAR, Goods
from jaxpack.search.fillings import kinds_of

KINDS, BLOCKS, LONGEST, WAYS = 8, 32, 1664, 6
"""Most kinds, blocks and units along an axis of a made order; orientations."""
AXES = tuple(permutations(range(3)))
ROOMS = (
    # sides in cm or mm, and those of the items from shortest to longest
    ((589, 233, 239), (10, 150)),  # containers
    ((1203, 235, 269), (20, 160)),
    ((587, 233, 220), (20, 130)),
    ((1200, 800, 1500), (80, 700)),  # pallets
    ((800, 600, 1600), (80, 520)),
    ((600, 400, 400), (40, 330)),  # cartons
    ((400, 300, 300), (30, 260)),
    ((350, 250, 150), (20, 220)),
)
SUPPORTS = (0.0, 0.5, 0.5, 0.5, 1.0)
NOISE, HIDDEN_NOISE, RATE = 0.03, 0.09, 0.25
"""Of the weights that go out of the network, of those into it, and steps in units of these."""
PAIRS, BATCH = 4, 32  # policies of an order, orders of an update
EVERY, TESTS = 20, 256


def made_order(random: np.random.Generator) -> tuple[Job, float]:
    """An order of up to eight kinds that is a little more than its bin holds, and the support.

    The bin is one of `ROOMS`; a kind's sides lie between log-uniform ones of its own and those of
    all kinds; of six orders four may be turned in all ways, the others stand upright.
    """
    room, range_of_sides = ROOMS[random.integers(len(ROOMS))]
    low, high = np.log(range_of_sides)
    K, alike = int(random.integers(1, KINDS + 1)), random.uniform()
    sides = alike * random.uniform(low, high, 3) + (1 - alike) * random.uniform(low, high, (K, 3))
    sides = np.clip(np.round(np.exp(sides)), 1, room)
    volume = random.uniform(0.9, 1.6) * np.prod(room) * random.dirichlet(np.ones(K))
    copies = np.clip(np.round(volume / sides.prod(1)), 1, 400).astype(int)
    ways = tuple(ORIENTATIONS) if random.random() < 0.6 else ("XYZ", "YXZ")
    items = tuple(
        ItemType(tuple(map(float, side)), int(many), orientations=ways)
        for side, many in zip(sides, copies, strict=True)
    )
    bins = (BinType(tuple(map(float, room)), copies=1),)
    return Job(items, bins, objective="value"), float(random.choice(SUPPORTS))


def made_goods(count: int, seed: int) -> Goods:
    """So many orders as lanes; half of them with the noise that draws of a bin have."""
    random = np.random.default_rng(seed)
    lanes, tables = list[Goods](), list[np.ndarray]()
    while len(lanes) < count:
        job, support = made_order(random)
        kinds = kinds_of(load_job(job, Rules(support)))
        if kinds.axes != AXES:  # every item is another
            continue
        which = np.arange(KINDS)[:, None]
        there = which < len(kinds.count)
        own = np.where(there, which, 0)
        left, value = (np.where(there, of[own], 0) for of in (kinds.count, kinds.size))
        sums = kinds.sums(kinds.count)
        tables.append(np.pad(sums, ((0, 0), (0, LONGEST - sums.shape[1])), mode="edge"))
        draw, zero = np.array([4 * random.integers(2)]), np.array([0])
        goods, _ = drawn(
            kinds, np.where(there, which, -1), value, left, zero, tables[-1], zero, draw, random
        )
        lanes.append(
            goods._replace(
                side=_six_ways(goods.side, kinds.ways, FAR),
                needed=_six_ways(goods.needed, kinds.ways, 1),
                value=_six_ways(goods.value, kinds.ways, 0),
                less=_six_ways(goods.less, kinds.ways, 0),
                first=(goods.first + 3 * LONGEST * len(lanes)).astype(np.int32),
            )
        )
    shared = {"sums": np.concatenate(tables).ravel(), "unit": np.int32(1)}
    names = [name for name in Goods._fields if name not in shared]
    columns = {name: np.concatenate([getattr(one, name) for one in lanes], -1) for name in names}
    return Goods(**jax.tree.map(jnp.asarray, columns | shared))


def _six_ways(table: np.ndarray, ways: int, filler: int) -> np.ndarray:
    """[..., KINDS ways, 1] as [..., KINDS WAYS, 1]."""
    table = table.reshape(*table.shape[:-2], KINDS, ways, 1)
    more = [(0, 0)] * (table.ndim - 2) + [(0, WAYS - ways), (0, 0)]
    table = np.pad(table, more, constant_values=filler)
    return table.reshape(*table.shape[:-3], KINDS * WAYS, 1)


def filled_shares(goods: Goods, weights: Weights) -> Array:
    """The share of its bin that each lane fills greedily, a policy of its own in each: [P]."""
    P = goods.room.shape[1]

    def judge(seen: Array) -> Array:
        blocks = seen.reshape(FEATURES, -1, P)
        inner = jnp.einsum("fnp,fhp->hnp", blocks, weights.hidden) + weights.bias[:, None]
        return (jnp.maximum(inner, 0) * weights.out[:, None]).sum(0).ravel()

    full = jax.lax.while_loop(
        lambda now: filling.goes_on(now).any(),
        lambda now: step(jnp, AXES, goods, now, judge=judge),
        filling.empty(jnp, goods, BLOCKS),
    )
    first = goods.side.reshape(3, KINDS, WAYS, P)[:, :, 0].astype(jnp.float32)
    volume = jnp.where(goods.count > 0, first.prod(0), 0)
    packed = (volume * (goods.count - full.left)).sum(0)
    return packed / goods.room.astype(jnp.float32).prod(0)


class State(NamedTuple):
    """Of the training: leaves of `Weights`."""

    weights: Weights
    mean: Weights  # of the gradients (Adam)
    square: Weights


NOISES = Weights(HIDDEN_NOISE, HIDDEN_NOISE, NOISE)


@jax.jit
def update(goods: Goods, state: State, key: Array, number: Array, rate: Array) -> State:
    """The state after one batch."""
    of_orders, of_weights = jax.random.split(key)
    orders = jax.random.randint(of_orders, (BATCH,), 0, goods.room.shape[1])
    lanes = jnp.repeat(orders, 2 * PAIRS)

    def opposite(key: Array, leaf: Array) -> Array:
        noise = jax.random.normal(key, (*leaf.shape, BATCH * PAIRS))
        return jnp.stack([noise, -noise], -1).reshape(*leaf.shape, -1)

    keys = Weights(*jax.random.split(of_weights, len(NOISES)))
    noise = jax.tree.map(opposite, keys, state.weights)
    tried = jax.tree.map(lambda leaf, e, size: leaf[..., None] + size * e,
                         state.weights, noise, NOISES)  # fmt: skip
    shares = filled_shares(filling.some_lanes(goods, lanes), tried).reshape(BATCH, -1)
    gain = (shares - shares.mean(1, keepdims=True)) / (shares.std() + 1e-6)
    gradient = jax.tree.map(lambda e: (e * gain.ravel()).mean(-1), noise)
    mean = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, state.mean, gradient)
    square = jax.tree.map(lambda s, g: 0.99 * s + 0.01 * g**2, state.square, gradient)

    def moved(leaf: Array, m: Array, s: Array, size: float) -> Array:
        m, s = m / (1 - 0.9**number), s / (1 - 0.99**number)
        return leaf + rate * size * m / (jnp.sqrt(s) + 1e-8)

    return State(jax.tree.map(moved, state.weights, mean, square, NOISES), mean, square)


def first_weights(seed: int) -> Weights:
    """That add nothing."""
    random = np.random.default_rng(seed)
    hidden = random.normal(0, 6**-0.5, (FEATURES, HIDDEN))
    leaves = hidden, random.normal(0, 0.3, HIDDEN), np.zeros(HIDDEN)
    return Weights(*(jnp.asarray(leaf, jnp.float32) for leaf in leaves))


def write(path: Path, weights: Weights, record: dict[str, Any]) -> None:
    """Weights of five decimals, with where they come from."""
    leaves = {
        name: np.round(np.asarray(leaf, float), 5).tolist()
        for name, leaf in weights._asdict().items()
    }
    with replace_file(path, "w") as file:
        file.write(json.dumps(record | leaves, indent=1) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--orders", type=int, default=1024)
    shipped = Path(jaxpack.__file__).parent / "weights" / "blocks.json"
    parser.add_argument("--save", type=Path, default=shipped)
    options = parser.parse_args()
    prepare_jax()
    goods = made_goods(options.orders, options.seed + 1)
    tests = made_goods(TESTS, options.seed + 2)

    @jax.jit
    def tested(goods: Goods, weights: Weights) -> Array:
        every = jax.tree.map(lambda leaf: jnp.repeat(leaf[..., None], TESTS, -1), weights)
        return filled_shares(goods, every)

    weights = first_weights(options.seed)
    nothing = jax.tree.map(jnp.zeros_like, weights)
    state, keys = State(weights, nothing, nothing), jax.random.key(options.seed)
    by_hand, began, number = tested(tests, weights), time.perf_counter(), 0
    print(f"by hand {by_hand.mean():.4f}", flush=True)
    while (passed := (time.perf_counter() - began) / (60 * options.minutes)) < 1:
        number += 1
        key = jax.random.fold_in(keys, number)
        rate = jnp.float32(RATE * (1 - 0.8 * passed))
        state = jax.block_until_ready(update(goods, state, key, jnp.float32(number), rate))
        if number % EVERY == 0:
            shares = tested(tests, state.weights)
            print(f"{number} {60 * options.minutes * passed:.0f} s {shares.mean():.4f}", flush=True)
    record = {
        "command": f"python experiments/train_blocks.py --minutes {options.minutes:g} "
        f"--seed {options.seed} --orders {options.orders}",
        "machine": f"one {jax.default_backend()} device, {platform.machine()}",
        "updates": number,
        "greedy_by_hand": round(float(by_hand.mean()), 4),
        "greedy": round(float(tested(tests, state.weights).mean()), 4),
    }
    write(options.save, state.weights, record)


if __name__ == "__main__":
    main()
