"""The native loop that the benchmarks compare with gives the placements of `pack`."""

import jax
import numpy as np
import pytest
from cases import packer

from benchmarks.native import pack_native
from jaxpack.learning.presets import preset
from jaxpack.model.instances import sample


@pytest.mark.parametrize("name", ["paper-2d", "paper-3d"])
def test_the_native_loop_equals_pack(name):
    problem, distribution = preset(name).problem, preset(name).distribution
    instances = sample(problem, distribution, jax.random.key(3), 50)
    table = np.tile(np.arange(distribution.items, dtype=np.int32), (50, 1))
    orders = np.random.default_rng(3).permuted(table, axis=1)
    packing = packer(problem)(instances, orders)
    bins, position = pack_native(problem, np.asarray(instances.size), orders)
    np.testing.assert_array_equal(packing.bin, bins)
    np.testing.assert_array_equal(packing.position, position)
