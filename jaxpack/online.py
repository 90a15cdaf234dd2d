"""Methods that pack one item at a time, side by side: `jaxpack evaluate online-1`."""

import re
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from rich import box
from rich.table import Table

from jaxpack.comparison import INSTANCE_STREAM, METHOD_STREAM
from jaxpack.errors import UserError, check_counts
from jaxpack.model.instances import Distribution, sample_at
from jaxpack.model.online_check import Played, check_online
from jaxpack.packing.online import SETTINGS, TURNS
from jaxpack.search.online import (
    LANES,
    RULES,
    Chooser,
    by_rule,
    play,
    shipped_value,
    value_rule,
)
from jaxpack.search.online_plan import planned
from jaxpack.xla.environment import usable_cores
from jaxpack.xla.pieces import in_pieces

DENSITY_STREAM = 7  # folded into key(seed), beside those of `comparison`
ITEMS = 100  # of a sequence: one bin of 1000 cells never takes as many
METHODS = (*RULES, "online")


@dataclass(frozen=True)
class OnlineComparison:
    """What is compared on which sequences.

    Raises:
        UserError: where a count is out of its range.
    """

    setting: str  # a key of SETTINGS
    sequences: int = 2000
    items: int = ITEMS  # of each sequence
    seed: int = 0  # sequence i depends on the seed and on i alone
    batch: int = 100  # sequences side by side
    buffer: int = 1  # items that are held, of which any may be placed next
    lookahead: int = 1  # items that are known, from the next one on
    many: bool = False  # as many bins as it takes, not one
    validate: bool = True  # check every packing

    def __post_init__(self) -> None:
        check_counts(self, "sequences", "batch", "buffer", "lookahead")
        check_counts(self, "items", most=1000)


@dataclass(frozen=True)
class OnlineRow:
    """A method: means over the sequences."""

    method: str
    use: float  # share of the volume of the bins that were used
    standard_error: float  # of it
    items: float  # that were placed
    bins: float
    ms: float  # of a core, a decision
    decisions_per_second: float  # of all cores
    sequences: int
    seed: int
    buffer: int
    lookahead: int

    def record(self) -> dict[str, Any]:
        """The row as plain data for JSON."""
        return asdict(self)


def make_chooser(name: str, preset: str) -> Chooser:
    """The method of that name.

    Args:
        name: least-z, best-fit, largest-space, flattest, online, online-plan, online-plan-N.
        preset: a key of SETTINGS.

    Raises:
        UserError: where there is none, naming those there are.
    """
    setting = SETTINGS[preset]
    if name in RULES:
        return by_rule(setting, RULES[name])
    if name == "online":
        return by_rule(setting, value_rule(shipped_value(preset)))
    if found := re.fullmatch(r"online-plan(?:-(\d{1,4}))?", name):
        futures = None if found[1] is None else int(found[1])
        return planned(setting, shipped_value(preset), futures)
    known = ", ".join((*METHODS, "online-plan", "online-plan-N"))
    raise UserError(f"unknown method '{name}': choose from {known} (N a whole number)")


def sequences_of(comparison: OnlineComparison) -> np.ndarray:
    """The items of every sequence: int32 [sequences, N, 3]."""
    setting = SETTINGS[comparison.setting]
    distribution = Distribution(comparison.items, 1, setting.high)
    key = jax.random.fold_in(jax.random.key(comparison.seed), INSTANCE_STREAM)
    rows = jnp.arange(comparison.sequences)
    return np.asarray(sample_at(setting.problem, distribution, key, rows).size)


