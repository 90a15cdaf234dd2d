"""Many orders packed side by side: every bin that one of them fills is filled together with others.

At first all get a plan, quickly; then those that are above their bound go on, the ones with fewer
packings so far before the others. What is found of an order depends on it, the seed and the number
of packings alone, not on the orders beside it.
"""

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import batched, count
from math import inf
from time import perf_counter
from typing import Any

from jaxpack.errors import UserError
from jaxpack.model.encoding import load_job
from jaxpack.model.job import Job
from jaxpack.model.objectives import bounds
from jaxpack.search.beam import Asked, Asking
from jaxpack.search.bin_values import has_values
from jaxpack.search.local_search import Best, better
from jaxpack.search.portfolio import SolveOptions
from jaxpack.search.record import End, Progress, Record
from jaxpack.search.together import Filler, fill_together
from jaxpack.search.uncompiled import search_uncompiled

DRAWS = (1, 4, 8, 16, None)  # fillings of a bin in the first passes: most orders need no more
WINDOW = 512  # orders that are searched at a time
LESSER = 16  # packings of an order that counts once, where only what comes after the measure counts
BOUNDED = {4: 0.02, 16: 0.2}  # packings -> seconds for the bounds then


class _Order:
    """One of them, and how far it is."""

    def __init__(self, number: int, job: Job, options: SolveOptions, stop: Callable[[], bool]):
        begun = perf_counter()
        loading = load_job(job, options.rules, options.resolution, options.skip_unfit)
        self.number = number
        self.record = Record(job, loading, bounds(job, 0.0), begun)
        self.best: Best | None = None
        self.search = search_uncompiled(
            loading, options.seed, stop, known=lambda: self.best, draws=DRAWS
        )
        self.filled: Any = None
        self.now: Progress | None = None

    def go_on(self) -> Asked | None:
        """Until bins must be filled; None after each packing, or where it was stopped."""
        try:
            event = self.search.send(self.filled)
        except StopIteration:
            return None
        self.filled = None
        if isinstance(event, Asked):
            return event
        found, tried = event
        if found:
            self.best = better(self.best or found, found)
        self.now = self.record.with_one(found, tried) or self.record.progress(None)
        return None
