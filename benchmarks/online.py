"""Decisions per second of the greedy value, one item at a time, 1,024 bins side by side.

Bins are filled as in training, without an end: one that has no place for its next item is emptied.
Rows by devices: one core, and all of them, each with a part of the bins.
"""

from functools import partial
from itertools import product

import jax
import jax.numpy as jnp
from jax import Array

from benchmarks.timing import compiled, report, seconds
from jaxpack.learning.online_value import greedy_step
from jaxpack.packing.online import SETTINGS, State, empty
from jaxpack.search.online import LANES, shipped_value
from jaxpack.xla.devices import by_batch, data_mesh, split_batch

BINS, STEPS = 1024, 4


def main(repeats: int = 5) -> None:
    devices = sorted({1, len(jax.local_devices())})
    kinds = product(("online-1", "online-2"), devices)
    report("online", [measured(name, count, repeats) for name, count in kinds])


def measured(name: str, devices: int, repeats: int) -> dict:
    setting, params = SETTINGS[name], shipped_value(name)
    fresh = empty(setting, LANES)

    def fill(bins: State, key: Array) -> State:
        def one(bins: State, key: Array) -> tuple[State, None]:
            items = jax.random.randint(key, (3, LANES), 1, setting.high + 1)
            step = greedy_step(setting, params, bins, items)
            return jax.tree.map(partial(jnp.where, step.fits), step.state, fresh), None

        return jax.lax.scan(one, bins, jax.random.split(key, STEPS))[0]

    mesh = data_mesh(devices)
    pieces = split_batch(mesh, lambda *of: jax.lax.map(lambda one: fill(*one), of))
    bins = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (BINS // LANES, *leaf.shape)), fresh)
    keys = jax.random.split(jax.random.key(0), BINS // LANES)
    bins, keys = jax.device_put((bins, keys), by_batch(mesh))
    run, compile_seconds = compiled(pieces, bins, keys)
    for _ in range(10):  # until the bins are as full as they are in the mean
        bins = run(bins, keys)
    took = seconds({"run": partial(run, bins, keys)}, repeats)["run"]
    return {
        "setting": name,
        "bins": BINS,
        "devices": devices,
        "decisions/s": BINS * STEPS / took,
        "us a decision": took / BINS / STEPS * 1e6,
        "compile, s": compile_seconds,
    }
