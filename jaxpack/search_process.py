"""The process that compiled searches run in: requests come in, packings go out, pickled.

Whoever started it may leave at any time. A program that is being compiled then is finished, which
keeps it for the next one, and the process ends.
"""

import os
import pickle
import sys
from collections.abc import Callable
from queue import SimpleQueue
from threading import Thread
from typing import IO, Any

from jaxpack.loading.requests import DONE, STOP, Found, Request
from jaxpack.loading.stock import Genes

KEPT = 32  # searches after which programs leave the memory: those on disk come back quickly


def main() -> None:
    """Serves requests from standard input until it ends."""
    replies = os.fdopen(os.dup(1), "wb")
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)  # whatever else is printed is not a reply
    requests = SimpleQueue[Any]()
    told: list[bool] = []  # of everything that comes in, whether it is a request
    Thread(target=_receive, args=(sys.stdin.buffer, requests, told), daemon=True).start()

    import jax  # a second, in which requests are received

    from jaxpack.cli import prepare_jax

    prepare_jax()
    handled = served = 0
    while (message := requests.get()) is not None:
        handled += 1
        if message == STOP:
            continue
        if not any(told[handled:]):  # it compiles, though it may be told to stop by now
            served += 1
            if served % KEPT == 0:
                jax.clear_caches()
            _serve(message, replies, lambda: len(told) == handled)  # noqa: B023
        _send(replies, DONE)


def _receive(source: IO[bytes], requests: SimpleQueue[Any], told: list[bool]) -> None:
    while True:
        try:
            message = pickle.load(source)
        except Exception:  # the other side is gone
            if hasattr(os, "nice"):
                os.nice(19)
            message = None
        told.append(isinstance(message, Request))
        requests.put(message)
        if message is None:
            return


def _serve(request: Request, replies: IO[bytes], wanted: Callable[[], bool]) -> None:
    import jax
    import numpy as np

    from jaxpack.files.weights import load_policy
    from jaxpack.loading.compiled import search

    loading, count, slots = request.loading, len(request.loading.items), len(request.loading.bins)
    policy = load_policy(request.policy) if request.policy else None
    cost = float("inf")
    found = search(loading, request.seed, request.seconds, request.first, policy, wanted)
    for best, packings in found:
        better, cost = float(best.cost) < cost, min(cost, float(best.cost))
        if not better:
            _send(replies, packings)
            continue
        genes, bin, corner = jax.tree.map(np.asarray, (best.genes, best.bin, best.corner))
        own = genes.order[genes.order < count], genes.turn[:count], genes.pool[genes.pool < slots]
        _send(replies, Found(Genes(*own), bin[:count], corner[:count], cost, packings))


def _send(replies: IO[bytes], message: object) -> None:
    try:
        pickle.dump(message, replies, pickle.HIGHEST_PROTOCOL)
        replies.flush()
    except OSError:
        pass  # nobody listens any more: the end of the input says so too


if __name__ == "__main__":
    main()
