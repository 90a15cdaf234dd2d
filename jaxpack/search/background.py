"""Searches in a process of their own: one that compiles or packs cannot be stopped, only left.

The process is kept for the next search, for its programs. Between searches it waits; where it was
in the middle of something it is halted, and goes on with it when it is next used or when the
interpreter ends: what it was compiling is then there for the next one.
"""

import atexit
import contextlib
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from jaxpack.search.requests import DONE, STARTED, STOP, Found, Request
from jaxpack.xla.environment import environment_of_another

UNSENDABLE = (pickle.PicklingError, AttributeError, TypeError)
PATIENCE = 0.1  # seconds that a search has to end by itself
LISTENING = 1.0  # seconds after which a process that has not begun is not waited for
_CAN_HALT = hasattr(signal, "SIGSTOP")


class SearchProcess:
    """One process; of those that are not in use, see `borrow`."""

    def __init__(self) -> None:
        """Starts it.

        Raises:
            OSError: there is no interpreter to run it with, or no room for it.
        """
        if not sys.executable:
            raise FileNotFoundError("an embedded interpreter has no program of its own")
        environment = environment_of_another(Path(__file__).parents[2])
        # A group of its own: Ctrl-C is not for it.
        own_group: dict[str, Any] = {"process_group": 0} if os.name == "posix" else {}
        self.owner = os.getpid()
        self.replies = SimpleQueue[Any]()
        self.running = 0  # searches that were asked for and have not ended
        self.listening = threading.Event()  # to signals, see `_halt`
        self.halted = False
        # By the thread that lives as long as it does: its end is a signal to the process.
        start = partial(
            subprocess.Popen,
            [sys.executable, "-m", "jaxpack.search_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
            **own_group,
        )
        started = Future[subprocess.Popen[bytes]]()
        self.reader = threading.Thread(target=self._receive, args=(start, started), daemon=True)
        self.reader.start()
        self.process = started.result()

    @property
    def alive(self) -> bool:
        """Whether there is any use in asking it."""
        return self.owner == os.getpid() and self.process.poll() is None

    @property
    def lost(self) -> bool:
        """Whether it has ended before its search: it ran out of memory, or somebody ended it."""
        return self.running > 0 and not self.alive

    @property
    def ready(self) -> bool:
        """Whether `next` need not wait."""
        return not self.replies.empty()

    def ask(self, request: Request) -> None:
        """Begins a search. What it finds comes from `next`, of earlier ones nothing any more.

        Raises:
            UNSENDABLE: one of these, where the request can be no bytes.
        """
        message = pickle.dumps(request, pickle.HIGHEST_PROTOCOL)
        self._go_on()
        self.running += 1
        self._send(message)

    def next(self, seconds: float) -> Found | int | None:
        """What the search that was asked for last has found, or packings tried; None if nothing."""
        while True:
            try:
                reply = self.replies.get(timeout=max(seconds, 0))
            except Empty:
                return None
            if reply == DONE:
                self.running -= 1
            elif self.running == 1:
                found: Found | int = reply
                return found

    def end(self) -> None:
        """Ends the search, or leaves it where it is. Nothing runs afterwards."""
        if not self.running or not self.alive:
            return
        self._send(pickle.dumps(STOP))
        while self.running:
            try:
                reply = self.replies.get(timeout=PATIENCE)
            except Empty:
                break
            self.running -= reply == DONE
        if self.running and self.alive:
            self._halt()

    def let_go(self) -> None:
        """What it was compiling it may finish; then it ends."""
        if self.owner != os.getpid():
            return
        with contextlib.suppress(OSError):
            self._go_on()
            assert self.process.stdin
            self.process.stdin.close()

    def kill(self) -> None:
        """Ends it at once."""
        self.process.kill()
        self.process.wait()
        with contextlib.suppress(OSError):
            assert self.process.stdin
            self.process.stdin.close()
        self.reader.join()

    def _halt(self) -> None:
        # Halted before it has said what is to happen when this process ends, it would lie there for
        # ever then, or be ended by the hangup that halted processes get.
        if not _CAN_HALT or not self.listening.wait(LISTENING):
            self.kill()
            return
        with contextlib.suppress(OSError):
            self.process.send_signal(signal.SIGSTOP)
            self.halted = True

    def _go_on(self) -> None:
        if self.halted:
            self.process.send_signal(signal.SIGCONT)
            self.halted = False

    def _send(self, message: bytes) -> None:
        assert self.process.stdin
        with contextlib.suppress(OSError):
            self.process.stdin.write(message)
            self.process.stdin.flush()

    def _receive(
        self,
        start: Callable[[], subprocess.Popen[bytes]],
        started: Future[subprocess.Popen[bytes]],
    ) -> None:
        try:
            process = start()
        except OSError as error:
            started.set_exception(error)
            return
        started.set_result(process)
        assert process.stdout
        with process.stdout as replies, contextlib.suppress(EOFError, pickle.UnpicklingError):
            while True:
                reply = pickle.load(replies)
                if reply == STARTED:
                    self.listening.set()
                else:
                    self.replies.put(reply)


_waiting: list[SearchProcess] = []
_lock = threading.Lock()


def borrow() -> SearchProcess:
    """A process that nobody uses, or a new one.

    Raises:
        OSError: there can be none.
    """
    with _lock:
        while _waiting:
            process = _waiting.pop()
            if process.alive:
                return process
            if process.owner == os.getpid():
                process.kill()
    return SearchProcess()


def give_back(process: SearchProcess) -> None:
    """Ends its search and keeps it for the next one."""
    process.end()
    if process.alive:
        with _lock:
            _waiting.append(process)
    else:
        process.kill()


@atexit.register
def _let_go() -> None:
    for process in _waiting:
        process.let_go()
        process.process.returncode = 0  # nobody waits for it: that is no mistake to warn of