def compare_online(comparison: OnlineComparison, name: str) -> OnlineRow:
    """A method on all sequences, every packing checked.

    Raises:
        UserError: where there is no such method.
        InvalidPackingError: a packing broke a rule.
    """
    setting, items = SETTINGS[comparison.setting], sequences_of(comparison)
    seconds, threads, played = _run(comparison, name, items)
    if comparison.validate:
        density = None
        if comparison.setting == "online-3":
            key = jax.random.fold_in(jax.random.key(comparison.seed), DENSITY_STREAM)
            density = 1 - np.asarray(jax.random.uniform(key, items.shape[:2]), float)  # (0, 1]
        turns, bin = TURNS[setting.turns], setting.problem.bin
        check_online(
            bin,
            turns,
            setting.stable,
            items,
            played,
            buffer=comparison.buffer,
            density=density,
            label=name,
        )
    placed = played.item >= 0
    number = placed.sum(1)
    bins = np.where(placed, played.bin + 1, 0).max(1)
    volume = np.where(placed, played.sides.prod(2), 0).sum(1)
    use = volume / (np.maximum(bins, 1) * np.prod(setting.problem.bin))
    return OnlineRow(
        method=name,
        use=float(use.mean()),
        standard_error=float(use.std() / np.sqrt(len(use))),
        items=float(number.mean()),
        bins=float(bins.mean()),
        ms=seconds * threads / float(number.sum()) * 1e3,
        decisions_per_second=float(number.sum()) / seconds,
        sequences=len(use),
        seed=comparison.seed,
        buffer=comparison.buffer,
        lookahead=comparison.lookahead,
    )


def _run(comparison: OnlineComparison, name: str, items: np.ndarray) -> tuple[float, int, Played]:
    """(seconds, threads, what was played: leaves [sequences, T, ...]), batch by batch."""
    choose = make_chooser(name, comparison.setting)
    lanes = 1 if "plan" in name else LANES
    pack = partial(
        play, SETTINGS[comparison.setting], choose, buffer=comparison.buffer,
        lookahead=comparison.lookahead, many=comparison.many,
    )  # fmt: skip

    def piece(given: tuple[Array, Array]) -> Played:
        items, keys = given
        played = pack(jnp.moveaxis(items, 0, -1), keys)
        return jax.tree.map(lambda leaf: jnp.moveaxis(leaf, -1, 0), played)

    total, batch = len(items), min(comparison.batch, len(items))
    key = jax.random.fold_in(jax.random.key(comparison.seed), METHOD_STREAM)
    keys = jax.vmap(partial(jax.random.fold_in, key))(jnp.arange(total))
    # The last batch repeats the last sequence: one compiled shape, and its rows are dropped.
    picks = [np.minimum(np.arange(s, s + batch), total - 1) for s in range(0, total, batch)]
    batches = [(jnp.asarray(items[pick]), keys[pick]) for pick in picks]
    whole = jax.jit(lambda given: in_pieces(piece, given, lanes))
    compiled = whole.lower(batches[0]).compile()
    threads = min(usable_cores(), len(batches))
    with ThreadPoolExecutor(threads) as pool:
        # A compiled function lets no other thread in until its first call is done: own ones.
        solvers = [copy(compiled) for _ in batches]
        began = time.perf_counter()
        done = list(pool.map(lambda s, b: jax.block_until_ready(s(b)), solvers, batches))
        seconds = time.perf_counter() - began
    played = jax.tree.map(lambda *leaves: np.concatenate(leaves)[:total], *done)
    return seconds, threads, played


def online_table(comparison: OnlineComparison, rows: Sequence[OnlineRow]) -> Table:
    """Methods against what they reach, one row each."""
    table = Table(
        title=f"{comparison.setting}, {comparison.sequences} sequences, seed {comparison.seed}",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        padding=(0, 1, 0, 0),
    )
    table.add_column("method", no_wrap=True)
    for name in ("use %", "items", *(("bins",) if comparison.many else ()), "ms a decision"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        cells = [f"{100 * row.use:.2f} ±{100 * row.standard_error:.2f}", f"{row.items:.1f}"]
        cells += [f"{row.bins:.2f}"] if comparison.many else []
        table.add_row(row.method, *cells, f"{row.ms:.3f}")
    return table
