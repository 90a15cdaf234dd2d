"""Instances packed per second by `pack`, beside the native loop, both on all cores.

Both answer with the bin and the position of every item. `pack` has a device per core, and a large
batch is cut in as many parts; what a training asks for besides (volume, top and height map of every
bin) costs a second row.
"""

from functools import partial

import jax
import numpy as np

from benchmarks.native import pack_native
from benchmarks.timing import compiled, cores, report, seconds
from jaxpack import pack, preset, sample
from jaxpack.xla.devices import by_batch, data_mesh, split_batch

BATCHES = (1, 64, 1024, 16_384)
PER_DEVICE = 256  # fewer, and handing out the parts takes longer than packing them


def main(repeats: int = 9) -> None:
    rows = []
    for name in ("paper-2d", "paper-3d"):
        recipe = preset(name)
        for batch in BATCHES:
            instances = sample(recipe.problem, recipe.distribution, jax.random.key(0), batch)
            table = np.arange(recipe.distribution.items, dtype=np.int32)
            orders = np.random.default_rng(0).permuted(np.tile(table, (batch, 1)), axis=1)
            mesh = data_mesh(cores() if batch >= PER_DEVICE * cores() else 1)
            inputs = jax.device_put((instances, orders), by_batch(mesh))
            whole = split_batch(mesh, jax.vmap(partial(pack, recipe.problem)))
            packer, compile_seconds = compiled(lambda *of, pack=whole: pack(*of)[:2], *inputs)
            judge, _ = compiled(whole, *inputs)
            size = np.asarray(instances.size)
            native = partial(pack_native, recipe.problem, size, orders)
            for ours, theirs in zip(packer(*inputs), native(), strict=True):
                np.testing.assert_array_equal(ours, theirs)  # to the cell
            took = seconds(
                {"jax": partial(packer, *inputs), "all": partial(judge, *inputs), "numba": native},
                repeats,
            )
            rows.append(
                {
                    "problem": name,
                    "batch": batch,
                    "pack, instances/s": batch / took["jax"],
                    "numba, instances/s": batch / took["numba"],
                    "pack / numba": took["numba"] / took["jax"],
                    "with all figures / numba": took["numba"] / took["all"],
                    "compile, s": compile_seconds,
                }
            )
    report("placement", rows)
