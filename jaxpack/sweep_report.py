"""The end of a sweep: its table, with what the seeds leave open, and its curves."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from rich import box
from rich.console import Console
from rich.table import Table
from scipy.special import stdtrit

from jaxpack.comparison import Comparison, make_instances
from jaxpack.following import FIGURES
from jaxpack.io.atomic import replace_file
from jaxpack.io.curves import Curve, draw_curves
from jaxpack.io.members import Member
from jaxpack.io.runs import Snapshot, read_lines
from jaxpack.learning.members import alike, each_member
from jaxpack.learning.parameters import Params
from jaxpack.learning.recipe import TrainConfig
from jaxpack.model.instances import Cell
from jaxpack.model.packing_check import check_packings
from jaxpack.model.problem import Instance, Packing
from jaxpack.sweeping import newest_snapshot
from jaxpack.tables import print_wide
from jaxpack.training import pack_greedily

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Estimate:
    """A mean over seeds, and between what it would be over all seeds, by Student's t."""

    mean: float
    low: float | None = None  # None: of a single seed nobody can say
    high: float | None = None

    def __str__(self) -> str:
        if self.high is None:
            return f"{self.mean:.3f}"
        return f"{self.mean:.3f} ±{self.high - self.mean:.3f}"


@dataclass(frozen=True)
class SettingRow:
    """What the policies of a setting's runs, their best on their validation sets, are like."""

    setting: str
    runs: int
    diverged: int  # of them; they count for nothing else
    instances: int  # the same ones for all
    confidence: float
    figures: dict[str, Estimate]


def estimate(values: np.ndarray) -> Estimate:
    """Of the mean of what the values (float [n]) are drawn from: 95 % confidence."""
    mean, count = float(values.mean()), len(values)
    if count < 2:
        return Estimate(mean)
    half = stdtrit(count - 1, (1 + CONFIDENCE) / 2) * values.std(ddof=1) / count**0.5
    return Estimate(mean, mean - float(half), mean + float(half))


def report_sweep(folder: Path, members: Sequence[Member], console: Console) -> None:
    """Writes and prints the table, draws the curves, and says where they are."""
    rows = setting_rows(members)
    with replace_file(folder / "table.json") as file:
        file.write(json.dumps([asdict(row) for row in rows], indent=2) + "\n")
    with replace_file(folder / "table.txt") as file:
        print_wide(Console(file=file, width=80), setting_table(rows))
    print_wide(console, setting_table(rows))
    panels = {
        "cost of the samples, in training": _curves(members, lambda record: record.get("cost")),
        "bins, greedy, on the validation set": _curves(
            members, lambda record: record.get("validation", {}).get("bins")
        ),
    }
    draw_curves(folder / "curves.png", panels)
    console.print(f"curves: {folder / 'curves.png'}", soft_wrap=True)
    console.print(f"sweep: {folder}", soft_wrap=True)


def setting_rows(members: Sequence[Member]) -> list[SettingRow]:
    """A row for every setting, as the members have them, over fresh instances of its recipe."""
    configs, _ = alike([member.config.train for member in members])
    snapshots = [newest_snapshot(member) for member in members]
    rows: list[SettingRow] = []
    measured: dict[int, dict[str, float]] = {}
    for config in dict.fromkeys(configs):
        done = [
            row
            for row, snapshot in enumerate(snapshots)
            if configs[row] == config and snapshot and int(snapshot.state.update) == config.updates
        ]
        if done:
            finished = [snapshot for row in done if (snapshot := snapshots[row])]
            measured |= dict(zip(done, _measure(config, finished), strict=True))
    for setting in dict.fromkeys(member.setting for member in members):
        runs = [row for row, member in enumerate(members) if member.setting == setting]
        figures = [measured[row] for row in runs if row in measured]
        source = members[runs[0]].config.train.distribution
        names = figures[0] if figures else {}
        rows.append(
            SettingRow(
                setting,
                len(runs),
                len(runs) - len(figures),
                min(Comparison.instances, source.count),
                CONFIDENCE,
                {name: estimate(np.asarray([one[name] for one in figures])) for name in names},
            )
        )
    return rows


def _measure(config: TrainConfig, snapshots: Sequence[Snapshot]) -> list[dict[str, float]]:
    """Means of every policy over the instances that `evaluate` has with seed 0, all checked."""
    source = config.distribution
    comparison = Comparison(config.problem, min(Comparison.instances, source.count))
    instances, _ = make_instances(comparison, Cell(config.problem.bin, source), source.items)
    params = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(s.best.params for s in snapshots))
    packed = jax.device_get(_pack(config, params, instances))
    means = []
    for row in range(len(snapshots)):
        turned, orders, packings, values = jax.tree.map(itemgetter(row), packed)
        check_packings(config.problem, turned, orders, packings, "a policy of the sweep")
        means.append({name: float(values[name].mean()) for name, _ in FIGURES if name != "cost"})
    return means


@partial(jax.jit, static_argnames="config")
def _pack(
    config: TrainConfig, params: Params, instances: Instance
) -> tuple[Instance, Array, Packing, dict[str, Array]]:
    """`pack_greedily` of every member: leaves [M, B, ...]."""
    return each_member(lambda params: pack_greedily(config, params, instances), params)


def setting_table(rows: Sequence[SettingRow]) -> Table:
    """Settings against figures, with their intervals."""
    first = rows[0]
    table = Table(
        title=f"{first.instances} instances, mean over seeds ± {first.confidence:.0%} confidence",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        padding=(0, 1, 0, 0),
    )
    table.add_column("setting", no_wrap=True)
    names = [(name, short) for name, short in FIGURES if name != "cost"]
    for name in ("runs", *(short for _, short in names)):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        runs = f"{row.runs}, {row.diverged} diverged" if row.diverged else str(row.runs)
        figures = [str(row.figures.get(name, "-")) for name, _ in names]
        table.add_row(row.setting or "all", runs, *figures)
    return table


def _curves(members: Sequence[Member], figure: Any) -> dict[str, Curve]:
    """By setting."""
    curves = {}
    for setting in dict.fromkeys(member.setting for member in members):
        runs = [
            {r["update"]: value for r in read_lines(member.run) if (value := figure(r)) is not None}
            for member in members
            if member.setting == setting
        ]
        updates = sorted(set().union(*runs))
        values = [[run.get(update, np.nan) for update in updates] for run in runs]
        curves[setting] = (np.asarray(updates), np.asarray(values, float))
    return curves
