"""What a program is made for: one explicit value, on which all depends that is traced.

Nothing else in the package asks for the name of a backend or reads an environment variable.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

import jax

LOOPS = "xla_cpu_small_while_loop_byte_threshold"
"""The option that asks XLA for one program of a small loop."""
TURNS = 4  # between two looks whether a loop is done: the host has to wait for what it sees
WIDER = 16  # times as many lanes on a GPU, which small programs leave idle, as in a CPU's cache


@dataclass(frozen=True)
class Target:
    """Hashable, a static argument of ``jit``."""

    cpu: bool = True
    whole_loops: bool = False  # XLA was asked to make one program of a small loop

    @property
    def turns(self) -> int:
        """How often the body of a loop is repeated in it."""
        return 1 if self.cpu else TURNS

    def lanes(self, count: int) -> int:
        """How many lanes to work on at once where a CPU should work on so many."""
        return count if self.cpu else WIDER * count


_traced = ContextVar[Target | None]("target", default=None)


def target() -> Target:
    """What is being traced for: what `traced_for` says, or else the default device."""
    if (given := _traced.get()) is not None:
        return given
    cpu = jax.default_backend() == "cpu"
    return Target(cpu, cpu and LOOPS in os.environ.get("XLA_FLAGS", ""))


@contextmanager
def traced_for(given: Target) -> Iterator[None]:
    """Whatever is traced within is for that target."""
    token = _traced.set(given)
    try:
        yield
    finally:
        _traced.reset(token)


def device_name() -> str:
    """What the default device is called, and its backend."""
    device = jax.local_devices()[0]
    return f"{device.device_kind} ({device.platform})"
