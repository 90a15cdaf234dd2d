"""Before an accelerator is trusted it packs a little, and NumPy says whether it is right."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import packer

from jaxpack import evaluate, train
from jaxpack.errors import UserError
from jaxpack.model.problem import Packing
from jaxpack.packing import selfcheck
from jaxpack.packing.height_map import cell_dtype


def right(problem, instances, orders):
    return packer(problem)(instances, orders)


def test_this_device_packs_right():
    selfcheck.check_device(right)


def test_bins_of_more_than_126_cells_of_both_types_are_tried():
    tried = {cell_dtype(problem).name for problem in selfcheck.PROBLEMS}
    assert tried == {"int8", "int16"}
    assert all(np.prod(problem.bin) > 126 for problem in selfcheck.PROBLEMS)


@pytest.mark.parametrize("field", Packing._fields)
@pytest.mark.parametrize("number", range(len(selfcheck.PROBLEMS)))
def test_one_wrong_number_anywhere_is_one_error(field, number):
    rng = np.random.default_rng(number)

    def wrong(problem, instances, orders):
        packings = right(problem, instances, orders)
        if problem != selfcheck.PROBLEMS[number]:
            return packings
        values = np.array(getattr(packings, field))
        values.reshape(-1)[rng.integers(values.size)] += 1
        return packings._replace(**{field: values})

    kind = jax.devices()[0].device_kind
    with pytest.raises(UserError, match=f"^{kind} .*packs wrong, '{field}'") as caught:
        selfcheck.check_device(wrong)
    assert "\n" not in str(caught.value)


def test_a_cpu_is_not_checked_and_another_device_is(monkeypatch):
    tried = []

    def kept(problem, instances, orders):
        tried.append(problem)
        return jax.tree.map(jnp.zeros_like, right(problem, instances, orders))

    monkeypatch.setattr(selfcheck, "_pack", kept)
    selfcheck.check_device()
    assert not tried
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    with pytest.raises(UserError, match="packs wrong"):
        selfcheck.check_device()
    assert tried


@pytest.mark.parametrize("door", [train, evaluate])
def test_the_doors_check_before_they_begin(door, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    nothing = lambda *case: jax.tree.map(jnp.zeros_like, right(*case))  # noqa: E731
    monkeypatch.setattr(selfcheck, "_pack", nothing)
    with pytest.raises(UserError, match="packs wrong"):
        door.main(["paper-2d"])
    assert not list(tmp_path.iterdir())
