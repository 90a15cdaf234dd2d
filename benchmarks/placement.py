"""Instances packed per second by `pack`, beside the native loop on all cores."""

from functools import partial

import jax
import numpy as np

from benchmarks.native import pack_native
from benchmarks.timing import compiled, report, seconds
from jaxpack import Packing, pack, preset, sample

BATCHES = (1, 64, 1024, 16_384)


def main(repeats: int = 7) -> None:
    rows = []
    for name in ("paper-2d", "paper-3d"):
        recipe = preset(name)
        for batch in BATCHES:
            instances = sample(recipe.problem, recipe.distribution, jax.random.key(0), batch)
            table = np.arange(recipe.distribution.items, dtype=np.int32)
            orders = np.random.default_rng(0).permuted(np.tile(table, (batch, 1)), axis=1)
            packer, compile_seconds = compiled(
                jax.vmap(partial(pack, recipe.problem)), instances, orders
            )
            size, on_device = np.asarray(instances.size), jax.device_put(orders)
            assert_same(packer(instances, on_device), *pack_native(recipe.problem, size, orders))
            took = seconds(
                {
                    "jax": partial(packer, instances, on_device),
                    "numba": partial(pack_native, recipe.problem, size, orders),
                },
                repeats if batch > 1024 else 5 * repeats,
            )
            rows.append(
                {
                    "problem": name,
                    "batch": batch,
                    "jax, instances/s": batch / took["jax"],
                    "numba, instances/s": batch / took["numba"],
                    "jax / numba": took["numba"] / took["jax"],
                    "compile, s": compile_seconds,
                }
            )
    report("placement", rows)


def assert_same(packing: Packing, bins: np.ndarray, position: np.ndarray) -> None:
    """Speed counts where the placements are equal to the cell."""
    np.testing.assert_array_equal(packing.bin, bins)
    np.testing.assert_array_equal(packing.position, position)
