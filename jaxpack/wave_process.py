"""A process that packs orders for another one: jobs come in, solutions go out, pickled.

Whatever comes in while it packs ends the packing, with what there is.
"""

import os
import pickle
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from queue import SimpleQueue
from threading import Thread
from typing import IO, Any

from jaxpack.cli import collect_seldom
from jaxpack.model.job import Job
from jaxpack.search.portfolio import SolveOptions
from jaxpack.search.record import Progress
from jaxpack.solution import Solution
from jaxpack.workers import packed

LEAST = 1e-3  # seconds
TOLD = 0.2  # seconds between two messages of how far it is


def main() -> None:
    """Packs what comes from standard input until it ends."""
    collect_seldom()
    replies = os.fdopen(os.dup(1), "wb")
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)  # whatever else is printed is not a reply
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the other one is told, and tells
    requests = SimpleQueue[Any]()
    Thread(target=_receive, args=(requests,), daemon=True).start()
    while (request := requests.get()) is not None:
        if request != ():
            jobs, options, asked = request
            if options.time_limit is not None:  # of it something has gone into starting
                left = max(options.time_limit - (time.time() - asked), LEAST)
                options = replace(options, time_limit=left)
            _send(replies, _packed(jobs, options, requests, replies))


def _receive(requests: SimpleQueue[Any]) -> None:
    try:
        while True:
            requests.put(pickle.load(sys.stdin.buffer))
    except (EOFError, pickle.UnpicklingError):
        requests.put(None)


def _packed(
    jobs: Sequence[Job], options: SolveOptions, requests: SimpleQueue[Any], replies: IO[bytes]
) -> list[Solution | str | None]:
    told, figures = 0.0, dict[int, tuple[int, ...]]()

    def tell(number: int, found: Progress) -> None:
        nonlocal told
        figures[number] = found.bins, found.bounds.bins, found.end is not None
        if time.monotonic() - told > TOLD:
            told = time.monotonic()
            _send(replies, tuple(map(sum, zip((0, 0, 0), *figures.values(), strict=True))))

    return packed(jobs, options, lambda: not requests.empty(), tell)


def _send(replies: IO[bytes], message: Any) -> None:
    try:
        pickle.dump(message, replies, pickle.HIGHEST_PROTOCOL)
        replies.flush()
    except BrokenPipeError:
        os._exit(1)  # nobody listens any more


if __name__ == "__main__":
    main()
