"""What is seen of a training while it goes on, and what ends it."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

FIGURES = (("cost", "cost"), ("compactness", "C"), ("pyramid", "P"), ("bins", "bins"))
"""Name in a record, and what it is called on the screen."""


@contextmanager
def asked_to_stop() -> Iterator[Callable[[], bool]]:
    """A function that tells whether a SIGTERM came: it ends nothing while the block runs."""
    asked = Event()
    before = signal.signal(signal.SIGTERM, lambda *_: asked.set())
    try:
        yield asked.is_set
    finally:
        signal.signal(signal.SIGTERM, before)


def progress_bar(console: Console) -> Progress:
    """One line; its tasks have a field `figures`."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        TextColumn("{task.completed}/{task.total}"),
        TextColumn("{task.fields[figures]}"),
        TimeRemainingColumn(),
        console=console,
    )
