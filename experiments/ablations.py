"""Does every ingredient of the bin-aware policy earn its place? One variant at a time, one budget.

python experiments/ablations.py 2d --updates 80      (one minute a variant on one core)
python experiments/ablations.py 3d --updates 80      (3 minutes a variant)

Trains by the recipe of the shipped policies with one thing changed, all with the same number of
updates and of sampled orders, and writes the greedy figures on 1,000 instances (the tables',
seed 0) to results/ablations-2d.csv or -3d.csv, a line as soon as a variant is done.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import jax
import jax.numpy as jnp
import tyro
from rich.console import Console
from rows import RESULTS, read_rows, rounded, write_rows
from tyro.conf import Positional

from jaxpack import Cell, Comparison
from jaxpack.cli import prepare_jax
from jaxpack.comparison import make_instances
from jaxpack.learning.presets import LONG, LONG_3D
from jaxpack.learning.trainer import init_state, train_chunk
from jaxpack.model.metrics import bins_used, compactness, pyramid
from jaxpack.packing.first_fit import pack_decisions

# Changes of the network, changes of the recipe.
VARIANTS: dict[str, tuple[dict, dict]] = {
    "as the shipped policy": ({}, {}),
    "sizes only, the bin as a histogram": ({"sees": "sizes"}, {}),
    "no look under and beside": ({"sees": "stock"}, {}),
    "blind to what fills a gap exactly": ({"sees": "surroundings"}, {}),
    "sees what fills a gap exactly": ({"sees": "all"}, {}),
    "no pooling": ({"pooling": False}, {}),
    "attention, 4 heads": ({"attention": 4}, {}),
    "width 32": ({"hidden": 32}, {}),
    "width 128": ({"hidden": 128}, {}),
    "no entropy bonus": ({}, {"entropy": 0.0}),
    "entropy bonus 0.01": ({}, {"entropy": 0.01}),
    "constant rate": ({}, {"schedule": "constant"}),
    "rate 5e-3": ({}, {"learning_rate": 5e-3}),
    "no clipping": ({}, {"clip": 0.0}),
    "4 samples of twice the instances": ({}, {"samples": 4, "batch": 128}),
    "16 samples of half the instances": ({}, {"samples": 16, "batch": 32}),
    "credit by bin": ({}, {"learner": "leave-one-out-by-bin"}),
    "credit by order": ({}, {"learner": "leave-one-out"}),
    "self-labelling": ({}, {"learner": "self-label"}),
    "objective R": (
        {},
        {"objective": "paper", "alpha": 0.5, "beta": 0.5, "learner": "leave-one-out"},
    ),
}


@dataclass(frozen=True)
class Options:
    """Train the variants of one dimension."""

    dimension: Positional[Literal["2d", "3d"]]
    """2d or 3d."""
    updates: int = 80
    """Updates of every variant."""
    seed: int = 0
    """Of the weights, the data and the samples."""
    only: tuple[str, ...] = ()
    """Beginnings of the names of the variants to train and add to the file; all if not given."""


def greedy_figures(recipe, params) -> dict[str, float]:
    """Means of the greedy policy on the 1,000 instances of the tables."""
    return {name: float(mean) for name, mean in _measure(recipe)(params).items()}


@cache
def _measure(recipe) -> Callable:
    comparison = Comparison(recipe.problem)
    cell = Cell(recipe.problem.bin, recipe.distribution)
    instances, _ = make_instances(comparison, cell, recipe.distribution.items)

    @jax.jit
    def measure(params):
        decided = recipe.policy.orders(recipe.problem, params, instances, kinds=recipe.kinds)
        _, packings = pack_decisions(recipe.problem, instances, decided)
        return {
            "compactness": jax.vmap(compactness)(instances, packings).mean(),
            "pyramid": jax.vmap(pyramid)(packings).mean(),
            "bins": jax.vmap(bins_used)(packings).mean(),
        }

    return measure


def main() -> None:
    prepare_jax()
    options = tyro.cli(Options)
    base = {"2d": LONG, "3d": LONG_3D}[options.dimension]
    path = RESULTS / f"ablations-{options.dimension}.csv"
    kept = read_rows(path) if options.only else []
    rows = {row["variant"]: row for row in kept}
    for name, (network, changes) in VARIANTS.items():
        recipe = replace(base, policy=replace(base.policy, **network), **changes)
        chosen = not options.only or name.startswith(options.only)
        if not chosen or (name != "as the shipped policy" and recipe == base):
            continue
        recipe = replace(recipe, epochs=1, train_instances=options.updates * recipe.batch)
        state = init_state(recipe, jax.random.key(options.seed))
        start = time.perf_counter()
        state, metrics = train_chunk(recipe, state, options.updates)
        jax.block_until_ready(state)
        row = {"variant": name} | greedy_figures(recipe, state.params)
        row |= {
            "sampled_bins": float(metrics.outcome.bins),
            "seconds": time.perf_counter() - start,
            "parameters": sum(jnp.size(leaf) for leaf in jax.tree.leaves(state.params)),
            "updates": options.updates,
            "seed": options.seed,
        }
        rows[name] = row
        Console().print(rounded(row))
        write_rows(path, (rows[name] for name in VARIANTS if name in rows))


if __name__ == "__main__":
    main()
