"""Many orders at once: tables in, a table of placements and one of figures out."""

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from jaxpack.errors import UserError
from jaxpack.io.jobs import jobs_from_columns
from jaxpack.io.notes import silent
from jaxpack.io.steps import sides_of, steps_of
from jaxpack.model.job import Job
from jaxpack.model.numbers import as_whole
from jaxpack.model.rules import Rules
from jaxpack.search.portfolio import SECONDS, SolveOptions
from jaxpack.solution import Solution, checked_options
from jaxpack.workers import Packed, State, Workers, packed
from jaxpack.xla.environment import usable_cores

EACH = 0.02  # seconds for each of many orders, where no limit is given
PLACEMENTS = (
    "ORDER", "BIN", "BIN_TYPE", "STEP", "ITEM", "NAME", "X", "Y", "Z", "LX", "LY", "LZ", "ROTATION",
)  # fmt: skip
FIGURES = (
    "ORDER", "STATUS", "BINS", "BOUND", "COST", "GAP", "FILL", "ITEMS", "LEFT_OUT", "PACKINGS",
    "MESSAGE",
)  # fmt: skip
Columns = dict[str, list[Any]]


@dataclass(frozen=True)
class Far:
    """How far a wave is."""

    orders: int  # of all
    done: int
    bins: int  # of those that have a plan
    bound: int  # of these

    @property
    def gap(self) -> float:
        """How far the bins are from their bound at most."""
        return (self.bins - self.bound) / max(self.bound, 1)


def timed(options: SolveOptions, orders: int) -> SolveOptions:
    """With a time limit for so many orders, if there is neither one nor a number of packings."""
    if options.time_limit is not None or options.packings is not None:
        return options
    return replace(options, time_limit=max(SECONDS, EACH * orders))


def pack_orders(
    jobs: Sequence[Job],
    options: SolveOptions,
    workers: int | None = None,
    stop: Callable[[], bool] = lambda: False,
    tell: Callable[[Far], object] = lambda far: None,
    devices: int | None = None,
) -> Packed:
    """Of every order its solution, what is wrong with it, or None if it was not begun.

    Args:
        jobs: of the orders.
        options: the time limit is that of all of them, the number of packings that of each.
        workers: processes, one for each core if not given.
        stop: asked many times a second; ends the searches with what there is.
        tell: called now and then.
        devices: JAX's, so many of which fill the bins instead of processes.

    Raises:
        UserError: where there are not so many devices, or a process is ended from outside.
    """
    options = timed(options, len(jobs))
    if devices is not None:
        from jaxpack.search.device_fill import DeviceFill  # JAX, which cores can do without

        return packed(jobs, options, stop, fill=DeviceFill(devices))
    workers = min(workers or usable_cores(), len(jobs))
    if workers < 2:
        return packed(jobs, options, stop)
    all_of_them: Packed = [None] * len(jobs)
    states: dict[int, State] = {}

    def told(task: int, state: State) -> None:
        states[task] = state
        bins, bound, done = map(sum, zip(*states.values(), strict=True))
        tell(Far(len(jobs), done, bins, bound))

    with Workers(workers) as processes:
        tasks = [(jobs[first::workers], options) for first in range(workers)]
        for task, some in processes.run(tasks, stop, told):
            all_of_them[task::workers] = some
    return all_of_them


