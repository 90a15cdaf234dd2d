"""`jaxpack stream`: the orders of a Parquet file of any size in, part files of plans out."""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from hashlib import sha256
from itertools import count
from pathlib import Path
from typing import Any

from tyro.conf import Positional

from jaxpack import __version__
from jaxpack.cli import called, parse_options, run_door
from jaxpack.errors import UserError
from jaxpack.flags import HowToPack, interrupts
from jaxpack.io.arrow import arrow
from jaxpack.io.locks import held
from jaxpack.io.spreadsheets import read_table
from jaxpack.io.streams import Chunk, OrderStream
from jaxpack.io.texts import read_bytes
from jaxpack.model.job import Job
from jaxpack.model.numbers import as_whole, fault
from jaxpack.parts import Parts
from jaxpack.plan_tables import Screen, counted, say
from jaxpack.rule_flags import flag
from jaxpack.search.portfolio import SolveOptions
from jaxpack.solution import checked_options
from jaxpack.waves import ERRORS, live_line
from jaxpack.workers import Task, Workers
from jaxpack.xla.environment import usable_cores

PACKINGS = 8  # of each order, where neither they nor a time limit are given
PROBED = 1024  # orders among which one is looked for that the options are checked with


@dataclass(frozen=True)
class CommandOptions(HowToPack):
    """Pack the orders of a Parquet file, however many. The same command goes on after a kill."""

    orders: Positional[Path]
    """The items, .parquet, with a column ORDER; the rows of an order stand together."""
    bins: Positional[Path]
    """The bins of all orders: .csv, .xlsx or .parquet."""
    folder: Positional[Path]
    """Where placements-00000.parquet, figures-00000.parquet, ... and manifest.json are written."""
    chunk: int = 1024
    """Orders in a part; as many are in the memory at a time for each worker."""


def described(options: CommandOptions, stream: OrderStream, how: SolveOptions) -> dict[str, Any]:
    """What the results depend on: nothing but this."""
    given = {
        "objective": options.objective,
        "ignore": list(options.ignore),
        "chunk": options.chunk,
    }
    return {
        "version": f"jaxpack {__version__}, pyarrow {arrow().__version__}",
        "input": {
            "name": options.orders.name,
            "bytes": options.orders.stat().st_size,
            "rows": stream.rows,
            "footer": stream.footer,
        },
        **{
            name: {"name": path.name, "sha256": sha256(read_bytes(path)).hexdigest()}
            for name, path in (("bins", options.bins), ("obstacles", options.obstacles))
            if path is not None
        },
        "options": asdict(how) | given,
    }


