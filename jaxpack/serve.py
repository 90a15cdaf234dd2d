"""`python -m jaxpack.serve`: a service that packs orders, over HTTP."""

import signal
import socket
from collections.abc import Sequence
from dataclasses import dataclass

from jaxpack.cli import parse_options, run_door
from jaxpack.errors import UserError, check_counts
from jaxpack.plan_tables import Screen, counted, say
from jaxpack.service.limits import Limits
from jaxpack.xla.environment import usable_cores

LAST = 5  # seconds beyond a request's deadline for what runs when the service is to end


@dataclass(frozen=True)
class CommandOptions:
    """Pack orders that come over HTTP."""

    host: str = "127.0.0.1"
    """Address to listen on: this machine alone can ask, unless another is given."""
    port: int = 8000
    """Port to listen on; 0 takes a free one."""
    workers: int | None = None
    """Processes that pack: as many as there are cores if not given."""
    items: int = Limits.items
    """Items of an order at most, copies counted."""
    orders: int = Limits.orders
    """Orders of a request at most."""
    body: int = Limits.body
    """Bytes of a request at most."""
    queue: int = Limits.queue
    """Requests that are not answered yet at most."""
    deadline: float = Limits.deadline
    """Seconds for a request, from its first byte to its answer."""
    time_limit: float = Limits.time_limit
    """Seconds that a request may ask for at most."""
    packings: int = Limits.packings
    """Packings that are tried for an order that asks for nothing, where no others wait."""
    kept: int = Limits.kept
    """Bytes of the plans whose pages can be looked at."""


def limits_of(options: CommandOptions) -> Limits:
    """The limits that options give. Raises UserError naming one that is off."""
    workers = usable_cores() if options.workers is None else options.workers
    try:
        check_counts(options, "items", "orders", "body", "queue", "packings")
        check_counts(options, "kept", "port", least=0)
        if options.port > 65535:
            raise UserError(f"port {options.port}: give at most 65535")
        for name in ("deadline", "time_limit"):
            if not 0 < (seconds := getattr(options, name)) < float("inf"):
                raise UserError(f"{name} {seconds:g}: give seconds, more than 0")
        if workers < 1:
            raise UserError(f"workers {workers}: give at least 1")
    except UserError as error:
        raise UserError(f"--{str(error).replace('_', '-', 1)}") from None
    return Limits(
        workers=workers,
        items=options.items,
        orders=options.orders,
        body=options.body,
        queue=options.queue,
        deadline=options.deadline,
        time_limit=options.time_limit,
        packings=options.packings,
        kept=options.kept,
    )


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens. Raises UserError where there can be none."""
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, port), family=family, backlog=1024)
    except (OSError, UnicodeError) as error:
        what = getattr(error, "strerror", None) or "no address"
        raise UserError(f"--host {host} --port {port}: {what}; name another") from None


def main(argv: Sequence[str]) -> None:
    """Parses, listens, answers until it is to end."""
    options = parse_options(CommandOptions, "serve", argv)
    limits = limits_of(options)
    try:
        import uvicorn

        from jaxpack.service.app import make_app
    except ModuleNotFoundError as error:
        what = f"{error.name} is not installed"
        raise UserError(f"{what}: pip install 'jaxpack[serve]'") from None
    with listen(options.host, options.port) as own:
        config = uvicorn.Config(
            make_app(limits),
            log_level="error",  # a line for every request is for whoever is in front of it
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=int(limits.deadline) + LAST,
        )
        # What ended it comes once more when all is done: it is no fault.
        signal.signal(signal.SIGTERM, lambda *_: None)
        host = f"[{options.host}]" if ":" in options.host else options.host
        address = f"http://{host}:{own.getsockname()[1]}"
        say(Screen(stderr=True), f"{address}, {counted(limits.workers, 'worker')}")
        uvicorn.Server(config).run(sockets=[own])


if __name__ == "__main__":
    run_door(main, computes=False)
