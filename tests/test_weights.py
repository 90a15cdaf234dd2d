"""Policies as files: they come back as they were, and nothing else is let in."""

import json
import pickle
import re
from pathlib import Path

import jax
import numpy as np
import pytest

import jaxpack
from jaxpack import (
    Cell,
    Comparison,
    MethodOptions,
    Policy,
    UserError,
    compare,
    load_policy,
    make_method,
    preset,
    save_policy,
)
from jaxpack.io.weights import shipped_policies
from jaxpack.learning.pointer_network import init_pointer

RECIPE = preset("paper-2d")


@pytest.fixture
def saved(tmp_path):
    params = init_pointer(RECIPE.problem, RECIPE.policy, jax.random.key(0))
    path = tmp_path / "mine.npz"
    save_policy(str(path), Policy(RECIPE, params), {"seed": 0})
    return path, params


def test_round_trip(saved):
    path, params = saved
    loaded = load_policy(str(path))
    assert loaded.config == RECIPE
    assert jax.tree.structure(loaded.params) == jax.tree.structure(params)
    for ours, theirs in zip(jax.tree.leaves(loaded.params), jax.tree.leaves(params), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert json.loads(path.with_suffix(".json").read_text())["seed"] == 0


def test_damaged_and_foreign_files_are_refused_by_name(saved):
    path, _ = saved
    whole = path.read_bytes()
    with pytest.raises(UserError, match="no policy 'pointer-9d': choose from bin-aware-2d"):
        load_policy("pointer-9d")
    for content in (b"", b"not a zip", whole[: len(whole) // 2], whole[:300] + b"x" + whole[301:]):
        path.write_bytes(content)
        with pytest.raises(UserError, match=r"mine\.npz: not a policy, or damaged"):
            load_policy(str(path))
    with open(path, "wb") as file:
        np.savez(file, encoder=np.zeros(3))
    with pytest.raises(UserError, match="its weights do not match its config"):
        load_policy(str(path))
    path.write_bytes(whole)
    path.with_suffix(".json").write_text("{}")
    with pytest.raises(UserError, match=r"mine\.npz: not a policy, or damaged"):
        load_policy(str(path))


def test_loading_executes_nothing(saved, tmp_path):
    path, _ = saved

    class Trap:
        def __reduce__(self):
            return (tmp_path.joinpath("sprung").write_text, ("x",))

    with open(path, "wb") as file:
        np.savez(file, encoder=np.asarray([Trap()], dtype=object))
    with pytest.raises(UserError, match="not a policy, or damaged"):
        load_policy(str(path))
    path.write_bytes(pickle.dumps(Trap()))
    with pytest.raises(UserError, match="not a policy, or damaged"):
        load_policy(str(path))
    assert not tmp_path.joinpath("sprung").exists()


@pytest.mark.parametrize("dimension", ["2d", pytest.param("3d", marks=pytest.mark.long)])
def test_shipped_policies_beat_the_best_sort(dimension):
    assert f"pointer-{dimension}" in shipped_policies()
    policy = load_policy(f"pointer-{dimension}")
    assert policy.config == preset(f"paper-{dimension}"), "not what the paper's recipe trained"
    problem = policy.config.problem
    cell = Cell(problem.bin, policy.config.distribution)
    comparison = Comparison(problem, instances=300, seed=123, batch=100)
    bins = {
        name: compare(
            comparison, name, make_method(name, problem, MethodOptions(policy=policy)), [cell]
        )[0].bins
        for name in ("height", "pointer")
    }
    assert bins["pointer"] < bins["height"]


BENCHMARKS = (Path(__file__).parent.parent / "docs" / "benchmarks.md").read_text()


@pytest.mark.long
@pytest.mark.parametrize("dimension", ["2d", pytest.param("3d", marks=pytest.mark.slow)])
def test_the_bin_aware_policies_give_their_row_in_the_benchmarks(dimension):
    assert f"bin-aware-{dimension}" in shipped_policies()
    recipe = preset(f"paper-{dimension}")
    rows = re.findall(r"^bin-aware +([\d.]+) +([\d.]+) +([\d.]+) ", BENCHMARKS, re.MULTILINE)
    figures = rows[["2d", "3d"].index(dimension)]
    options = MethodOptions(kinds=recipe.kinds)
    method = make_method("bin-aware", recipe.problem, options)
    cell = Cell(recipe.problem.bin, recipe.distribution)
    row = compare(Comparison(recipe.problem), "bin-aware", method, [cell])[0]
    found = (row.compactness, row.pyramid, row.bins)
    # Another machine may round a sum of products otherwise: a few orders in 1,000 may differ.
    for ours, theirs, slack in zip(found, map(float, figures), (0.001, 0.001, 0.004), strict=True):
        assert ours == pytest.approx(theirs, abs=slack)


def test_shipped_policies_say_where_they_come_from_and_are_small():
    folder = Path(jaxpack.__file__).parent / "weights"
    assert sum(file.stat().st_size for file in folder.iterdir()) < 2 * 2**20
    for name in shipped_policies():
        record = json.loads((folder / f"{name}.json").read_text())
        assert record["command"].startswith("python -m jaxpack.train ")
        assert {"seed", "machine", "minutes", "config"} <= record.keys()