class Run:
    """The way of all orders through the workers."""

    def __init__(
        self,
        options: CommandOptions,
        stream: OrderStream,
        read: Callable[[Chunk], list[Any]],
        how: SolveOptions,
        parts: Parts,
        status: Screen,
    ) -> None:
        self.options, self.stream, self.read, self.how = options, stream, read, how
        self.parts, self.status = parts, status
        self.workers = options.workers or usable_cores()
        self.begun = time.perf_counter()
        self.rows = self.skipped = 0  # that have been read; of these, of parts that were there
        self.before = parts.totals["orders"]
        self.waiting: dict[int, tuple[Chunk, list[Any]]] = {}  # by the number of the task
        self.numbers = count()
        self.faults = 0

    def jobs(self, chunk: Chunk) -> list[Any]:
        """Of each order its Job, or what is wrong with it."""
        jobs = self.read(chunk)
        if self.how.resolution is not None:  # it may be too fine for some
            for number, job in enumerate(jobs):
                try:
                    checked_options(self.how, job, flag) if isinstance(job, Job) else None
                except UserError as error:
                    jobs[number] = error
        return jobs

    def tasks(self) -> Iterator[Task]:
        """The orders of the parts that are not there, read when a worker asks for them."""
        for chunk in self.stream.chunks(self.options.chunk):
            rows, left = chunk.rows.num_rows, self.stream.rows - self.rows
            self.rows += rows
            if chunk.number in self.parts.done:
                self.skipped += rows
                continue
            jobs = self.jobs(chunk)
            good = [job for job in jobs if isinstance(job, Job)]
            wrong = [None if isinstance(job, Job) else str(job) for job in jobs]
            self.waiting[next(self.numbers)] = replace(chunk, rows=None), wrong
            yield good, replace(self.how, time_limit=self.share(rows, left))

    def share(self, rows: int, left: int) -> float | None:
        """Seconds for so many rows of those that are left."""
        if self.how.time_limit is None:
            return None
        seconds = self.how.time_limit - (time.perf_counter() - self.begun)
        return max(0.0, seconds) * min(1.0, self.workers * rows / left)

    def go(self, interrupted: Sequence[int]) -> None:
        """Packs what is not there; ends early where it is interrupted."""
        states: dict[int, tuple[int, ...]] = {}

        def told(task: int, state: tuple[int, ...]) -> None:
            states[task] = state
            show(lambda seconds: self.line(states, seconds))

        def stop() -> bool:
            return bool(interrupted)

        with live_line(self.status) as show, Workers(self.workers) as processes:
            for task, found in processes.run(self.tasks(), stop, told):
                if interrupted:  # these may have been cut short
                    continue
                states.pop(task, None)
                chunk, wrong = self.waiting.pop(task)
                solutions = iter(found)
                results = [error or next(solutions) for error in wrong]
                self.parts.add(chunk.number, [*zip(chunk.names, results, strict=True)])
                self.tell_faults(chunk.names, results)
        if not interrupted:
            self.parts.close()

    def tell_faults(self, names: Sequence[str], results: Sequence[Any]) -> None:
        """Says what is wrong with orders, of the first of them."""
        for name, one in zip(names, results, strict=True):
            if isinstance(one, str):
                self.faults += 1
                if self.faults <= ERRORS:
                    say(self.status, f"error: order '{name}': {one}")

    def line(self, states: dict[int, tuple[int, ...]], seconds: float) -> str:
        """Orders done, bins, their gap, orders a second, time left."""
        totals = self.parts.totals
        sums = totals["bins"], totals["bound"], totals["orders"]
        bins, bound, done = map(sum, zip(sums, *states.values(), strict=True))
        waiting = sum(len(chunk.names) for chunk, _ in self.waiting.values())
        new, rows = done - self.before, self.rows - self.skipped
        known = totals["orders"] + waiting - self.before  # those in the rows
        rate = new / max(seconds, 1e-9)
        parts = [
            f"{done:,} orders done",
            f"{counted(bins, 'bin')}, gap {(bins - bound) / max(bound, 1) * 100:.1f} %",
            f"{rate:,.0f} orders/s",
        ]
        if self.how.time_limit is not None:
            parts.append(f"{max(0.0, self.how.time_limit - seconds):.0f} s left")
        elif new and rows:
            ahead = known - new + (self.stream.rows - self.rows) * known / rows
            parts.append(f"{ahead / rate:.0f} s left")
        return ", ".join(parts)


def say_totals(folder: Path, parts: Parts, console: Screen, status: Screen) -> bool:
    """Says what all parts amount to; whether every order is packed as a whole."""
    totals = parts.totals
    say(
        console,
        f"{folder}: {counted(totals['orders'], 'order')} in {counted(len(parts.done), 'part')}, "
        f"{counted(totals['items'], 'item')} in {counted(totals['bins'], 'bin')}, at least "
        f"{totals['bound']:,}",
    )
    for name, what in (("errors", "cannot be packed"), ("infeasible", "have too few bins")):
        if totals[name]:
            where = "see STATUS and MESSAGE in the figures"
            say(status, f"error: {counted(totals[name], 'order')} {what}: {where}")
    return not totals["errors"] + totals["infeasible"]


def main(argv: Sequence[str]) -> None:
    """Parses, packs, writes, prints."""
    options = parse_options(CommandOptions, "stream", argv)
    console, status = Screen(), Screen(stderr=True)
    how, size = options.how, as_whole(options.chunk, "--chunk", 1)
    if how.packings is None and how.time_limit is None:
        how = replace(how, packings=PACKINGS)
    stream = OrderStream(options.orders)
    tell = partial(say, status)
    bins = read_table(options.bins, tell)
    columns = {
        "obstacles": options.obstacles and read_table(options.obstacles, tell),
        "ignore": options.ignore,
        "objective": options.objective,
    }
    stream.checked(bins, say=tell, **columns)
    some = next(stream.chunks(min(size, PROBED)), None)

    def read(chunk: Chunk) -> list[Any]:
        return chunk.jobs(bins, **columns)

    for job in read(some) if some else ():
        if isinstance(job, Job):
            how = checked_options(how, job, flag)
            break

    folder = options.folder
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise fault(folder, f"cannot be made ({error.strerror}); name another folder") from error
    in_use = f"{folder}: another process writes to it; wait for it, or name another folder"
    with held(folder / ".lock", in_use), interrupts() as interrupted:
        parts = Parts(folder, described(options, stream, how))
        if not parts.complete:
            Run(options, stream, read, how, parts, status).go(interrupted)
    complete = say_totals(folder, parts, console, status)
    if interrupted:
        say(status, f"interrupted: {called('stream')} with the same options goes on from here")
        sys.exit(128 + interrupted[0])
    sys.exit(0 if complete else 2)


if __name__ == "__main__":
    run_door(main, computes=False)
