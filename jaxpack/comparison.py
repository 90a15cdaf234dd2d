"""Methods side by side on the same instances: every order packed by the one judge, then checked.

A grid is every combination of item counts, bins and side ranges. All its cells share one padded
shape, so each method compiles once for the whole grid; seeds are pooled within a cell.
"""

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.devices import by_batch, data_mesh, split_batch
from jaxpack.errors import UserError
from jaxpack.methods import Method
from jaxpack.packing.instances import Cell, Distribution, uniform_instance
from jaxpack.packing.metrics import (
    bins_used,
    compactness,
    lower_bound,
    pyramid,
    utilisation,
)
from jaxpack.packing.problem import Instance, Packing, Problem
from jaxpack.packing.validate import check_packings
from jaxpack.solvers.search import compile_search, pack_orders, run_for

Solver = Callable[[Array, Instance], tuple[Array, Packing]]
"""(keys [B], instances) -> (orders [B, N], packings), compiled for one B."""

INSTANCE_STREAM, METHOD_STREAM = 5, 6  # folded into key(seed); training uses 0 to 4


@dataclass(frozen=True)
class Row:
    """A method on a cell: means over the instances of all seeds, with their standard errors."""

    method: str
    compactness: float
    pyramid: float
    bins: float
    utilisation: float
    lower_bound: float
    gap: float  # bins / lower bound - 1, of the means
    ms_per_instance: float  # wall time, compilation apart
    batch: int  # instances side by side when it was timed
    instances: int
    seed: int
    seeds: int
    items: int
    bin: tuple[int, int, int]
    sides: tuple[int, int]
    standard_error: dict[str, float] = field(default_factory=dict)

    def record(self) -> dict[str, Any]:
        """The row as plain data for JSON."""
        return asdict(self)


def grid_cells(
    problem: Problem, items: Sequence[int], bins: Sequence[int], sides: Sequence[tuple[int, int]]
) -> list[Cell]:
    """All combinations, items slowest. A bin side applies to every axis the problem extends in.

    Raises:
        UserError: where a combination has items larger than its bin, or empty instances.
    """
    cells = []
    for count, side, (low, high) in product(items, bins, sides):
        bin = problem.resized((side, side, side), high).bin
        distribution = Distribution(count, low, high)
        distribution.check_fits(bin)
        cells.append(Cell(bin, distribution))
    return cells


def grid_problem(problem: Problem, cells: Sequence[Cell]) -> Problem:
    """The problem whose height map holds every cell's bin, with the same rules."""
    length, width, height = (max(cell.bin[axis] for cell in cells) for axis in range(3))
    high = max(cell.distribution.high for cell in cells)
    return problem.resized((length, width, height), high)


