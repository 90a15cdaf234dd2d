"""Pictures like the paper's Fig. 7 and 8: one instance, packed by four methods, as PNG.

python experiments/pictures.py        (half a minute on two cores)
"""

from pathlib import Path

import jax

from jaxpack import Cell, Comparison, MethodOptions, load_policy, make_method, pack, preset
from jaxpack.cli import use_compilation_cache
from jaxpack.comparison import make_instances
from jaxpack.files.pictures import draw_packings

METHODS = ("random", "volume", "brkga", "pointer")
RESULTS = Path(__file__).parent / "results"


def main() -> None:
    use_compilation_cache()
    RESULTS.mkdir(exist_ok=True)
    for dimension in ("2d", "3d"):
        recipe = preset(f"paper-{dimension}")
        options = MethodOptions(policy=load_policy(f"pointer-{dimension}"))
        # The first instance of the tables, whatever it shows.
        comparison = Comparison(recipe.problem, instances=1, seed=0)
        cell = Cell(recipe.problem.bin, recipe.distribution)
        pairs = make_instances(comparison, cell, recipe.distribution.items)
        instance, key = jax.tree.map(lambda leaf: leaf[0], pairs)
        packings = []
        for name in METHODS:
            order = jax.jit(make_method(name, recipe.problem, options))(key, instance)
            packings.append((name, pack(recipe.problem, instance, order)))
        draw_packings(RESULTS / f"packings-{dimension}.png", instance, packings)


if __name__ == "__main__":
    main()
