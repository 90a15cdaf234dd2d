"""What `jaxpack solve` does where a file holds several orders."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path

from rich.live import Live

from jaxpack.many import Far, pack_orders
from jaxpack.model.hints import scale_hint
from jaxpack.model.job import Job
from jaxpack.plan_tables import Screen, counted, plain_text, say
from jaxpack.search.portfolio import SolveOptions
from jaxpack.solution import Solution
from jaxpack.workers import Packed

SAID = 10.0  # seconds between two lines of how far it is, where there is no terminal
ERRORS = 20  # of many orders that could not be packed so many are said


def pack_all(
    jobs: Sequence[Job],
    how: SolveOptions,
    workers: int | None,
    devices: int | None,
    interrupted: Sequence[int],
    status: Screen,
) -> Packed:
    """The orders packed on all cores, with a line of how far it is until then."""
    with live_line(status) as show:

        def tell(far: Far) -> None:
            show(lambda seconds: progress_line(far, seconds, how))

        return pack_orders(jobs, how, workers, lambda: bool(interrupted), tell, devices)


@contextmanager
def live_line(status: Screen) -> Iterator[Callable[[Callable[[float], str]], None]]:
    """Shows how far it is: one line on a terminal, elsewhere now and then one.

    Gives what takes a function of the seconds since the block began, whose line is shown.
    """
    begun, said = time.perf_counter(), 0.0
    live = Live(console=status, auto_refresh=False, transient=True)

    def show(line: Callable[[float], str]) -> None:
        nonlocal said
        seconds = time.perf_counter() - begun
        if live.is_started:
            live.update(plain_text(line(seconds)), refresh=True)
        elif seconds > said + SAID:
            said = seconds
            say(status, f"{seconds:.0f} s: {line(seconds)}")

    with live if status.is_terminal else nullcontext():
        yield show


def progress_line(far: Far, seconds: float, how: SolveOptions) -> str:
    """Orders done, bins, their gap, orders a second, time left."""
    parts = [
        f"{far.done:,} of {counted(far.orders, 'order')} done",
        f"{counted(far.bins, 'bin')}, gap {far.gap * 100:.1f} %",
        f"{far.done / max(seconds, 1e-9):,.0f} orders/s",
    ]
    if how.packings is None:
        parts.append(f"{max(0.0, how.seconds - seconds):.0f} s left")
    elif far.done:
        parts.append(f"{seconds * (far.orders - far.done) / far.done:.0f} s left")
    return ", ".join(parts)


def say_results(
    found: dict[str, Solution | str | None], source: Path, several: bool, status: Screen
) -> None:
    """What is wrong with orders, and what a user should know of the others, a line each."""
    faults, hints = list[str](), list[str]()
    for name, one in found.items():
        where = f"{source}: order '{name}'" if several else str(source)
        if isinstance(one, str):
            # What is wrong in a file says where already.
            faults.append(one if one.startswith(f"{source}: ") else f"{where}: {one}")
        elif one is not None:
            if one.unpacked:
                what = f"{counted(one.unpacked, 'item')} not packed, {one.lacking}"
                faults.append(f"{where}: {what}")
            if hint := scale_hint(one.job):
                hints.append(f"{where}: {hint}")
    for line in hints[:ERRORS]:
        say(status, line)
    for line in faults[:ERRORS]:
        say(status, f"error: {line}")
    if len(faults) > ERRORS:
        say(status, f"error: and {counted(len(faults) - ERRORS, 'order')} more; see --figures")