def solve_many(
    orders: Any,
    bins: Any,
    *,
    obstacles: Any = None,
    time_limit: float | None = None,
    packings: int | None = None,
    seed: int = 0,
    resolution: float | None = None,
    skip_unfit: bool = False,
    ignore: str | Sequence[str] = (),
    objective: str = "",
    workers: int | None = None,
    devices: int | None = None,
    progress: Callable[[Far], object] = lambda far: None,
    **rules: Any,
) -> tuple[Any, Any]:
    """Packs the orders of a table, all into bins of the same types.

    Args:
        orders: a table of items with a column ORDER beside those of `solve`: a data frame, an
            Arrow table, a dict of columns, a structured NumPy array or a list of dicts.
        bins: a table of bins, likewise.
        obstacles: a table of what is taken in the bins, likewise: see `jaxpack.io.obstacles`.
        time_limit: seconds for all orders together. Not given, they are 10 and 0.02 for each above
            500, or as many as the packings take.
        packings: that are tried at most for each order. With the same seed and number an order's
            plan is the same, whatever orders are beside it and however many workers there are.
        seed: of the random choices.
        resolution: see `solve`, as what follows: corners stand on a grid of this length.
        skip_unfit: leave out items that no bin can hold.
        ignore: columns that need not be obeyed.
        objective: a key of `OBJECTIVES`.
        workers: processes that pack; one for each core if not given.
        devices: JAX's, so many of which fill the bins in this process instead: for GPUs. The plans
            are the same. On a CPU the processes are much faster.
        progress: called a few times a second with how `Far` it is; if it returns something true,
            the searches end with what there is.
        rules: fields of `Rules`, such as support=0.8: what carries an item, where it may stand.

    Returns:
        (placements, figures), of the kind that the orders are: a data frame, an Arrow table, else a
        dict of columns. Placements have a row per item in loading order: the order, which bin of
        it, that bin's type, the step, which row of the order the item is, from 0, and where it is.
        Figures have a row per order, with its status: OPTIMAL, FEASIBLE, INTERRUPTED, INFEASIBLE
        (bins are too few), or ERROR with a message.

    Raises:
        UserError: where anything is wrong that is not one order's alone, in one line.
    """
    wrong: dict[str, UserError] = {}
    jobs = jobs_from_columns(
        orders,
        bins,
        wrong.__setitem__,
        obstacles=obstacles,
        ignore=ignore,
        objective=objective,
        say=silent,
    )
    options = SolveOptions(
        time_limit, seed, Rules(**rules), resolution, skip_unfit, packings=packings
    )
    workers = None if workers is None else as_whole(workers, "workers", 1)
    devices = None if devices is None else as_whole(devices, "devices", 1)
    for job in jobs[:1]:
        options = checked_options(options, job)
    enough = False

    def tell(far: Far) -> None:
        nonlocal enough
        enough = bool(progress(far)) or enough

    found = pack_orders(jobs, options, workers, lambda: enough, tell, devices)
    results = [*zip([job.name for job in jobs], found, strict=True)]
    results += [(name, str(error)) for name, error in wrong.items()]
    return tuple(like(orders, table) for table in tables_of(results))


def tables_of(results: Sequence[tuple[str, Solution | str | None]]) -> tuple[Columns, Columns]:
    """(placements, figures) of orders by their names."""
    places, figures = list[Sequence[object]](), list[Sequence[object]]()
    for name, found in results:
        if isinstance(found, Solution):
            places += _placements(name, found)
        figures.append(_figures(name, found))
    return _columns(PLACEMENTS, places), _columns(FIGURES, figures)


def like(table: Any, columns: Columns) -> Any:
    """Columns as a table of the same kind as another one."""
    library = type(table).__module__.partition(".")[0]
    if library == "pyarrow":
        return sys.modules[library].table(columns)
    if library in ("pandas", "polars"):
        return sys.modules[library].DataFrame(columns)
    return columns


def _columns(names: Sequence[str], rows: Sequence[Sequence[object]]) -> Columns:
    columns = zip(*rows, strict=True) if rows else ([] for _ in names)
    return {name: list(column) for name, column in zip(names, columns, strict=True)}


def _placements(name: str, found: Solution) -> Iterator[Sequence[object]]:
    job = found.job
    for step in steps_of(job, found.plan):
        put, kind = step.placement, found.plan.bins[step.bin].bin
        box = *sides_of(put.corner), *sides_of(step.extent)
        yield (
            name, step.bin, job.bins[kind].name or str(kind), step.number, put.item, step.item.name,
            *map(float, box), put.orientation,
        )  # fmt: skip


def _figures(name: str, found: Solution | str | None) -> Sequence[object]:
    if not isinstance(found, Solution):
        return (name, "ERROR", 0, 0, 0.0, None, 0.0, 0, 0, 0, found or "not begun")
    figures = found.figures
    return (
        name, found.status.name, figures.bins, found.bound, float(figures.cost), found.gap,
        figures.utilisation, found.job.count, figures.left_out, found.packings, found.limited_by,
    )  # fmt: skip
