"""The process that compiled searches run in: requests come in, packings go out, pickled.

Whoever started it may leave at any time. A program that is being compiled then is finished, which
keeps it for the next one, and the process ends.
"""

# Few imports: it must not take long before `_wake_without_parent`.
import os
import pickle
import signal
import sys
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import IO, TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxpack.search.requests import Request

KEPT = 32  # searches after which programs leave the memory: those on disk come back quickly

PR_SET_PDEATHSIG = 1  # of Linux's prctl: the signal for the end of the thread that started it
until_the_end = ExitStack()  # of the process


def main() -> None:
    """Serves requests from standard input until it ends."""
    replies = os.fdopen(os.dup(1), "wb")
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)  # whatever else is printed is not a reply
    _wake_without_parent()

    from jaxpack.search.requests import DONE, STARTED, STOP

    _send(replies, STARTED)
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
    from jaxpack.search.requests import Request

    while True:
        try:
            message = pickle.load(source)
        except Exception:  # the other side is gone
            _step_back()
            message = None
        told.append(isinstance(message, Request))
        requests.put(message)
        if message is None:
            return


def _step_back() -> None:
    """Ends here where it would be in the way: who is left alone has the lowest priority, and there
    is one of them for each folder of programs.
    """
    from jaxpack.errors import UserError
    from jaxpack.io.locks import held
    from jaxpack.xla.environment import cache_folder

    try:
        cache_folder().mkdir(parents=True, exist_ok=True)
        until_the_end.enter_context(held(cache_folder() / ".finishing", "another one has it"))
    except (UserError, OSError):
        os._exit(0)
    threads = Path(
        "/proc/self/task"
    )  # of which each has a priority of its own; new ones inherit it
    if threads.exists():
        for thread in threads.iterdir():
            with suppress(OSError):
                os.setpriority(os.PRIO_PROCESS, int(thread.name), 19)
    elif hasattr(os, "nice"):
        os.nice(19)


def _wake_without_parent() -> None:
    """Where this process is halted and the other one is killed, it has to go on to notice that."""
    if hasattr(signal, "SIGHUP"):  # comes to who is left alone while halted
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    if sys.platform == "linux":
        import ctypes

        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGCONT, 0, 0, 0)


def _serve(request: "Request", replies: IO[bytes], wanted: Callable[[], bool]) -> None:
    from jaxpack.io.weights import load_policy
    from jaxpack.model.encoding import Genes
    from jaxpack.search.compiled import search
    from jaxpack.search.local_search import Best
    from jaxpack.search.requests import Found

    loading, count, slots = request.loading, len(request.loading.items), len(request.loading.bins)
    policy = load_policy(request.policy) if request.policy else None
    cost = float("inf")
    how = request.seed, request.seconds, request.first, policy, wanted, request.packings
    for best, packings in search(loading, *how):
        if best.cost >= cost:
            _send(replies, packings)
            continue
        genes, cost = best.genes, best.cost
        own = genes.order[genes.order < count], genes.turn[:count], genes.pool[genes.pool < slots]
        mine = Best(Genes(*own), best.bin[:count], best.corner[:count], cost)
        _send(replies, Found(mine, packings))


def _send(replies: IO[bytes], message: object) -> None:
    try:
        pickle.dump(message, replies, pickle.HIGHEST_PROTOCOL)
        replies.flush()
    except OSError:
        pass  # nobody listens any more: the end of the input says so too


if __name__ == "__main__":
    main()
