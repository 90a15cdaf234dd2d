"""`python -m jaxpack.train`: trains a policy and ends with how it compares."""

import json
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event
from typing import Any

import jax
from jax.sharding import Mesh
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from tyro.conf import FlagCreatePairsOff, Positional, UseAppendAction

from jaxpack.cli import called, parse_options, parse_sides, run_door
from jaxpack.comparison import Comparison, Row, compare, make_instances
from jaxpack.errors import UserError
from jaxpack.io.atomic import replace_file
from jaxpack.io.order_files import read_again
from jaxpack.io.runs import (
    RunConfig,
    create_run,
    lock_run,
    read_policy,
    read_run,
    starting_params,
)
from jaxpack.learning.presets import DEFAULT_PRESET, preset
from jaxpack.learning.recipe import Policy, TrainConfig
from jaxpack.methods import MethodOptions, make_method
from jaxpack.model.instances import Cell, Source
from jaxpack.model.problem import Problem
from jaxpack.orders import order_instances
from jaxpack.packing.selfcheck import check_device
from jaxpack.search.protocol import lying, pack_orders
from jaxpack.tables import print_table, write_table
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

WHERE = ("devices", "coordinator", "process_id", "num_processes")  # no part of what a run is
FINAL_METHODS = ("random", "volume", "footprint", "height", "best-of-100")


@dataclass(frozen=True)
class TrainOptions:
    """Train a policy in a run folder. Options that are not given are the preset's."""

    preset: Positional[str] = DEFAULT_PRESET
    """bin-aware-2d or -3d, also with -range or -turned, paper-2d or paper-3d."""
    resume: Path | None = None
    """Go on with this run folder; takes no other option."""
    run: Path | None = None
    """The run folder to make; runs/PRESET-TIME if not given."""
    start_from: str = ""
    """A policy of the package or an .npz file to begin with; fresh weights if not given."""
    orders: Path | None = None
    """Learn from the orders of this file, not from random instances: .csv, one for each name in its
    column ORDER, or .json."""
    bins: Path | None = None
    """The bins that --orders go into, .csv."""
    bin_type: str = ""
    """Name or row of the one type of --bins that is used."""
    ignore: UseAppendAction[tuple[str, ...]] = ()
    """A column of --orders or --bins that need not be obeyed; may be given several times."""
    skip_unfit: FlagCreatePairsOff[bool] = False
    """Leave out the items of --orders that the bin cannot hold; otherwise they are an error."""
    seed: int = 0
    """Gives the weights, the data, the shuffles and the samples."""
    items: int | None = None
    """Items per instance."""
    bin: int | None = None
    """Side of the bin in cells, in every axis of the preset's bin."""
    sides: str | None = None
    """Smallest and largest side of an item, as LOW-HIGH."""
    train_instances: int | None = None
    """Size of the fixed training set."""
    valid_instances: int | None = None
    """Size of the fixed validation set."""
    batch: int | None = None
    """Instances per update."""
    epochs: int | None = None
    """Passes over the training set."""
    learning_rate: float | None = None
    """Of Adam, at the start."""
    schedule: str | None = None
    """Of the rate: constant, or cosine (down to zero)."""
    objective: str | None = None
    """What is minimised: bins (bins, then C, then P) or paper (R)."""
    learner: str | None = None
    """critic, leave-one-out, leave-one-out-by-bin, or self-label: imitate the best sample."""
    samples: int | None = None
    """Orders drawn per instance."""
    entropy: float | None = None
    """Weight of the choices' entropy in the loss."""
    clip: float | None = None
    """Largest norm of a gradient, 0 for any."""
    alpha: float | None = None
    """Weight of compactness in the cost."""
    beta: float | None = None
    """Weight of pyramid in the cost."""
    hidden: int | None = None
    """Width of the network."""
    chunk: int = 20
    """Updates per dispatch and per line of metrics.jsonl, at most."""
    checkpoint_every: int = 100
    """Updates between validations and checkpoints, at least."""
    devices: int | None = None
    """Devices that share each batch; the most that divide it if not given. Goes with --resume."""
    coordinator: str | None = None
    """HOST:PORT of process 0, to train in several processes. Found under SLURM. With --resume."""
    process_id: int | None = None
    """Which of the processes this is, from 0. Goes with --resume."""
    num_processes: int | None = None
    """How many processes there are. Goes with --resume."""


def make_recipe(options: TrainOptions) -> TrainConfig:
    """The preset with the given options put in. Raises UserError where they do not go together."""
    recipe = preset(options.preset)
    names = (
        "train_instances",
        "valid_instances",
        "batch",
        "epochs",
        "learning_rate",
        "schedule",
        "objective",
        "learner",
        "samples",
        "entropy",
        "clip",
        "alpha",
        "beta",
    )
    given = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    policy = recipe.policy
    if options.hidden is not None:
        policy = replace(policy, hidden=options.hidden)
    problem, distribution = make_distribution(options, recipe)
    others = recipe.others if options.orders is None else ()
    return replace(
        recipe, problem=problem, distribution=distribution, policy=policy, others=others, **given
    )


