"""Instances per second of an evaluation, by method, beside the fastest sort."""

from benchmarks.timing import report
from jaxpack.comparison import Comparison, compare
from jaxpack.learning.presets import preset
from jaxpack.methods import MethodOptions, make_method
from jaxpack.model.instances import Cell

METHODS = ("height", "pointer", "bin-aware", "bin-aware-best-of-64", "brkga")
INSTANCES = 200


def main() -> None:
    rows = []
    for name in ("bin-aware-2d", "bin-aware-3d"):
        recipe = preset(name)
        comparison = Comparison(recipe.problem, instances=INSTANCES)
        cell = Cell(recipe.problem.bin, recipe.distribution)
        options = MethodOptions(kinds=recipe.kinds)
        sort = None
        for method_name in METHODS:
            method = make_method(method_name, recipe.problem, options)
            (row,) = compare(comparison, method_name, method, [cell])
            speed = 1e3 / row.ms_per_instance
            sort = sort or speed
            rows.append(
                {
                    "problem": name,
                    "method": method_name,
                    "bins": row.bins,
                    "instances/s": speed,
                    "times the sort's time": sort / speed,
                }
            )
    report("sweeps", rows)
