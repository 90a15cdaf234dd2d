"""What the paper leaves open and what it decides: how sizes are scaled on their way in.

python experiments/input_scale.py     (8 minutes on two cores)

Trains paper-2d for its first epoch (2,000 updates) with the input scales 1, 4 and 10 and three
seeds each, and writes the greedy policies' figures on 1,000 instances beside the height sort's.
"""

import csv
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
from rich.console import Console

from jaxpack import Cell, Comparison, MethodOptions, Policy, compare, make_method, preset
from jaxpack.cli import prepare_jax
from jaxpack.comparison import Row
from jaxpack.io.atomic import replace_file
from jaxpack.learning.pointer import PointerConfig
from jaxpack.learning.trainer import init_state, train_updates

SCALES = (1.0, 4.0, 10.0)
SEEDS = (0, 1, 2)
RESULTS = Path(__file__).parent / "results"


def train_epoch(recipe, keys):
    def run(key):
        state, metrics = train_updates(recipe, init_state(recipe, key), recipe.updates_per_epoch)
        return state.params, metrics

    return jax.jit(jax.vmap(run))(keys)


def row_of(recipe, name: str, params=None) -> Row:
    options = MethodOptions(policy=Policy(recipe, params) if params else None)
    method = make_method("pointer" if params else name, recipe.problem, options)
    cell = Cell(recipe.problem.bin, recipe.distribution)
    return compare(Comparison(recipe.problem), name, method, [cell])[0]


def main() -> None:
    prepare_jax()
    RESULTS.mkdir(exist_ok=True)
    base = preset("paper-2d")
    rows = [("", "", row_of(base, "height"))]
    for scale in SCALES:
        recipe = replace(base, policy=PointerConfig(input_scale=scale))
        keys = jax.vmap(jax.random.key)(jnp.asarray(SEEDS))
        params, _ = train_epoch(recipe, keys)
        for index, seed in enumerate(SEEDS):
            one = jax.tree.map(lambda leaf: leaf[index], params)  # noqa: B023
            rows.append((scale, seed, row_of(recipe, "pointer", one)))
            Console().print(scale, seed, rows[-1][2].compactness, rows[-1][2].bins)
    with replace_file(RESULTS / "input_scale.csv") as file:
        table = csv.writer(file)
        table.writerow(("method", "input_scale", "seed", "compactness", "pyramid", "bins"))
        for scale, seed, row in rows:
            table.writerow((row.method, scale, seed, row.compactness, row.pyramid, row.bins))


if __name__ == "__main__":
    main()
