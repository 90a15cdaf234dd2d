"""What a GPU makes of packing, training and search, and how far from its floor it stays.

The floor of a run is the longer of two times: what must be read and written once over the card's
rate of copying, and the operations over its rate of doing them (the cells' in int8, the networks'
in its matrix units). Both rates are measured first, by programs that do nothing else. The last
column is the same work in the native loop on all cores of the card's host, where that exists.

Nothing here may compile or go between host and device while it is timed.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from benchmarks.native import pack_native
from benchmarks.timing import report, seconds
from jaxpack import Instance, Problem, pack, preset, sample
from jaxpack.learning.recipe import TrainConfig
from jaxpack.learning.trainer import init_state, train_updates
from jaxpack.methods import MethodOptions, make_method
from jaxpack.search.breeding import BrkgaConfig
from jaxpack.search.brkga import brkga

PROBLEMS = ("paper-2d", "paper-3d")
PRESETS = ("paper-2d", "paper-3d", "bin-aware-2d", "bin-aware-3d")
POLICIES = ("bin-aware-2d", "bin-aware-3d")
BATCHES = (1, 1024, 16_384, 131_072)
POPULATION = BrkgaConfig(population=100, generations=30)
DRAWN = 16_384  # orders drawn from a policy
SEARCHED = 256  # instances side by side in a search
NATIVE = 16_384  # instances of the native loop
COMPILED = "/jax/core/compile/backend_compile_duration"  # what JAX calls it


class Rates(NamedTuple):
    """What the card does in a second, measured."""

    bytes: float  # copied, counted when read and when written
    cells: float  # operations of int8
    flops: float  # in products of float32 matrices, at the precision that JAX uses by itself


class Run(NamedTuple):
    """Something to time."""

    what: str
    size: int  # instances or orders side by side
    unit: str
    count: float  # units in a run
    function: Callable
    inputs: tuple
    bytes: float = 0
    cells: float = 0
    flops: float = 0
    native: float | None = None  # units per second of the native loop


def main(repeats: int = 3) -> None:
    if jax.default_backend() == "cpu":
        raise SystemExit("accelerator: JAX sees no GPU here; the other sections are for CPUs")
    native = {name: _native_rate(name) for name in PROBLEMS}
    runs = [*_placements(native), *_trainings(), *_searches(native)]
    # Traced one after the other, compiled side by side.
    lowered = [jax.jit(run.function).lower(*run.inputs) for run in runs]
    with ThreadPoolExecutor() as pool:
        programs = list(pool.map(lambda program: program.compile(), lowered))
    compiled: list[str] = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, *_, **__: compiled.append(event) if event == COMPILED else None
    )
    rates = _rates()
    print({name: f"{rate:.4g}/s" for name, rate in rates._asdict().items()}, flush=True)
    rows = []
    for run, program in zip(runs, programs, strict=True):
        compiled.clear()
        with jax.transfer_guard("disallow"):
            took = seconds({run.what: partial(program, *run.inputs)}, repeats)[run.what]
        assert not compiled, f"{run.what}: compiled anew while timed"
        needs = (run.bytes / rates.bytes, run.cells / rates.cells + run.flops / rates.flops)
        per_second = run.count / took
        rows.append(
            {
                "what": run.what,
                "side by side": run.size,
                "ms": 1e3 * took,
                "unit": run.unit,
                "per second": per_second,
                "floor by bytes, ms": 1e3 * needs[0],
                "by operations, ms": 1e3 * needs[1],
                "of the floor's speed, %": 100 * max(needs) / took,
                "times the host's native loop": per_second / run.native if run.native else "",
            }
        )
        print(rows[-1], flush=True)  # where device time is short, what is done is not lost
    report("accelerator", rows)


def _drawn(name: str, batch: int) -> tuple[Problem, Instance, Array]:
    recipe = preset(name)
    instances = sample(recipe.problem, recipe.distribution, jax.random.key(0), batch)
    table = np.tile(np.arange(recipe.distribution.items, dtype=np.int32), (batch, 1))
    orders = jnp.asarray(np.random.default_rng(0).permuted(table, axis=1))
    return recipe.problem, instances, orders


def _native_rate(name: str) -> float:
    problem, instances, orders = _drawn(name, NATIVE)
    arguments = np.asarray(instances.size), np.asarray(orders)
    packing = jax.vmap(partial(pack, problem))(instances, orders)
    for ours, theirs in zip(packing[:2], pack_native(problem, *arguments), strict=True):
        np.testing.assert_array_equal(ours, theirs)  # to the cell
    return NATIVE / seconds({"native": lambda: pack_native(problem, *arguments)}, 3)["native"]


def _cells_of_a_turn(problem: Problem, items: int) -> int:
    """Operations on int8 when one item is offered to one bin: see `height_map`."""
    (L, W, _), (window_x, window_y) = problem.bin, problem.window
    wide, deep = L + window_x - 1, W + window_y - 1
    # Select, maximum, compare, and, select, add.
    passes = 6 * (L * deep * window_x + (L * W * window_y if window_y > 1 else 0))
    # Two comparisons, and, select; a minimum; compare, select, minimum. Then ands and a select.
    return passes + 8 * L * W + 3 * wide * deep + 8 * items


def _work(problem: Problem, instances: Instance, orders: Array) -> dict[str, float]:
    """Bytes and operations of a batch's placements."""
    packing = jax.vmap(partial(pack, problem))(instances, orders)
    turns = float((packing.bin + 1).sum())  # an item is offered to every bin up to its own
    moved = sum(leaf.nbytes for leaf in jax.tree.leaves((instances, orders, packing[:2])))
    return {"bytes": moved, "cells": turns * _cells_of_a_turn(problem, orders.shape[1])}


