"""What `python -m jaxpack.train` is told, and the recipes that it stands for."""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from tyro.conf import FlagCreatePairsOff, Positional, UseAppendAction

from jaxpack.cli import parse_numbers, parse_sides, parse_whole
from jaxpack.errors import UserError, check_counts
from jaxpack.io.runs import RunConfig
from jaxpack.learning.presets import DEFAULT_PRESET, preset
from jaxpack.learning.recipe import TrainConfig
from jaxpack.model.instances import Source
from jaxpack.model.orders import Orders
from jaxpack.model.problem import Problem
from jaxpack.orders import order_instances

WHERE = ("devices", "coordinator", "process_id", "num_processes")  # no part of what a run is
WHOLE = (
    "items",
    "bin",
    "train_instances",
    "valid_instances",
    "batch",
    "epochs",
    "samples",
    "hidden",
    "halves",
)
REAL = (
    "learning_rate",
    "average",
    "entropy",
    "clip",
    "loss_steps",
    "discount",
    "alpha",
    "beta",
    "input_centre",
    "input_scale",
)
"""The options that are numbers, or lists of them."""
OF_NETWORK = ("hidden", "input_centre", "input_scale")
OTHERS = ("items", "bin", *OF_NETWORK)  # of these, what a recipe has elsewhere


@dataclass(frozen=True)
class TrainOptions:
    """Train a policy in a run folder, or a sweep of them. Options not given are the preset's.

    Numbers may be lists, such as 1e-3,3e-3: every combination is trained, with every seed.
    """

    preset: Positional[str] = DEFAULT_PRESET
    """bin-aware-2d or -3d, also with -range or -turned, paper-2d or paper-3d."""
    resume: Path | None = None
    """Go on with this run folder, or sweep; takes no other option."""
    run: Path | None = None
    """The folder to make; runs/PRESET-TIME if not given."""
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
    seeds: int = 1
    """Train with seeds seed, seed + 1, ..., so many."""
    items: str | None = None
    """Items per instance."""
    bin: str | None = None
    """Side of the bin in cells, in every axis of the preset's bin."""
    sides: str | None = None
    """Smallest and largest side of an item, as LOW-HIGH."""
    train_instances: str | None = None
    """Size of the fixed training set."""
    valid_instances: str | None = None
    """Size of the fixed validation set."""
    batch: str | None = None
    """Instances per update."""
    epochs: str | None = None
    """Passes over the training set."""
    learning_rate: str | None = None
    """At the start."""
    average: str | None = None
    """Decay per update of a mean of the weights, which is what is kept; 0 keeps the weights."""
    schedule: str | None = None
    """Of the rate: constant, or cosine (down to zero)."""
    objective: str | None = None
    """What is minimised: bins (bins, then C, then P) or paper (R)."""
    learner: str | None = None
    """critic, leave-one-out, leave-one-out-by-bin, leave-one-out-by-waste, or self-label: imitate
    the best sample."""
    discount: str | None = None
    """Of what a bin wastes to a choice one bin before: leave-one-out-by-waste only."""
    samples: str | None = None
    """Orders drawn per instance."""
    entropy: str | None = None
    """Weight of the choices' entropy in the loss."""
    clip: str | None = None
    """Largest norm of a gradient, 0 for any."""
    loss_steps: str | None = None
    """Share of the steps of an order, drawn at random, that enter the loss: bin-aware only."""
    halves: str | None = None
    """Updates with half of the items for each one with all of them."""
    alpha: str | None = None
    """Weight of compactness in the cost."""
    beta: str | None = None
    """Weight of pyramid in the cost."""
    hidden: str | None = None
    """Width of the network."""
    input_centre: str | None = None
    """What is taken from all that the network sees, as shares: bin-aware only."""
    input_scale: str | None = None
    """What that is multiplied by."""
    positions: str | None = None
    """Position rules among which the policy chooses beside the problem's, separated by commas:
    nearest-corner, far-corner, least-wasted, most-contact (slow); bin-aware only."""
    chunk: int = 20
    """Updates per dispatch and per line of metrics.jsonl, at most."""
    checkpoint_every: int = 100
    """Updates between validations and checkpoints, at least."""
    devices: int | None = None
    """Devices that share each batch, or the runs of a sweep; if not given the most that divide the
    batch, or all. Goes with --resume."""
    coordinator: str | None = None
    """HOST:PORT of process 0, to train in several processes. Found under SLURM. With --resume."""
    process_id: int | None = None
    """Which of the processes this is, from 0. Goes with --resume."""
    num_processes: int | None = None
    """How many processes there are. Goes with --resume."""


