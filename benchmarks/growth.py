"""How time and memory grow: items, cells of the bin, batch, population. One figure, log axes.

Time is that of one packing (of one generation's packings for a population), memory what XLA sets
aside for the whole program. `pack` on the grid with its windows cell by cell and by doubling,
and the kernel without a grid, on the same instances in the same order.
"""

from collections.abc import Callable
from functools import partial
from unittest.mock import patch

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
from jax import Array

from benchmarks.timing import RESULTS, report, seconds
from jaxpack import Distribution, Instance, Problem, pack, preset, sample
from jaxpack.packing.decode import Bins, Items, decode
from jaxpack.packing.height_map import LARGE_WINDOW
from jaxpack.packing.rules import RULES
from jaxpack.packing.top_faces import SHORT, TopFaces
from jaxpack.search.breeding import BrkgaConfig
from jaxpack.search.brkga import brkga

SIDE_BY_SIDE = 16  # instances, where it is not the batch that grows


def packed_on_grid(problem: Problem) -> Callable:
    """Placements of a batch, in the order of the items."""

    def run(instances: Instance) -> tuple[Array, Array]:
        order = jnp.arange(instances.mask.shape[1])
        packing = jax.vmap(lambda one: pack(problem, one, order))(instances)
        return packing.bin, packing.position

    return run


def packed_exactly(problem: Problem) -> Callable:
    """The same without a grid."""

    def run(instances: Instance) -> tuple[Array, Array]:
        size = jnp.moveaxis(instances.size, 0, -1)
        N, _, B = size.shape
        surface = TopFaces(min(N, 128), problem.bin[1] == 1, max(problem.bin) <= SHORT)
        length, width, height = (size[:, axis].astype(surface.dtype) for axis in range(3))
        needed, nothing = (
            problem.cells_needed(size[:, 0] * size[:, 1]),
            jnp.zeros((N, B), jnp.int32),
        )
        items = Items((length, width, height), needed, nothing == 0, nothing)
        rooms = tuple(jnp.full((N, B), side, surface.dtype) for side in problem.bin)
        order = jnp.broadcast_to(jnp.arange(N, dtype=jnp.int32)[:, None], (N, B))
        placed = decode(surface, RULES["lowest"], items, Bins(rooms, nothing + 1), order)
        return placed.bin, placed.corner

    return run


def with_windows_from(large: int, problem: Problem) -> Callable:
    """`packed_on_grid` with windows of blocks from so many cells on."""

    def run(instances: Instance) -> tuple[Array, Array]:
        from jaxpack.packing.first_fit import _first_fit  # not the one that is compiled already

        with patch("jaxpack.packing.height_map.LARGE_WINDOW", large):
            order = jnp.broadcast_to(jnp.arange(instances.mask.shape[1]), instances.mask.shape)
            packing = _first_fit(problem, instances, order)
        return packing.bin, packing.position

    return run


def measured(run: Callable, inputs: tuple, count: int, repeats: int = 3) -> dict[str, float]:
    """Seconds per packing, and MiB of the program."""
    program = jax.jit(run).lower(*inputs).compile()
    took = seconds({"run": partial(program, *inputs)}, repeats)["run"]
    memory = program.memory_analysis()
    held = memory.temp_size_in_bytes + memory.argument_size_in_bytes + memory.output_size_in_bytes
    return {"seconds": took / count, "MiB": held / 2**20}


def rows_of(axis: str, value: int, series: str, *measure: object) -> dict[str, object]:
    row = {"axis": axis, "value": value, "series": series} | measured(*measure)  # type: ignore[arg-type]
    print(row, flush=True)
    return row


def main() -> None:
    rows = []
    key = jax.random.key(0)
    for name in ("paper-2d", "paper-3d"):
        recipe = preset(name)
        problem, drawn, dimension = recipe.problem, recipe.distribution, name[-2:]
        for items in (20, 50, 100, 200, 500, 1000):
            some = sample(problem, Distribution(items, drawn.low, drawn.high), key, SIDE_BY_SIDE)
            for series, run in (("grid", packed_on_grid), ("exact", packed_exactly)):
                series = f"{dimension} {series}"
                rows.append(rows_of("items", items, series, run(problem), (some,), SIDE_BY_SIDE))
        for side in (10, 20, 50, 100, 200, 300):
            larger = problem.resized((side, side, side), side // 2)
            some = sample(larger, Distribution(50, max(1, side // 10), side // 2), key, 4)
            kernels = {"grid": packed_on_grid, "exact": packed_exactly}
            if side < 2 * LARGE_WINDOW:
                kernels["grid, by doubling"] = partial(with_windows_from, 1)
            else:
                kernels["grid, cell by cell"] = partial(with_windows_from, 10**9)
            for series, run in kernels.items():
                series = f"{dimension} {series}"
                rows.append(rows_of("bin side", side, series, run(larger), (some,), 4))
        for batch in (1, 4, 16, 64, 256, 1024, 4096, 16_384):
            some = sample(problem, drawn, key, batch)
            rows.append(
                rows_of(
                    "batch", batch, f"{dimension} grid", packed_on_grid(problem), (some,), batch
                )
            )
        for population in (10, 30, 100, 300, 1000):
            config = BrkgaConfig(population, generations=5)
            some, keys = sample(problem, drawn, key, 4), jax.random.split(key, 4)
            run = partial(brkga, problem, config=config)
            rows.append(
                rows_of("population", population, f"{dimension} brkga", run, (keys, some), 24)
            )
    report("growth", rows)
    draw(rows)


def draw(rows: list[dict]) -> None:
    """Time above, memory below; a column per axis."""
    axes = list(dict.fromkeys(row["axis"] for row in rows))
    figure, panels = plt.subplots(2, len(axes), figsize=(4 * len(axes), 7), squeeze=False)
    for column, axis in enumerate(axes):
        for line, quantity in enumerate(("seconds", "MiB")):
            panel = panels[line, column]
            for series in dict.fromkeys(row["series"] for row in rows if row["axis"] == axis):
                points = [r for r in rows if r["axis"] == axis and r["series"] == series]
                panel.loglog(
                    [r["value"] for r in points], [r[quantity] for r in points],
                    marker="o", markersize=3, label=series,
                )  # fmt: skip
            panel.set_xlabel(axis)
            panel.set_ylabel("seconds per packing" if quantity == "seconds" else "MiB, program")
            panel.grid(alpha=0.3)
        panels[0, column].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(RESULTS / "growth.png", dpi=110)


if __name__ == "__main__":
    main()