def _placements(native: dict[str, float]) -> Iterator[Run]:
    for name in PROBLEMS:
        for batch in BATCHES:
            problem, instances, orders = _drawn(name, batch)

            def place(instances: Instance, orders: Array, problem: Problem = problem) -> tuple:
                return jax.vmap(partial(pack, problem))(instances, orders)[:2]

            yield Run(
                f"placement, {name}", batch, "instances", batch, place, (instances, orders),
                **_work(problem, instances, orders), native=native[name],
            )  # fmt: skip


def _trainings() -> Iterator[Run]:
    for name in PRESETS:
        recipe: TrainConfig = preset(name)
        state = init_state(recipe, jax.random.key(0))
        update = partial(train_updates, recipe, updates=1)
        orders = recipe.batch * recipe.samples
        work = _work(*_drawn(name, orders)) | {"flops": matrix_flops(update, state)}
        yield Run(f"training, {name}", orders, "updates", 1, update, (state,), **work)


def _searches(native: dict[str, float]) -> Iterator[Run]:
    for name in PROBLEMS:
        for batch in (1, 128):
            problem, instances, orders = _drawn(name, batch)
            _, mutants, children = POPULATION.shares
            each = POPULATION.population + POPULATION.generations * (mutants + children)
            work = {k: each * v for k, v in _work(problem, instances, orders).items()}
            work["bytes"] /= each  # the orders need not leave the card
            keys = jax.random.split(jax.random.key(1), batch)
            search = partial(brkga, problem, config=POPULATION)
            yield Run(
                f"BRKGA, {name}", batch, "evaluations", batch * each, search, (keys, instances),
                **work, native=native[name],
            )  # fmt: skip
    for name in POLICIES:
        recipe = preset(name)
        params = init_state(recipe, jax.random.key(0)).params
        problem, instances, _ = _drawn(name, DRAWN)
        keys = jax.random.split(jax.random.key(1), DRAWN)
        choose = partial(recipe.policy.orders, problem, kinds=recipe.kinds)
        inputs = (params, instances, keys)
        flops = matrix_flops(choose, *inputs)
        yield Run(f"drawing, {name}", DRAWN, "orders", DRAWN, choose, inputs, flops=flops)
        problem, instances, _ = _drawn(name, SEARCHED)
        keys = jax.random.split(jax.random.key(1), SEARCHED)
        for method in ("bin-aware-best-of-64", "bin-aware-search"):
            orders = make_method(method, problem, MethodOptions(kinds=recipe.kinds)).orders
            flops = matrix_flops(orders, keys, instances)
            yield Run(
                f"{method}, {name[-2:]}", SEARCHED, "instances", SEARCHED, orders,
                (keys, instances), flops=flops,
            )  # fmt: skip


def matrix_flops(function: Callable, *arguments: Any) -> float:
    """Operations in products of matrices. What a loop of unknown length does counts once."""

    def parts(params: dict[str, Any]) -> Iterator[Any]:
        for value in params.values():
            for part in value if isinstance(value, tuple) else (value,):
                part = getattr(part, "jaxpr", part)
                if hasattr(part, "eqns"):
                    yield part

    def count(jaxpr: Any) -> float:
        total = 0.0
        for equation in jaxpr.eqns:
            if equation.primitive.name == "dot_general":
                (contracted, _), _ = equation.params["dimension_numbers"]
                left = equation.invars[0].aval.shape
                out = equation.outvars[0].aval.shape
                total += 2 * np.prod(out) * np.prod([left[axis] for axis in contracted])
            inner = [count(part) for part in parts(equation.params)]
            choice = max if equation.primitive.name == "cond" else sum
            total += equation.params.get("length", 1) * choice(inner) if inner else 0
        return total

    return count(jax.make_jaxpr(function)(*arguments).jaxpr)


def _rates() -> Rates:
    """The card's own, each from a program that does nothing else."""
    wide = jnp.ones(2**28, jnp.float32)
    copy = jax.jit(lambda x: x + 1)
    cells = jax.random.randint(jax.random.key(0), (2**28,), -99, 99, jnp.int8)
    rounds = 64

    def turn(x: Array) -> Array:
        for number in range(rounds):  # compare, select, add and maximum, as the kernel does
            x = jnp.maximum(jnp.where(x == number, x + jnp.int8(3), x), jnp.int8(-number))
        return x

    n = 8192
    left, right = jax.random.normal(jax.random.key(1), (2, n, n))
    runs = {
        "bytes": (copy, (wide,), 2 * wide.nbytes),
        "cells": (jax.jit(turn), (cells,), 4 * rounds * cells.size),
        "flops": (jax.jit(jnp.matmul), (left, right), 2 * n**3),
    }
    took = seconds({name: partial(run, *of) for name, (run, of, _) in runs.items()}, 5)
    return Rates(**{name: amount / took[name] for name, (*_, amount) in runs.items()})
