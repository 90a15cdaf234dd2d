"""What a sweep costs on one device: its members one after the other in a program, side by side by
`vmap`, and each in a program of its own.

    python benchmarks/train_sweep.py

Takes three minutes on one core.
"""

import time
from functools import partial

import jax
import jax.numpy as jnp

import jaxpack
from jaxpack.cli import prepare_jax
from jaxpack.learning.members import init_members, train_members
from jaxpack.learning.trainer import train_updates
from jaxpack.xla.devices import data_mesh

MEMBERS, UPDATES, ROUNDS = 4, 3, 3


def main():
    prepare_jax()
    recipe = jaxpack.preset("bin-aware-2d")
    start = init_members(recipe, jnp.arange(MEMBERS), jnp.full(MEMBERS, 2e-3), None)
    beside = jax.jit(jax.vmap(partial(train_updates, recipe, updates=UPDATES)))
    alone = jax.jit(partial(train_updates, recipe, updates=UPDATES))

    def each(states):
        for row in range(MEMBERS):
            jax.block_until_ready(alone(jax.tree.map(lambda leaf: leaf[row], states)))  # noqa: B023

    ways = {
        "one after the other": lambda s: train_members(recipe, s, {}, UPDATES, data_mesh()),
        "side by side": beside,
        "each by itself": each,
    }
    taken = {name: [] for name in ways}
    for _ in range(1 + ROUNDS):  # the first one compiles
        for name, way in ways.items():
            states = jax.tree.map(jnp.copy, start)
            began = time.process_time()
            jax.block_until_ready(way(states))
            taken[name].append(time.process_time() - began)
    for name, (first, *others) in taken.items():
        each_update = min(others) / (MEMBERS * UPDATES)
        print(f"{name:20} {each_update:6.3f} s of a core an update, {first:5.1f} s the first time")


if __name__ == "__main__":
    main()
