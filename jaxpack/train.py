"""`python -m jaxpack.train`: trains a policy, or a sweep, and ends with how it compares."""

import json
from collections.abc import Callable, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from pathlib import Path

import jax
from jax.sharding import Mesh
from rich.console import Console

from jaxpack.cli import called, parse_options, run_door
from jaxpack.comparison import Comparison, Row, compare, make_instances
from jaxpack.errors import UserError
from jaxpack.following import FIGURES, asked_to_stop, progress_bar
from jaxpack.io.atomic import replace_file
from jaxpack.io.board import tensorboard
from jaxpack.io.members import is_sweep
from jaxpack.io.order_files import read_again
from jaxpack.io.runs import (
    RunConfig,
    create_run,
    lock_run,
    read_policy,
    read_run,
    starting_params,
)
from jaxpack.learning.recipe import Policy
from jaxpack.methods import MethodOptions, make_method
from jaxpack.model.instances import Cell
from jaxpack.packing.selfcheck import check_device
from jaxpack.search.protocol import lying, pack_orders
from jaxpack.tables import print_table, write_table
from jaxpack.train_options import Planned, TrainOptions, check_resume, new_path, plan_runs
from jaxpack.training import DivergedError, train_run
from jaxpack.xla.devices import (
    anywhere,
    data_mesh,
    is_first,
    join_processes,
    on_first,
    pick_devices,
    use_all_cores,
)

FINAL_METHODS = ("random", "volume", "footprint", "height", "best-of-100")


def start_or_resume(
    options: TrainOptions, planned: Sequence[Planned] = ()
) -> tuple[Path, RunConfig, Mesh]:
    """The run folder, made or found, its config, and the devices that will train it.

    Args:
        planned: the run, where it is a new one.
    """
    if options.resume is not None:
        check_resume(options)
        config = read_run(options.resume)
        source = read_again(config.train.distribution)
        config = replace(config, train=replace(config.train, distribution=source))
        return options.resume, config, _mesh(options, config)
    config = planned[0].config
    starting_params(config)  # what cannot be is said before there is a folder
    mesh = _mesh(options, config)
    if options.run is None and jax.process_count() > 1:
        raise UserError("--run: name the folder that the processes share")
    run = new_path(options)
    on_first(lambda: create_run(run, config))
    return run, config, mesh


def _mesh(options: TrainOptions, config: RunConfig) -> Mesh:
    devices = pick_devices(options.devices, config.train.batch, jax.process_count())
    return data_mesh(devices, everywhere=True)


def follow(
    run: Path, config: RunConfig, console: Console, stop: Callable[[], bool], mesh: Mesh
) -> None:
    """Trains to the end behind a progress bar, and into TensorBoard where it is installed.

    `stop` and `mesh`: see `train_run`.
    """
    board = tensorboard(run) if is_first() else nullcontext(lambda record: None)
    with progress_bar(console) as progress, board as log:
        task = progress.add_task("training", total=config.train.updates, figures="compiling")
        for record in train_run(run, config, stop, mesh):
            log(record)
            if "validation" in record:
                figures = _figures(record["validation"])
                console.print(f"update {record['update']}, greedy, validation: {figures}")
            else:
                text = f"{record['updates_per_second']:.1f}/s {_figures(record)}"
                progress.update(task, completed=record["update"], figures=text)


def finish(run: Path, config: RunConfig, policy: Policy, console: Console) -> None:
    """The table, the picture and the path: the end of a run, also of one already trained."""
    problem = config.train.problem
    cell = Cell(problem.bin, config.train.distribution)
    count = min(Comparison.instances, cell.distribution.count)
    comparison = Comparison(problem, count, batch=min(Comparison.batch, count))
    kinds = cell.distribution.kinds(problem)
    options = MethodOptions(policy=policy, kinds=kinds)
    network = config.train.policy
    trained = (network.name, *(f"{network.name}-best-of-16",) * ("best-of-N" in network.searches))
    rows: list[Row] = []
    for name in (*FINAL_METHODS, *trained):
        rows += compare(comparison, name, make_method(name, problem, options), [cell])
    with replace_file(run / "table.json") as file:
        file.write(json.dumps([row.record() for row in rows], indent=2) + "\n")
    write_table(run / "table.txt", rows)
    print_table(console, rows)
    _draw(run, comparison, cell, options, trained[0])
    console.print(f"picture: {run / 'packing.png'}", soft_wrap=True)
    console.print(f"run: {run}", soft_wrap=True)


def _draw(
    run: Path, comparison: Comparison, cell: Cell, options: MethodOptions, trained: str
) -> None:
    from jaxpack.io.pictures import draw_packings

    one = replace(comparison, instances=1)
    instances, keys = make_instances(one, cell, cell.distribution.items)
    packings = []
    for name in ("random", "height", trained):
        orders = make_method(name, comparison.problem, options).orders(keys, instances)
        packed = lying(instances, orders)[0], pack_orders(comparison.problem, instances, orders)
        packings.append((name, *jax.tree.map(lambda leaf: leaf[0], packed)))
    draw_packings(run / "packing.png", packings)


def _figures(values: dict[str, float]) -> str:
    return " ".join(f"{short} {values[name]:.3f}" for name, short in FIGURES)


def main(argv: Sequence[str]) -> None:
    """Parses, trains, prints."""
    options = parse_options(TrainOptions, "train", argv)
    join_processes(options.coordinator, options.process_id, options.num_processes)
    use_all_cores()
    check_device()
    planned = plan_runs(options) if options.resume is None else []
    console = Console(quiet=not is_first())
    if len(planned) > 1 or (options.resume and is_sweep(options.resume)):
        from jaxpack.train_sweep import run_sweep  # what draws, that a run has at its end

        run_sweep(options, planned, console)
        return
    run, config, mesh = start_or_resume(options, planned)
    with ExitStack() as stack:
        on_first(lambda: stack.enter_context(lock_run(run)))
        devices = "" if mesh.size == 1 else f" on {mesh.size} devices"
        what = f"{config.preset}, seed {config.seed}, {config.train.updates} updates in {run}"
        console.print(what + devices)
        try:
            with asked_to_stop() as stop:
                follow(run, config, console, stop, mesh)
            stopped = anywhere(stop())
            policy = None if stopped else read_policy(run)
        except DivergedError as error:
            raise SystemExit(f"error: {error}") from None
        except (jax.errors.JaxRuntimeError, ValueError) as error:
            if jax.process_count() == 1 or isinstance(error, UserError):
                raise
            reason = str(error).split("\n")[0]
            raise UserError(
                f"a process was lost ({reason}); start all again with --resume {run}"
            ) from error
        jax.distributed.shutdown()  # the rest is for process 0 alone
        if policy is None:
            again = f"{called('train')} --resume {run}"
            console.print(f"stopped and checkpointed; go on with: {again}", soft_wrap=True)
        elif is_first():
            finish(run, config, policy, console)


if __name__ == "__main__":
    run_door(main)
