"""What a service takes on."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """So much and no more; what is above it is refused by name."""

    workers: int = 1  # processes that pack
    body: int = 2**20  # bytes of a request
    items: int = 1000  # of an order, copies counted
    bins: int = 100  # types of them, of an order
    orders: int = 100  # of a request
    queue: int = 200  # requests that are not answered yet
    deadline: float = 30.0  # seconds for a request
    time_limit: float = 10.0  # seconds that a run may be asked for
    packings: int = 8  # of an order that asks for nothing; fewer where others wait beside it
    kept: int = 64 * 2**20  # bytes of plans whose pages can be looked at
    gather: float = 0.005  # seconds in which requests that come share a run
    wave: int = 16  # requests of a run
