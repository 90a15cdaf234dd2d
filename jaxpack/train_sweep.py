"""The part of `python -m jaxpack.train` that is for sweeps."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import jax
from rich.console import Console

from jaxpack.cli import called
from jaxpack.errors import UserError
from jaxpack.following import FIGURES, asked_to_stop, progress_bar
from jaxpack.io.board import tensorboard
from jaxpack.io.members import Member, create_sweep, lock_sweep, read_sweep
from jaxpack.io.order_files import read_again
from jaxpack.io.runs import starting_params
from jaxpack.sweep_report import report_sweep
from jaxpack.sweeping import group_members, train_sweep
from jaxpack.train_options import Planned, TrainOptions, check_resume, new_path
from jaxpack.training import DivergedError
from jaxpack.xla.devices import pick_devices


def start_or_resume_sweep(
    options: TrainOptions, planned: Sequence[Planned]
) -> tuple[Path, list[Member], int]:
    """The sweep's folder, made or found, its members, and how many devices will train them.

    Args:
        planned: the members, where it is a new one.
    """
    if jax.process_count() > 1:
        raise UserError("--seeds and lists of numbers: a sweep is trained in one process")
    devices = pick_devices(options.devices, None)
    if options.resume is not None:
        check_resume(options)
        members = read_sweep(options.resume)
        sources = {m.config.train.distribution for m in members}
        again = {source: read_again(source) for source in sources}
        return options.resume, [_with_sources(member, again) for member in members], devices
    for run in planned:
        starting_params(run.config)
    folder = new_path(options)
    return folder, create_sweep(folder, planned), devices


def _with_sources(member: Member, again: dict) -> Member:
    train = member.config.train
    train = replace(train, distribution=again[train.distribution])
    return replace(member, config=replace(member.config, train=train))


def follow(
    members: Sequence[Member], console: Console, stop: Callable[[], bool], devices: int
) -> None:
    """Trains all to the end behind one progress bar, and into TensorBoard where it is installed.

    `stop` and `devices`: see `train_sweep`.
    """
    groups = group_members(members)
    done = {member.run: group.update for group in groups for member in group.members}
    total = sum(group.updates for group in groups)
    with ExitStack() as stack:
        logs = {member.run: stack.enter_context(tensorboard(member.run)) for member in members}
        progress = stack.enter_context(progress_bar(console))
        task = progress.add_task(f"{len(members)} runs", total=total, figures="compiling")
        for records in train_sweep(groups, stop, devices):
            for member, record in records:
                logs[member.run](record)
            if not records:
                continue
            member, record = records[0]
            if "validation" in record:
                figures = _figures([record["validation"] for _, record in records])
                text = f"update {record['update']}, greedy, validation: {figures}"
                console.print(text, soft_wrap=True)
            else:
                speed = f"{record['updates_per_second'] * len(records):.1f}/s"
                text = f"{speed} {_figures([record for _, record in records])}"
                progress.update(task, advance=record["update"] - done[member.run], figures=text)
                done |= {member.run: record["update"] for member, record in records}


def _figures(records: Sequence[dict[str, float]]) -> str:
    """Means, and the range of the first."""
    texts = []
    for name, short in FIGURES:
        values = [record[name] for record in records]
        texts.append(f"{short} {sum(values) / len(values):.3f}")
        if name == "cost":
            texts.append(f"({min(values):.3f} to {max(values):.3f})")
    return " ".join(texts)


def run_sweep(options: TrainOptions, planned: Sequence[Planned], console: Console) -> None:
    """Trains a sweep, new or found, and reports.

    Raises:
        UserError: where options do not go together, or a folder is damaged or cannot be written.
    """
    folder, members, devices = start_or_resume_sweep(options, planned)
    with lock_sweep(folder, members):
        on = "" if devices == 1 else f" on {min(devices, len(members))} devices"
        console.print(f"{members[0].config.preset}, {len(members)} runs in {folder}{on}")
        try:
            with asked_to_stop() as stop:
                follow(members, console, stop, devices)
            stopped = stop()
        except DivergedError as error:
            raise SystemExit(f"error: {error}") from None
        if stopped:
            again = f"{called('train')} --resume {folder}"
            console.print(f"stopped and checkpointed; go on with: {again}", soft_wrap=True)
        else:
            report_sweep(folder, members, console)
