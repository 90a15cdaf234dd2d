"""Pictures like the paper's Fig. 7 and 8: one instance, packed by four methods, as PNG.

python experiments/pictures.py        (half a minute on two cores)
"""

from pathlib import Path

import jax

from jaxpack import Cell, Comparison, MethodOptions, make_method, pack, preset
from jaxpack.cli import prepare_jax
from jaxpack.comparison import make_instances
from jaxpack.io.pictures import draw_packings

METHODS = ("random", "height", "pointer", "bin-aware-search")
RESULTS = Path(__file__).parent / "results"


def main() -> None:
    prepare_jax()
    RESULTS.mkdir(exist_ok=True)
    for dimension in ("2d", "3d"):
        recipe = preset(f"paper-{dimension}")
        options = MethodOptions(kinds=recipe.kinds)
        # The first instance of the tables, whatever it shows.
        comparison = Comparison(recipe.problem, instances=1, seed=0)
        cell = Cell(recipe.problem.bin, recipe.distribution)
        instances, keys = make_instances(comparison, cell, recipe.distribution.items)
        instance = jax.tree.map(lambda leaf: leaf[0], instances)
        packings = []
        for name in METHODS:
            orders = jax.jit(make_method(name, recipe.problem, options).orders)(keys, instances)
            packings.append((name, instance, pack(recipe.problem, instance, orders[0])))
        draw_packings(RESULTS / f"packings-{dimension}.png", packings)


if __name__ == "__main__":
    main()
