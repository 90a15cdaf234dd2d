"""Processes that pack, and who hands them waves of requests."""

import asyncio
import contextlib
import logging
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from http import HTTPStatus
from typing import NamedTuple, TypeVar

from jaxpack.service.limits import Limits
from jaxpack.service.packing import Reply, Request, work
from jaxpack.service.problems import Problem

T = TypeVar("T")

LEAST = 4  # requests that share a run, however many workers are free
PAUSE = 1.0  # seconds before a worker is replaced that has ended before it was warm
_SPAWN = multiprocessing.get_context("spawn")  # what is forked would have threads without threads


class Waiting(NamedTuple):
    """A request on its way."""

    request: Request
    reply: asyncio.Future[Reply]


class Worker:
    """One process; its methods block."""

    def __init__(self, limits: Limits) -> None:
        self.connection, theirs = _SPAWN.Pipe()
        self.process = _SPAWN.Process(target=work, args=(theirs, limits), daemon=True)
        self.process.start()
        theirs.close()

    def run(
        self, wave: Sequence[Request], asking: int, tell: Callable[[int, Reply], object]
    ) -> None:
        """Tells the reply to each. Raises EOFError or OSError where the process has ended."""
        self.connection.send((wave, asking))
        for _ in wave:
            tell(*self.connection.recv())

    def close(self) -> None:
        """Ends the process, whatever it does."""
        self.process.kill()
        self.process.join()
        self.connection.close()


class Workers:
    """A queue of requests, gathered into waves for the worker that is free first."""

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.queue = asyncio.Queue[Waiting]()
        self.gathering = asyncio.Lock()
        self.threads = ThreadPoolExecutor(limits.workers)
        self.asking = 0  # requests that wait for a reply
        self.alive: dict[int, int] = {}  # which worker is warm -> id of its process
        self.warmed = False  # whether all have been
        self.tasks: list[asyncio.Task[None]] = []

    @property
    def ready(self) -> bool:
        """Whether a request would be packed at once."""
        return self.warmed and bool(self.alive)

    async def __aenter__(self) -> "Workers":
        """Starts all of them, and does not wait until they are warm."""
        self.tasks = [
            asyncio.create_task(self._keep(number)) for number in range(self.limits.workers)
        ]
        return self

    async def __aexit__(self, *_: object) -> None:
        """Ends all of them."""
        for task in self.tasks:
            task.cancel()
        await asyncio.gather(*self.tasks, return_exceptions=True)
        self.threads.shutdown()

    async def ask(self, request: Request) -> Reply:
        """The reply of the next free worker. Raises Problem if it ends before."""
        waiting = Waiting(request, asyncio.get_running_loop().create_future())
        self.queue.put_nowait(waiting)
        self.asking += 1
        try:
            return await waiting.reply
        finally:
            self.asking -= 1

    async def _keep(self, number: int) -> None:
        """One worker after the other."""
        while True:
            worker, warm = None, False
            try:
                worker = await self._call(Worker, self.limits)
                await self._call(worker.connection.recv)
                warm = True
                self.alive[number] = worker.process.pid or 0
                self.warmed = self.warmed or len(self.alive) == self.limits.workers
                while True:
                    await self._run(worker, await self._gathered())
            except Exception as error:  # EOFError or OSError, but whatever it is: there is another
                what = type(error).__name__
                logging.getLogger("jaxpack").error("a worker has ended (%s): replaced", what)
            finally:
                self.alive.pop(number, None)
                if worker:
                    worker.close()
            if not warm:
                await asyncio.sleep(PAUSE)

    async def _call(self, function: Callable[..., T], *arguments: object) -> T:
        return await asyncio.get_running_loop().run_in_executor(self.threads, function, *arguments)

    async def _gathered(self) -> list[Waiting]:
        """What comes first, and what comes with it; nothing that is not waited for any more."""
        async with self.gathering:
            wave: list[Waiting] = []
            while not wave:
                some = [await self.queue.get()]
                await asyncio.sleep(self.limits.gather)
                share = -(-self.asking // self.limits.workers)  # all workers are to have some
                most = min(self.limits.wave, max(LEAST, share))
                while not self.queue.empty() and len(some) < most:
                    some.append(self.queue.get_nowait())
                wave = [one for one in some if not one.reply.done()]
        return wave

    async def _run(self, worker: Worker, wave: Sequence[Waiting]) -> None:
        """Raises EOFError or OSError where the worker ends, or had to be ended."""
        if not worker.process.is_alive():  # since it was last asked: another one has a turn
            for one in wave:
                self.queue.put_nowait(one)
            raise EOFError
        loop = asyncio.get_running_loop()

        def tell(number: int, reply: Reply) -> None:
            loop.call_soon_threadsafe(_set, wave[number], reply)

        running = asyncio.ensure_future(
            self._call(worker.run, [one.request for one in wave], self.asking, tell)
        )
        try:
            done, _ = await asyncio.wait([running], timeout=self.limits.deadline)
            if not done:  # all that wait have been told so
                worker.process.kill()
            await running
        except Exception:
            for one in wave:
                if not one.reply.done():
                    what = "the process that packed it has ended: try again"
                    one.reply.set_exception(Problem(HTTPStatus.SERVICE_UNAVAILABLE, what))
            raise
        finally:
            if not running.done():  # the service ends
                worker.process.kill()
                with contextlib.suppress(EOFError, OSError):
                    await running


def _set(waiting: Waiting, reply: Reply) -> None:
    if not waiting.reply.done():
        waiting.reply.set_result(reply)
