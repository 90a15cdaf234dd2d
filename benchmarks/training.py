"""Updates per second of the presets, and what an update is made of.

Decoding draws the orders of an update, placement packs them, each compiled alone; the rest of an
update is the backward pass, the baseline and Adam.
"""

from functools import partial

import jax
import jax.numpy as jnp

from benchmarks.timing import compiled, report, seconds
from jaxpack import pack, preset
from jaxpack.learning.trainer import init_state, train_updates, training_instances

PRESETS = ("paper-2d", "paper-3d", "bin-aware-2d", "bin-aware-3d")


def main(repeats: int = 5) -> None:
    rows = []
    for name in PRESETS:
        recipe = preset(name)
        state = init_state(recipe, jax.random.key(0))
        drawn = training_instances(recipe, state.key, jnp.arange(recipe.batch))
        instances = jax.tree.map(lambda leaf, s=recipe.samples: jnp.repeat(leaf, s, 0), drawn)
        keys = jax.random.split(jax.random.key(1), recipe.batch * recipe.samples)
        choose = partial(recipe.policy.orders, recipe.problem, kinds=recipe.kinds)
        decode, _ = compiled(choose, state.params, instances, keys)
        orders = decode(state.params, instances, keys).order
        place, _ = compiled(jax.vmap(partial(pack, recipe.problem)), instances, orders)
        update, compile_seconds = compiled(partial(train_updates, recipe, updates=1), state)
        took = seconds(
            {
                "decode": partial(decode, state.params, instances, keys),
                "place": partial(place, instances, orders),
                "update": partial(update, state),
            },
            repeats,
        )
        rest = took["update"] - took["decode"] - took["place"]
        rows.append(
            {
                "preset": name,
                "orders": recipe.batch * recipe.samples,
                "updates/s": 1 / took["update"],
                "decoding, %": 100 * took["decode"] / took["update"],
                "placement, %": 100 * took["place"] / took["update"],
                "the rest, %": 100 * rest / took["update"],
                "compile, s": compile_seconds,
            }
        )
    report("training", rows)
