"""Methods side by side on the same instances: every order packed by the one judge, then checked.

A grid is every combination of item counts, bins and side ranges. All its cells share one padded
shape, so each method compiles once for the whole grid; seeds are pooled within a cell. Instances
are made, packed and summed up in chunks: of a million of them one chunk is in memory.
"""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.tree_util import Partial

from jaxpack.errors import MOST, check_counts
from jaxpack.io.sweeps import Sweep, Tally, tally
from jaxpack.learning.rollout import LANES
from jaxpack.methods import Method
from jaxpack.model.instances import Cell, Distribution
from jaxpack.model.metrics import (
    bins_used,
    compactness,
    lower_bound,
    pyramid,
    utilisation,
)
from jaxpack.model.packing_check import check_packings
from jaxpack.model.problem import Instance, Packing, Problem
from jaxpack.search.protocol import Orders, Search, compile_search, lying, pack_orders, run_for
from jaxpack.xla.devices import by_batch, data_mesh, split_batch
from jaxpack.xla.environment import usable_cores
from jaxpack.xla.pieces import in_pieces

Solver = Callable[[Array, Instance], tuple[Orders, Packing]]
"""(keys [B], instances) -> (orders, packings), compiled for one B; a pytree of compiled
functions."""

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
    cells: list[Cell] = []
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
    """How to compare: which instances, how many at a time, checked or not.

    Raises:
        UserError: where a count or a seed is out of its range.
    """

    problem: Problem  # the rules; its bin is the largest of all cells
    instances: int = 1000  # of every cell and seed
    seed: int = 0  # gives the instances: number i depends on the seed and on i alone
    seeds: int = 1  # seed, seed + 1, ...: pooled
    batch: int = 100  # instances side by side
    validate: bool = True  # check every packing
    devices: int = 1  # that share each batch
    chunk: int = 10_000  # instances in memory at a time

    def __post_init__(self) -> None:
        check_counts(self, "instances", "seeds", "batch", "chunk")
        check_counts(self, "seed", least=-MOST - 1, most=MOST - self.seeds + 1)

    @property
    def threads(self) -> int:
        """Batches solved at the same time."""
        batches = -(-min(self.instances * self.seeds, self.chunk) // self.batch)
        return min(max(1, usable_cores() // self.devices), batches)


def make_instances(
    comparison: Comparison, cell: Cell, slots: int, rows: range | None = None
) -> tuple[Instance, Array]:
    """(instances, keys) of a cell, seeds one after the other: leaves [seeds * instances, ...].

    Args:
        rows: only those of that range.
    """
    if rows is None:
        rows = range(comparison.seeds * comparison.instances)
    seed, index = np.divmod(np.arange(rows.start, rows.stop), comparison.instances)
    made: tuple[Instance, Array] = _make_instances(
        comparison.problem,
        slots,
        cell.distribution.make,
        (seed + comparison.seed).astype(np.int32),
        index.astype(np.int32),
        (cell.distribution.numbers, jnp.asarray(cell.bin)),
    )
    return made


@partial(jax.jit, static_argnames=("problem", "slots", "make"))
def _make_instances(
    problem: Problem,
    slots: int,
    make: Callable[..., Instance],
    seeds: Array,
    indices: Array,
    cell: tuple,
) -> tuple[Instance, Array]:
    def one(seed: Array, index: Array) -> tuple[Instance, Array]:
        root = jax.random.key(seed)
        key, method_key = (
            jax.random.fold_in(jax.random.fold_in(root, stream), index)
            for stream in (INSTANCE_STREAM, METHOD_STREAM)
        )
        return make(problem, slots, key, index, *cell), method_key

    return jax.vmap(one)(seeds, indices)


def compare(
    comparison: Comparison,
    method_name: str,
    method: Method,
    cells: Sequence[Cell],
    sweep: Sweep | None = None,
) -> list[Row]:
    """One row per cell for one method.

    Args:
        comparison: which instances, and how many at a time.
        method_name: what its rows are called.
        method: from `make_method`.
        cells: bins and distributions; all of them share one compiled program.
        sweep: what is done already, and where to keep what is done now.

    Returns:
        For every cell the means over its instances: compactness, pyramid, bins, utilisation, lower
        bound, gap and milliseconds per instance, compilation apart.

    Raises:
        InvalidPackingError: where a packing behind a row breaks a rule.
    """
    slots = max(cell.distribution.items for cell in cells)
    solver = _compile(comparison, method, cells[0], slots)
    sweep = sweep or Sweep()
    rows = []
    for number, cell in enumerate(cells):
        total = comparison.instances * comparison.seeds
        for first in range(sweep.done(method_name, number).count, total, comparison.chunk):
            chunk = range(first, min(first + comparison.chunk, total))
            instances, keys = make_instances(comparison, cell, slots, chunk)
            seconds, orders, packings = _run(comparison, solver, instances, keys)
            if comparison.validate:
                turned = lying(instances, orders)
                check_packings(comparison.problem, *turned, packings, method_name)
            values = {k: np.asarray(v, float) for k, v in _judge(instances, packings).items()}
            sweep.add(method_name, number, tally(values, seconds))
        rows.append(_row(comparison, method_name, cell, sweep.done(method_name, number)))
    return rows


def _compile(comparison: Comparison, method: Method, cell: Cell, slots: int) -> Solver:
    """The method and the judge, compiled for a batch."""
    example = make_instances(replace(comparison, instances=1, seeds=1), cell, slots)
    mesh = data_mesh(comparison.devices)

    def batch_of(leaf: Array) -> jax.ShapeDtypeStruct:
        shape = (comparison.batch, *leaf.shape[1:])
        return jax.ShapeDtypeStruct(shape, leaf.dtype, sharding=by_batch(mesh))

    instances, keys = jax.tree.map(batch_of, example)
    judge = partial(pack_orders, comparison.problem)
    if method.search is None or method.seconds is None:

        def solve(keys: Array, instances: Instance) -> tuple[Orders, Packing]:
            orders = method.orders(keys, instances)
            return orders, judge(instances, orders)

        return jax.jit(split_batch(mesh, solve)).lower(keys, instances).compile()
    search = compile_search(method.search, keys, instances, mesh)
    one = batch_of(jnp.zeros((1, slots), jnp.int32))
    orders = jax.tree.map(lambda _: one, search.best.output_shardings)  # type: ignore[attr-defined]
    packed = jax.jit(split_batch(mesh, judge)).lower(instances, orders).compile()
    # Batches share the cores: each may take longer than its share of the whole's time.
    seconds = method.seconds * comparison.batch * comparison.threads

    def run(
        search: Search, packed: Callable, keys: Array, instances: Instance
    ) -> tuple[Orders, Packing]:
        found = run_for(search, keys, instances, seconds)
        return found, packed(instances, found)

    return Partial(run, search, packed)


def _rows(batch: Any, rows: np.ndarray) -> Any:
    return jax.tree.map(lambda leaf: leaf[rows], batch)


def _run(
    comparison: Comparison, solver: Solver, instances: Instance, keys: Array
) -> tuple[float, Orders, Packing]:
    """(seconds, orders, packings) of all instances, batch by batch, on all cores."""
    total = keys.shape[0]
    # The last batch repeats the last instance: one compiled shape, and its rows are dropped.
    starts = range(0, total, comparison.batch)
    picks = [np.minimum(np.arange(s, s + comparison.batch), total - 1) for s in starts]
    place = by_batch(data_mesh(comparison.devices))
    batches = [jax.device_put(_rows((keys, instances), pick), place) for pick in picks]
    jax.block_until_ready(batches)
    # A compiled function lets no other thread in until its first call is done: own ones for each.
    solvers = [jax.tree.map(copy, solver) for _ in batches]

    def solve(solver: Solver, batch: tuple[Array, Instance]) -> tuple[Orders, Packing]:
        return jax.block_until_ready(solver(*batch))

    with ThreadPoolExecutor(comparison.threads) as pool:
        start = time.perf_counter()
        done = list(pool.map(solve, solvers, batches))
        seconds = time.perf_counter() - start
    whole = jax.tree.map(lambda *leaves: np.concatenate(leaves)[:total], *done)
    return seconds, *whole


@jax.jit
def _judge(instances: Instance, packings: Packing) -> dict[str, Array]:
    # In pieces of one shape: the last bit of a mean may depend on how XLA vectorises a batch.
    return in_pieces(lambda piece: jax.vmap(_measures)(*piece), (instances, packings), LANES)


def _measures(instance: Instance, packing: Packing) -> dict[str, Array]:
    return {
        "compactness": compactness(instance, packing),
        "pyramid": pyramid(packing),
        "bins": bins_used(packing),
        "utilisation": utilisation(instance, packing),
        "lower_bound": lower_bound(instance),
    }


def _row(comparison: Comparison, method_name: str, cell: Cell, total: Tally) -> Row:
    means = {name: total.mean(name) for name in total.sums}
    d = cell.distribution
    return Row(
        method=method_name,
        **means,
        gap=means["bins"] / means["lower_bound"] - 1,
        ms_per_instance=total.seconds / total.count * 1e3,
        batch=comparison.batch,
        instances=comparison.instances,
        seed=comparison.seed,
        seeds=comparison.seeds,
        items=d.items,
        bin=cell.bin,
        sides=(d.low, d.high),
        standard_error={name: total.standard_error(name) for name in total.sums},
    )