def check_resume(options: TrainOptions) -> None:
    """Raises UserError where --resume is given with what the folder holds."""
    where = {name: getattr(options, name) for name in ("resume", *WHERE)}
    if options != TrainOptions(**where):
        raise UserError("--resume takes no other option: the run folder holds them all")


def new_path(options: TrainOptions) -> Path:
    """The folder to make."""
    stamp = time.strftime("%Y%m%d-%H%M%S")
    return options.run or Path("runs") / f"{options.preset}-{stamp}-{os.getpid()}"


class Planned(NamedTuple):
    """A run to be made."""

    folder: str  # within that of its sweep
    setting: str  # the numbers that are lists
    config: RunConfig


def plan_runs(options: TrainOptions) -> list[Planned]:
    """Every combination of the numbers given with every seed: one run where nothing is a list.

    Raises:
        UserError: where options do not go together.
    """
    check_counts(options, "seeds")
    numbers: dict[str, list[Any]] = {}
    for names, parse in ((WHOLE, parse_whole), (REAL, parse_numbers)):
        for name in names:
            if (text := getattr(options, name)) is not None:
                numbers[name] = parse(name.replace("_", "-"), text)
    for name, values in numbers.items():
        if twice := [value for value in values if values.count(value) > 1]:
            raise UserError(f"--{name.replace('_', '-')}: {twice[0]} is there twice")
    orders = order_instances(options)
    listed = [name for name, values in numbers.items() if len(values) > 1]
    runs = []
    for chosen in product(*numbers.values()):
        setting = dict(zip(numbers, chosen, strict=True))
        recipe = make_recipe(options, setting, orders)
        words = [f"{name.replace('_', '-')} {setting[name]}" for name in listed]
        for seed in range(options.seed, options.seed + options.seeds):
            folder = "-".join(word.replace(" ", "-") for word in (f"seed {seed}", *words))
            config = RunConfig(
                options.preset,
                seed,
                recipe,
                options.chunk,
                options.checkpoint_every,
                options.start_from,
            )
            runs.append(Planned(folder, ", ".join(words), config))
    return runs


def make_recipe(
    options: TrainOptions, numbers: Mapping[str, Any], orders: Orders | None
) -> TrainConfig:
    """The preset with the given options put in.

    Args:
        numbers: by option, those of WHOLE and REAL that are given.
        orders: from `order_instances`.

    Raises:
        UserError: where they do not go together.
    """
    recipe = preset(options.preset)
    given = {name: number for name, number in numbers.items() if name not in OTHERS}
    for name in ("schedule", "objective", "learner"):
        if getattr(options, name) is not None:
            given[name] = getattr(options, name)
    policy = recipe.policy
    if shape := {name: numbers[name] for name in OF_NETWORK if name in numbers}:
        if unknown := shape.keys() - {field.name for field in fields(policy)}:
            raise UserError(f"--{min(unknown).replace('_', '-')}: {options.preset} has none")
        policy = replace(policy, **shape)
    if options.positions is not None:
        if not hasattr(policy, "positions"):
            raise UserError(f"--positions: {options.preset} chooses none, use bin-aware")
        policy = replace(policy, positions=tuple(options.positions.split(",")))
    problem, distribution = make_distribution(options, recipe, numbers, orders)
    if orders:
        recipe = replace(recipe, halves=0, others=())
    return replace(recipe, problem=problem, distribution=distribution, policy=policy, **given)


def make_distribution(
    options: TrainOptions, recipe: TrainConfig, numbers: Mapping[str, Any], orders: Orders | None
) -> tuple[Problem, Source]:
    """What is learned from, and the rules."""
    if orders:
        problem = orders.problem()
        if len(problem.axes) != len(recipe.problem.axes):
            what = f"{options.preset} is for {len(recipe.problem.axes)}D"
            raise UserError(f"--orders {options.orders}: of {len(problem.axes)}D, but {what}")
        return problem, orders
    problem, distribution = recipe.problem, recipe.distribution
    if "items" in numbers:
        distribution = replace(distribution, items=numbers["items"])
    if options.sides is not None:
        ranges = parse_sides(options.sides)
        if len(ranges) > 1:
            raise UserError(f"--sides '{options.sides}': training takes one range, such as 1-5")
        distribution = replace(distribution, low=ranges[0][0], high=ranges[0][1])
    bin = (numbers["bin"],) * 3 if "bin" in numbers else problem.bin
    return problem.resized(bin, distribution.high), distribution
