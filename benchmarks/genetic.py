"""Evaluations per second of BRKGA, beside pymoo's with the same decoder compiled by Numba.

Same population, generations, shares and cost. pymoo decodes a generation at once, on all cores;
ours has as many instances side by side as a row says, on a device per core; the packings of a
single one's generation are shared out among the devices.
"""

from functools import partial

import jax
import numba
import numpy as np
from pymoo.algorithms.soo.nonconvex.brkga import BRKGA
from pymoo.core.problem import Problem as PymooProblem
from pymoo.optimize import minimize

from benchmarks.native import pack_native
from benchmarks.timing import compiled, cores, report, seconds
from jaxpack import pack, preset, sample
from jaxpack.model.metrics import bins_first_cost
from jaxpack.search.breeding import BrkgaConfig
from jaxpack.search.brkga import brkga
from jaxpack.xla.devices import by_batch, data_mesh, on_all, split_batch

CONFIG = BrkgaConfig(population=100, generations=30)
BATCHES = (1, 16, 128)


@numba.njit(parallel=True)
def _costs(bin, size, bins, position):
    """`bins_first_cost` of every packing: bins + 0.5 (1 - C) + 0.05 (1 - P), float64 [B]."""
    costs = np.empty(len(bins))
    for b in numba.prange(len(bins)):
        used = bins[b].max() + 1
        compactness, pyramid = 0.0, 0.0
        for slot in range(used):
            heights = np.zeros((bin[1], bin[0]), np.int32)
            volume = 0
            for item in range(len(size)):
                if bins[b, item] == slot:
                    x, y, z = position[b, item]
                    length, width, height = size[item]
                    volume += length * width * height
                    part = heights[y : y + width, x : x + length]
                    part[:] = np.maximum(part, z + height)
            compactness += volume / (bin[0] * bin[1] * heights.max())
            pyramid += volume / heights.sum()
        costs[b] = used + 0.5 * (1 - compactness / used) + 0.05 * (1 - pyramid / used)
    return costs


class Packing(PymooProblem):
    """One instance; a row of variables is a key per item."""

    def __init__(self, problem, size):
        super().__init__(n_var=len(size), n_obj=1, xl=0.0, xu=1.0)
        self.problem, self.size = problem, size

    def _evaluate(self, keys, out, *_args, **_kwargs):
        orders = np.argsort(keys, 1).astype(np.int32)
        sizes = np.broadcast_to(self.size, (len(orders), *self.size.shape))
        bins, position = pack_native(self.problem, np.ascontiguousarray(sizes), orders)
        out["F"] = _costs(np.array(self.problem.bin), self.size, bins, position)


def assert_same_cost(one, instance):
    """Speed counts where both minimise the same."""
    keys = np.random.default_rng(0).random((20, len(one.size)))
    found = {}
    one._evaluate(keys, found)
    orders = np.argsort(keys, 1)
    cost = jax.vmap(lambda order: bins_first_cost(instance, pack(one.problem, instance, order)))
    np.testing.assert_allclose(found["F"], cost(orders), rtol=1e-5)


def main(repeats: int = 3) -> None:
    elite, mutants, children = CONFIG.shares
    # The first generation is all new, the others keep the elite.
    evaluations = CONFIG.population + CONFIG.generations * (mutants + children)
    rows = []
    for name in ("paper-2d", "paper-3d"):
        recipe = preset(name)
        peer = None
        for batch in BATCHES:
            instances = sample(recipe.problem, recipe.distribution, jax.random.key(0), batch)
            mesh, problem = data_mesh(cores()), recipe.problem
            inputs = jax.random.split(jax.random.key(1), batch), instances
            if batch % mesh.size:
                inputs = jax.device_put(inputs, on_all(mesh))
                ours = partial(brkga, problem, config=CONFIG, mesh=mesh)
            else:
                inputs = jax.device_put(inputs, by_batch(mesh))
                ours = split_batch(mesh, partial(brkga, problem, config=CONFIG))
            search, compile_seconds = compiled(ours, *inputs)

            one = Packing(recipe.problem, np.asarray(instances.size[0]))
            assert_same_cost(one, jax.tree.map(lambda leaf: leaf[0], instances))

            def pymoos(one=one):
                algorithm = BRKGA(
                    n_elites=elite, n_offsprings=children, n_mutants=mutants, bias=CONFIG.bias
                )
                stop = ("n_gen", CONFIG.generations + 1)
                return minimize(one, algorithm, stop, seed=1).F

            runs = {"ours": lambda search=search, inputs=inputs: search(*inputs)}
            took = seconds(runs if peer else runs | {"pymoo": pymoos}, repeats)
            peer = peer or evaluations / took["pymoo"]
            rows.append(
                {
                    "problem": name,
                    "instances": batch,
                    "jaxpack, evaluations/s": batch * evaluations / took["ours"],
                    "pymoo, evaluations/s": peer,
                    "jaxpack / pymoo": batch * evaluations / took["ours"] / peer,
                    "compile, s": compile_seconds,
                }
            )
    report("genetic", rows)