@dataclass(frozen=True)
class Comparison:
    """How to compare: which instances, how many at a time, checked or not."""

    problem: Problem
    instances: int = 1000
    seed: int = 0
    seeds: int = 1
    batch: int = 100
    validate: bool = True
    devices: int = 1  # that share each batch

    def __post_init__(self) -> None:
        for name in ("instances", "seeds", "batch"):
            if getattr(self, name) < 1:
                raise UserError(f"{name} {getattr(self, name)}: give at least 1")

    @property
    def threads(self) -> int:
        """Batches solved at the same time."""
        batches = -(-self.instances * self.seeds // self.batch)
        return min(max(1, len(os.sched_getaffinity(0)) // self.devices), batches)


def make_instances(comparison: Comparison, cell: Cell, slots: int) -> tuple[Instance, Array]:
    """(instances, keys) of a cell, seeds one after the other: leaves [seeds * instances, ...]."""
    d, problem = cell.distribution, comparison.problem
    bin = jnp.asarray(cell.bin)
    seeds = jnp.arange(comparison.seeds) + comparison.seed

    @jax.jit
    def make(seeds: Array, items: int, low: int, high: int, bin: Array) -> tuple[Instance, Array]:
        def one(seed: Array, index: Array) -> tuple[Instance, Array]:
            root = jax.random.key(seed)
            key, method_key = (
                jax.random.fold_in(jax.random.fold_in(root, stream), index)
                for stream in (INSTANCE_STREAM, METHOD_STREAM)
            )
            return uniform_instance(problem, key, slots, items, low, high, bin), method_key

        indices = jnp.arange(comparison.instances)
        pairs = jax.vmap(jax.vmap(one, (None, 0)), (0, None))(seeds, indices)
        return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), pairs)

    return make(seeds, d.items, d.low, d.high, bin)


def compare(
    comparison: Comparison, method_name: str, method: Method, cells: Sequence[Cell]
) -> list[Row]:
    """One row per cell for one method.

    Raises:
        InvalidPackingError: where a packing behind a row breaks a rule.
    """
    slots = max(cell.distribution.items for cell in cells)
    solver = _compile(comparison, method, slots)
    rows = []
    for cell in cells:
        instances, keys = make_instances(comparison, cell, slots)
        seconds, orders, packings = _run(comparison, solver, instances, keys)
        if comparison.validate:
            check_packings(comparison.problem, instances, orders, packings, method_name)
        rows.append(_row(comparison, method_name, cell, instances, packings, seconds))
    return rows


def _compile(comparison: Comparison, method: Method, slots: int) -> Solver:
    """The method and the judge, compiled for a batch."""
    example = make_instances(
        replace(comparison, instances=1, seeds=1),
        Cell(comparison.problem.bin, Distribution(slots, 1, 1)),
        slots,
    )
    mesh = data_mesh(comparison.devices)

    def batch_of(leaf: Array) -> jax.ShapeDtypeStruct:
        shape = (comparison.batch, *leaf.shape[1:])
        return jax.ShapeDtypeStruct(shape, leaf.dtype, sharding=by_batch(mesh))

    instances, keys = jax.tree.map(batch_of, example)
    judge = partial(pack_orders, comparison.problem)
    if method.search is None or method.seconds is None:

        def solve(keys: Array, instances: Instance) -> tuple[Array, Packing]:
            orders = method.orders(keys, instances)
            return orders, judge(instances, orders)

        return jax.jit(split_batch(mesh, solve)).lower(keys, instances).compile()
    search = compile_search(method.search, keys, instances, mesh)
    orders = batch_of(jnp.zeros((1, slots), jnp.int32))
    packed = jax.jit(split_batch(mesh, judge)).lower(instances, orders).compile()
    # Batches share the cores: each may take longer than its share of the whole's time.
    seconds = method.seconds * comparison.batch * comparison.threads

    def run(keys: Array, instances: Instance) -> tuple[Array, Packing]:
        found = run_for(search, keys, instances, seconds)
        return found, packed(instances, found)

    return run


def _rows(batch: Any, rows: np.ndarray) -> Any:
    return jax.tree.map(lambda leaf: leaf[rows], batch)


def _run(
    comparison: Comparison, solver: Solver, instances: Instance, keys: Array
) -> tuple[float, np.ndarray, Packing]:
    """(seconds, orders, packings) of all instances, batch by batch, on all cores."""
    total = keys.shape[0]
    # The last batch repeats the last instance: one compiled shape, and its rows are dropped.
    starts = range(0, total, comparison.batch)
    picks = [np.minimum(np.arange(s, s + comparison.batch), total - 1) for s in starts]
    place = by_batch(data_mesh(comparison.devices))
    batches = [jax.device_put(_rows((keys, instances), pick), place) for pick in picks]
    jax.block_until_ready(batches)
    with ThreadPoolExecutor(comparison.threads) as pool:
        start = time.perf_counter()
        done = list(pool.map(lambda batch: jax.block_until_ready(solver(*batch)), batches))
        seconds = time.perf_counter() - start
    whole = jax.tree.map(lambda *leaves: np.concatenate(leaves)[:total], *done)
    return seconds, *whole


@partial(jax.jit)
@jax.vmap
def _judge(instance: Instance, packing: Packing) -> dict[str, Array]:
    return {
        "compactness": compactness(instance, packing),
        "pyramid": pyramid(packing),
        "bins": bins_used(packing),
        "utilisation": utilisation(instance, packing),
        "lower_bound": lower_bound(instance),
    }


def _row(
    comparison: Comparison,
    method_name: str,
    cell: Cell,
    instances: Instance,
    packings: Packing,
    seconds: float,
) -> Row:
    values = {k: np.asarray(v, float) for k, v in _judge(instances, packings).items()}
    means = {name: float(value.mean()) for name, value in values.items()}
    total = len(values["bins"])
    errors = {name: float(v.std(ddof=min(1, total - 1)) / total**0.5) for name, v in values.items()}
    d = cell.distribution
    return Row(
        method=method_name,
        **means,
        gap=means["bins"] / means["lower_bound"] - 1,
        ms_per_instance=seconds / total * 1e3,
        batch=comparison.batch,
        instances=comparison.instances,
        seed=comparison.seed,
        seeds=comparison.seeds,
        items=d.items,
        bin=cell.bin,
        sides=(d.low, d.high),
        standard_error=errors,
    )