def make_distribution(options: TrainOptions, recipe: TrainConfig) -> tuple[Problem, Source]:
    """What is learned from, and the rules."""
    if orders := order_instances(options):
        problem = orders.problem()
        if len(problem.axes) != len(recipe.problem.axes):
            what = f"{options.preset} is for {len(recipe.problem.axes)}D"
            raise UserError(f"--orders {options.orders}: of {len(problem.axes)}D, but {what}")
        return problem, orders
    problem, distribution = recipe.problem, recipe.distribution
    if options.items is not None:
        distribution = replace(distribution, items=options.items)
    if options.sides is not None:
        ranges = parse_sides(options.sides)
        if len(ranges) > 1:
            raise UserError(f"--sides '{options.sides}': training takes one range, such as 1-5")
        distribution = replace(distribution, low=ranges[0][0], high=ranges[0][1])
    bin = problem.bin if options.bin is None else (options.bin,) * 3
    return problem.resized(bin, distribution.high), distribution


def start_or_resume(options: TrainOptions) -> tuple[Path, RunConfig, Mesh]:
    """The run folder, made or found, its config, and the devices that will train it."""
    if options.resume is not None:
        where = {name: getattr(options, name) for name in ("resume", *WHERE)}
        if options != TrainOptions(**where):
            raise UserError("--resume takes no other option: the run folder holds them all")
        config = read_run(options.resume)
        source = read_again(config.train.distribution)
        config = replace(config, train=replace(config.train, distribution=source))
        return options.resume, config, _mesh(options, config)
    recipe = make_recipe(options)
    config = RunConfig(
        options.preset,
        options.seed,
        recipe,
        options.chunk,
        options.checkpoint_every,
        options.start_from,
    )
    starting_params(config)  # what cannot be is said before there is a folder
    mesh = _mesh(options, config)
    stamp = time.strftime("%Y%m%d-%H%M%S")
    if options.run is None and jax.process_count() > 1:
        raise UserError("--run: name the folder that the processes share")
    run = options.run or Path("runs") / f"{options.preset}-{stamp}-{os.getpid()}"
    on_first(lambda: create_run(run, config))
    return run, config, mesh


def _mesh(options: TrainOptions, config: RunConfig) -> Mesh:
    devices = pick_devices(options.devices, config.train.batch, jax.process_count())
    return data_mesh(devices, everywhere=True)


@contextmanager
def asked_to_stop() -> Iterator[Callable[[], bool]]:
    """A function that tells whether a SIGTERM came: it ends nothing while the block runs."""
    asked = Event()
    before = signal.signal(signal.SIGTERM, lambda *_: asked.set())
    try:
        yield asked.is_set
    finally:
        signal.signal(signal.SIGTERM, before)


def follow(
    run: Path, config: RunConfig, console: Console, stop: Callable[[], bool], mesh: Mesh
) -> None:
    """Trains to the end behind a progress bar, and into TensorBoard where it is installed.

    `stop` and `mesh`: see `train_run`.
    """
    columns = ("{task.description}", "{task.completed}/{task.total}", "{task.fields[figures]}")
    progress = Progress(
        TextColumn(columns[0]),
        BarColumn(bar_width=20),
        TextColumn(columns[1]),
        TextColumn(columns[2]),
        TimeRemainingColumn(),
        console=console,
    )
    board = _tensorboard(run) if is_first() else None
    with progress:
        task = progress.add_task("training", total=config.train.updates, figures="compiling")
        for record in train_run(run, config, stop, mesh):
            if "validation" in record:
                figures = record["validation"]
                console.print(f"update {record['update']}, greedy, validation: {_figures(figures)}")
            else:
                figures = {k: v for k, v in record.items() if isinstance(v, float)}
                speed = f"{record['updates_per_second']:.1f}/s"
                text = f"{speed} {_figures(figures)}"
                progress.update(task, completed=record["update"], figures=text)
            for name, value in figures.items():
                kind = "validation" if "validation" in record else "train"
                if board:
                    board.add_scalar(f"{kind}/{name}", value, record["update"])
    if board:
        board.close()


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
    names = (("cost", "cost"), ("compactness", "C"), ("pyramid", "P"), ("bins", "bins"))
    return " ".join(f"{short} {values[name]:.3f}" for name, short in names)


def _tensorboard(run: Path) -> Any:
    try:
        from tensorboardX import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(str(run / "tensorboard"))


def main(argv: Sequence[str]) -> None:
    """Parses, trains, prints."""
    options = parse_options(TrainOptions, "train", argv)
    join_processes(options.coordinator, options.process_id, options.num_processes)
    use_all_cores()
    check_device()
    run, config, mesh = start_or_resume(options)
    console = Console(quiet=not is_first())
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
