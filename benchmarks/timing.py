"""Alternating runs, and the table and file that their medians go to."""

import csv
import os
import platform
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from typing import Any

import jax
from rich.console import Console
from rich.table import Table

RESULTS = Path(__file__).parent / "results"
BURST = 0.3


def seconds(runs: dict[str, Callable[[], Any]], repeats: int) -> dict[str, float]:
    """Median wall time of each run. They take turns, so that other work on the machine hits all.

    A turn before the others is not counted, for what is compiled or allocated in it. A short run
    is called for `BURST` seconds a turn: the first call after another's has its threads to wake
    and, for some milliseconds, the other's idle threads beside it.
    """
    times: dict[str, list[float]] = {name: [] for name in runs}
    for turn in range(repeats + 1):
        for name, run in runs.items():
            start, calls, took = time.perf_counter(), 0, 0.0
            while took < BURST:
                jax.block_until_ready(run())
                calls, took = calls + 1, time.perf_counter() - start
            if turn:
                times[name].append(took / calls)
    return {name: median(column) for name, column in times.items()}


def compiled(function: Callable, *arguments: Any) -> tuple[Callable, float]:
    """The jitted function, and the seconds that tracing and compiling it took."""
    start = time.perf_counter()
    program = jax.jit(function).lower(*arguments).compile()
    return program, time.perf_counter() - start


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def machine() -> str:
    """Processor, device and the versions that the figures depend on."""
    lines = (
        Path("/proc/cpuinfo").read_text().splitlines() if os.path.exists("/proc/cpuinfo") else []
    )
    models = [line.split(": ")[1] for line in lines if line.startswith("model name")]
    versions = ", ".join(
        f"{name} {_version(name)}" for name in ("jax", "jaxlib", "numpy", "numba", "pymoo")
    )
    load = f"load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return (
        f"{models[0] if models else platform.processor()}, {cores()} cores, {load}; "
        f"{jax.devices()[0].device_kind}; Python {platform.python_version()}, {versions}"
    )


def report(name: str, rows: list[dict[str, Any]]) -> None:
    """Prints the rows as one table and writes them to results/NAME.csv, the machine on top."""
    table = Table(title=f"{name}: {machine()}", title_justify="left")
    for column in rows[0]:
        table.add_column(column, justify="left" if isinstance(rows[0][column], str) else "right")
    for row in rows:
        table.add_row(*(_text(value) for value in row.values()))
    Console().print(table)
    RESULTS.mkdir(exist_ok=True)
    with (RESULTS / f"{name}.csv").open("w", newline="") as file:
        file.write(f"# {machine()}\n")
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows({key: _text(value) for key, value in row.items()} for row in rows)


def _text(value: Any) -> str:
    return (
        f"{value:.4g}"
        if isinstance(value, float) and value < 1000
        else f"{value:.0f}"
        if isinstance(value, float)
        else str(value)
    )


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "missing"
