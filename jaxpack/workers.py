"""Orders on all cores: each core has a process of its own, and some of the orders at a time."""

import pickle
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any

from jaxpack.errors import UserError
from jaxpack.model.job import Job
from jaxpack.search.beam import fill
from jaxpack.search.portfolio import SolveOptions
from jaxpack.search.record import Progress
from jaxpack.search.together import Fill
from jaxpack.search.wave import Tell, pack_wave
from jaxpack.solution import Solution, solution
from jaxpack.xla.environment import environment_of_another

TICK = 0.1  # seconds between looks at whether to stop
Task = tuple[Sequence[Job], SolveOptions]
Packed = list[Solution | str | None]
"""Of every order its solution, what is wrong with it, or None if it was not begun."""
State = tuple[int, ...]
"""(bins, their bound, orders that are done) of a task that is being packed."""


def packed(
    jobs: Sequence[Job],
    options: SolveOptions,
    stop: Callable[[], bool] = lambda: False,
    tell: Tell = lambda number, found: None,
    fill: Fill = fill,
) -> Packed:
    """What `pack_wave` ends with, in this process."""
    found = pack_wave(jobs, options, stop, tell, fill)
    return [
        solution(one.job, one, options.rules)
        if isinstance(one, Progress)
        else str(one)
        if one
        else None
        for one in found
    ]


class Workers:
    """Processes that pack; they wait between tasks, and end with the block."""

    def __init__(self, count: int) -> None:
        """Starts them."""
        self.replies = SimpleQueue[tuple[int, Any]]()
        self.processes = [self._started(number) for number in range(count)]

    def __enter__(self) -> "Workers":
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Ends them, whatever they do."""
        for process in self.processes:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                pipe.close()  # type: ignore[union-attr]

    def run(
        self,
        tasks: Iterable[Task],
        stop: Callable[[], bool] = lambda: False,
        told: Callable[[int, State], object] = lambda number, state: None,
    ) -> Iterator[tuple[int, Packed]]:
        """(number of a task, what came of it), as they end; a task is looked at when it begins.

        Args:
            tasks: what is to be packed.
            stop: asked ten times a second; ends all of them with what there is.
            told: called with the state of a task now and then.

        Raises:
            UserError: where a process ended before its task.
        """
        waiting, busy, stopped = enumerate(tasks), dict[int, int](), False
        idle = list(range(len(self.processes)))
        while True:
            while idle and not stop() and (task := next(waiting, None)):
                busy[idle[0]] = task[0]
                self._send(idle.pop(0), (*task[1], time.time()))
            if not busy:
                return
            if stop() and not stopped:
                stopped = True
                for number in busy:
                    self._send(number, ())
            try:
                number, reply = self.replies.get(timeout=TICK)
            except Empty:
                continue
            if reply is None:
                what = "a process that packs has ended early, perhaps for want of memory"
                raise UserError(f"{what}: give fewer workers")
            if isinstance(reply, list):
                idle.append(number)
                yield busy.pop(number), reply
            else:
                told(busy[number], reply)

    def _started(self, number: int) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            [sys.executable, "-m", "jaxpack.wave_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment_of_another(Path(__file__).parents[1]),
        )
        Thread(target=self._receive, args=(number, process.stdout), daemon=True).start()
        return process

    def _receive(self, number: int, source: Any) -> None:
        try:
            while True:
                self.replies.put((number, pickle.load(source)))
        except (EOFError, ValueError, OSError, pickle.UnpicklingError):
            self.replies.put((number, None))

    def _send(self, number: int, message: Any) -> None:
        pipe = self.processes[number].stdin
        assert pipe
        try:
            pickle.dump(message, pipe, pickle.HIGHEST_PROTOCOL)
            pipe.flush()
        except BrokenPipeError:
            pass  # `_receive` says so
