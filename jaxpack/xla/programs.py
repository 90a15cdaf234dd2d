"""What XLA makes of a loop on a CPU: one program, or many small ones.

Left to itself it goes through the twenty small programs of a turn one by one and hands them from
thread to thread, which costs more than what they do. Asked for it, it makes one program of a small
loop; then what `apart` and `least` are given is computed once and not anew for whatever uses it.
"""

import math
import os
from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.xla.target import LOOPS, target

T = TypeVar("T")

SMALL_LOOP = 1_000_000  # bytes that a turn may read and write
MANY = 2_000  # numbers, of which a minimum is worth a loop: on AVX2 from here on five times faster


def tune_for_cpu() -> None:
    """Tells JAX how to run programs like these on a CPU. Before any array.

    It may make one program of a small loop, such as that of `pack`; it may use vectors as wide as
    the processor's; and a call is run by the thread that makes it, which returns when it is done:
    to wake another takes as long as to pack 64 instances in 2D. Until the first call of a compiled
    function has returned, another thread that calls it waits.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if "xla_backend_extra_options" not in flags:  # there is only one
        flags += f" --xla_backend_extra_options={LOOPS}={SMALL_LOOP}"
    if "xla_cpu_prefer_vector_width" not in flags:
        flags += " --xla_cpu_prefer_vector_width=512"
    os.environ["XLA_FLAGS"] = flags.strip()
    jax.config.update("jax_cpu_enable_async_dispatch", False)


def apart(always: Array, function: Callable[..., T], *arguments: Any) -> T:
    """`function(*arguments)`, not fused with what made the arguments.

    Fused, every cell would be computed again for each cell that looks at it. A branch is what
    XLA's fusion does not look into: barriers are gone by then.

    Args:
        always: bool scalar, True; XLA must not be able to tell.
    """
    if not target().whole_loops:
        return function(*arguments)
    shapes = jax.eval_shape(function, *arguments)

    def never(*_: Any) -> T:
        return jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), shapes)

    return jax.lax.cond(always, function, never, *arguments)


def whole(always: Array, function: Callable[..., T], *arguments: Any) -> T:
    """`function(*arguments)` as one program with all its loops, by being a loop of one turn.

    By parts, its small programs are handed to the threads that all devices share, and those of one
    device wait for those of another.

    Args:
        always: bool scalar, True; XLA must not be able to tell.
    """
    if not target().whole_loops:
        return function(*arguments)
    shapes = jax.eval_shape(function, *arguments)
    nothing = jax.tree.map(lambda shape: jnp.zeros(shape.shape, shape.dtype), shapes)
    once = always.astype(jnp.int32)
    done: T = jax.lax.fori_loop(0, once, lambda *_: function(*arguments), nothing)
    return done


def least(array: Array, axes: int) -> Array:
    """Minimum over the leading axes, without XLA's library of reductions: no loop that calls it can
    be one program.
    """
    if not target().whole_loops:
        return array.min(tuple(range(axes)))
    rows = array.reshape(-1, *array.shape[axes:])
    if rows.size < MANY:
        largest = np.array(largest_of(rows.dtype), rows.dtype)
        # Any function that is not `minimum`, which XLA would know.
        return jax.lax.reduce(rows, largest, lambda a, b: jnp.where(a < b, a, b), (0,))
    return _folded(jnp.minimum, rows)


def largest_of(dtype: np.dtype) -> float | int:
    """No number of the type is larger."""
    return math.inf if jnp.issubdtype(dtype, jnp.floating) else int(np.iinfo(dtype).max)


def total(array: Array, axes: int) -> Array:
    """Sum over the leading axes, in the same way."""
    if not target().whole_loops:
        return array.sum(tuple(range(axes)), dtype=array.dtype)
    return _folded(jnp.add, array.reshape(-1, *array.shape[axes:]))


def _folded(both: Callable[[Array, Array], Array], rows: Array) -> Array:
    """All rows in one. XLA's own code takes one number after the other, a loop takes rows, and
    several at once.
    """
    while (count := len(rows)) > 1:
        size = max(n for n in range(1, math.isqrt(count) + 1) if count % n == 0)
        parts = rows.reshape(-1, size, *rows.shape[1:])

        def add(part: Array, found: Array, parts: Array = parts) -> Array:
            return both(found, parts[part])

        rows = jax.lax.fori_loop(1, len(parts), add, parts[0])
    return rows[0]
