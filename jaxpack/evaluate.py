"""`python -m jaxpack.evaluate`: methods side by side on fresh instances, or over a grid."""

import hashlib
import json
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from tyro.conf import FlagCreatePairsOff, Positional, UseAppendAction

from jaxpack.cli import parse_options, parse_sides, parse_whole, run_door
from jaxpack.comparison import Comparison, Row, compare, grid_cells, grid_problem
from jaxpack.errors import UserError
from jaxpack.io.atomic import replace_file
from jaxpack.io.runs import read_policy
from jaxpack.io.sweeps import open_sweep
from jaxpack.learning.presets import preset
from jaxpack.learning.recipe import Policy, TrainConfig
from jaxpack.methods import SEARCHES, MethodOptions, make_method
from jaxpack.model.instances import Cell, Source
from jaxpack.model.objectives import grid_costs
from jaxpack.model.problem import Problem
from jaxpack.online import METHODS, OnlineComparison, compare_online, make_chooser, online_table
from jaxpack.orders import order_instances
from jaxpack.packing.online import SETTINGS
from jaxpack.packing.rules import rule_named
from jaxpack.packing.selfcheck import check_device
from jaxpack.search.breeding import BrkgaConfig
from jaxpack.tables import print_table
from jaxpack.xla.devices import pick_devices


@dataclass(frozen=True)
class EvaluateOptions:
    """Compare methods on fresh instances. Lists in --items, --bin, --sides span a grid."""

    preset: Positional[str] = "bin-aware-2d"
    """The instances and the rules: a preset of `python -m jaxpack.train`, or online-1, online-2 or
    online-3, where items come one by one."""
    methods: str = "random,volume,footprint,height,best-of-1000,brkga,pointer,bin-aware"
    """Comma-separated: random, volume, footprint, height, best-of-N, brkga, pointer, bin-aware,
    bin-aware-best-of-N, bin-aware-beam-N, bin-aware-search, brkga-seeded. Online: least-z,
    best-fit, largest-space, flattest, online, online-plan, online-plan-N."""
    orders: Path | None = None
    """Orders to evaluate on, not random instances: .csv, one for each name in its column ORDER, or
    .json. A preset other than bin-aware-2d names the shipped policy then."""
    bins: Path | None = None
    """The bins that --orders go into, .csv."""
    bin_type: str = ""
    """Name or row of the one type of --bins that is used."""
    ignore: UseAppendAction[tuple[str, ...]] = ()
    """A column of --orders or --bins that need not be obeyed; may be given several times."""
    skip_unfit: FlagCreatePairsOff[bool] = False
    """Leave out the items of --orders that the bin cannot hold; otherwise they are an error."""
    instances: int | None = None
    """Instances per cell and seed: if not given 1000, or all --orders; 2000 sequences online."""
    seed: int = 0
    """Gives the instances and the random choices; instance i depends on the seed and i alone."""
    seeds: int = 1
    """Seeds seed, seed + 1, ...: pooled, for smaller standard errors."""
    items: str | None = None
    """Items per instance, such as 20,40,80."""
    bin: str | None = None
    """Sides of the bin in cells, such as 8,10,12."""
    sides: str | None = None
    """Ranges of item sides, such as 1-5,2-5."""
    batch: int = 100
    """Instances side by side; changes the time, not the figures."""
    devices: int | None = None
    """Devices that share each batch; the most that divide it if not given."""
    run: Path | None = None
    """The run folder whose policy is used; the shipped ones if not given."""
    chunk: int = 10_000
    """Instances in memory at a time; changes neither."""
    sweep: Path | None = None
    """Keep the sums of every chunk in this file; the same command goes on from there."""
    json: Path | None = None
    """Write the rows to this file."""
    no_validate: FlagCreatePairsOff[bool] = False
    """Skip the independent check of every packing."""
    rule: str = "lowest"
    """Which of its allowed positions an item takes: lowest (the paper's), nearest-corner,
    far-corner, most-contact or least-wasted. Policies see its positions."""
    objective: str = "bins"
    """What the methods that search minimise: bins (bins, then C, then P) or paper (R)."""
    time_limit: float | None = None
    """Seconds per instance for brkga, brkga-seeded, bin-aware-search, not their counts."""
    search_width: int = MethodOptions.width
    """Partial packings that bin-aware-search keeps from bin to bin."""
    search_draws: int = MethodOptions.draws
    """Orders that bin-aware-search draws for each of them."""
    search_rounds: int = MethodOptions.rounds
    """Bins that bin-aware-search fills without a time limit."""
    search_generations: int = MethodOptions.breeding
    """Generations of BRKGA that its finds breed after each; 0 for none."""
    brkga_population: int = BrkgaConfig.population
    """Individuals per generation."""
    brkga_generations: int = BrkgaConfig.generations
    """Generations after the first population."""
    brkga_unseeded: FlagCreatePairsOff[bool] = False
    """Start brkga from random keys alone, not from the sorts."""
    lookahead: int = 1
    """Online: how many items are known, from the next one on."""
    buffer: int = 1
    """Online: how many items are held, of which any may be placed next."""
    many_bins: FlagCreatePairsOff[bool] = False
    """Online: as many bins as it takes, not one."""


ONLINE = ("lookahead", "buffer", "many_bins")  # for online presets alone
SHARED = ("preset", "methods", "instances", "seed", "items", "batch", "json", "no_validate")
"""For online presets too."""


def make_cells(options: EvaluateOptions) -> tuple[EvaluateOptions, Problem, list[Cell]]:
    """(the options, completed; the rules; where to compare)."""
    rule_named(options.rule, "--rule")
    orders = order_instances(options)
    if orders is None:
        recipe = preset(options.preset)
        cells = grid_of(options, recipe)
        problem = grid_problem(recipe.problem, cells)
        count = 1000
    else:
        problem, cells = orders.problem(), [Cell(orders.bin, orders)]
        count = orders.count
        if (options.instances or 0) > count:
            raise UserError(f"--instances {options.instances}: there are {count} orders")
        shipped = options.preset
        if shipped == EvaluateOptions.preset:
            shipped = f"bin-aware-{len(problem.axes)}d-turned"
        options = replace(options, preset=shipped, batch=min(options.batch, count))
    if options.instances is None:
        options = replace(options, instances=count)
    return options, replace(problem, rule=options.rule), cells


def grid_of(options: EvaluateOptions, recipe: TrainConfig) -> list[Cell]:
    """The grid that the options span around the preset."""
    d, bin = recipe.distribution, recipe.problem.bin
    items = parse_whole("items", options.items) if options.items else [d.items]
    sides = parse_sides(options.sides) if options.sides else [(d.low, d.high)]
    bins = parse_whole("bin", options.bin) if options.bin else [max(bin)]
    return grid_cells(recipe.problem, items, bins, sides)


def sweep_options(
    options: EvaluateOptions, policy: Policy | None, source: Source
) -> dict[str, Any]:
    """What the figures depend on, as plain data: not how they are made, nor where they go."""
    how = ["batch", "chunk", "devices", "json", "no_validate", "sweep", "run"]
    how += ["orders", "bins", "bin_type", "ignore", "skip_unfit"]
    told = {name: value for name, value in asdict(options).items() if name not in how}
    if options.orders is not None:
        told["orders"] = repr(source)
    if policy is not None:
        weights = b"".join(np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(policy.params))
        told["run's policy"] = hashlib.sha256(weights).hexdigest()[:16]
    return told


def evaluate_online(options: EvaluateOptions) -> None:
    """Compares methods that pack one item at a time, and prints the table.

    Raises:
        UserError: where an option is not for them, or there is no such method.
    """
    for name, value in asdict(options).items():
        if name not in (*ONLINE, *SHARED) and value != getattr(EvaluateOptions, name):
            raise UserError(f"--{name.replace('_', '-')}: not for {options.preset}")
    default = options.methods == EvaluateOptions.methods
    names = METHODS if default else [name.strip() for name in options.methods.split(",")]
    items = parse_whole("items", options.items) if options.items else [OnlineComparison.items]
    if len(items) > 1:
        raise UserError(f"--items {options.items}: give one number for {options.preset}")
    comparison = OnlineComparison(
        options.preset, options.instances or OnlineComparison.sequences, items[0], options.seed,
        options.batch, options.buffer, options.lookahead, options.many_bins,
        not options.no_validate,
    )  # fmt: skip
    for name in names:
        make_chooser(name, options.preset)  # what cannot be is said before anything is compiled
    check_json(options)
    console, rows = Console(), []
    for name in names:
        with console.status(f"{name}, {comparison.sequences} sequences"):
            rows.append(compare_online(comparison, name))
    if options.json:
        with replace_file(options.json) as file:
            file.write(json.dumps([row.record() for row in rows], indent=2) + "\n")
    console.print(online_table(comparison, rows))


def check_json(options: EvaluateOptions) -> None:
    """Raises UserError where the rows could not be written."""
    if options.json and not options.json.absolute().parent.is_dir():
        raise UserError(f"--json {options.json}: its folder does not exist; make it first")


def main(argv: Sequence[str]) -> None:
    """Parses, compares, prints."""
    options = parse_options(EvaluateOptions, "evaluate", argv)
    if options.preset.startswith("online"):
        if options.preset not in SETTINGS:
            raise UserError(f"unknown preset '{options.preset}': choose {', '.join(SETTINGS)}")
        evaluate_online(options)
        return
    for name in ONLINE:
        if getattr(options, name) != getattr(EvaluateOptions, name):
            known = ", ".join(SETTINGS)
            raise UserError(f"--{name.replace('_', '-')}: only for {known}")
    grid_costs("--objective", options.objective)
    names = [name.strip() for name in options.methods.split(",") if name.strip()]
    if not names:
        raise UserError("--methods names none: give some, such as random,height")
    options, problem, cells = make_cells(options)
    assert options.instances is not None
    comparison = Comparison(
        problem, options.instances, options.seed, options.seeds, options.batch,
        not options.no_validate, pick_devices(options.devices, options.batch), options.chunk,
    )  # fmt: skip
    for option in ("time_limit", "search_width", "search_draws", "search_rounds"):
        if getattr(options, option) is not None and not getattr(options, option) > 0:
            raise UserError(
                f"--{option.replace('_', '-')} {getattr(options, option)}: give more than 0"
            )
    if options.search_generations < 0:
        raise UserError(f"--search-generations {options.search_generations}: give 0 or more")
    if options.time_limit and not set(names) & set(SEARCHES):
        raise UserError(f"--time-limit: none of the methods takes one, only {', '.join(SEARCHES)}")
    policy = read_policy(options.run) if options.run else None
    settings = MethodOptions(
        objective=options.objective,
        brkga=BrkgaConfig(options.brkga_population, options.brkga_generations),
        brkga_seeded=not options.brkga_unseeded,
        policy=policy,
        shipped=options.preset,
        kinds=max(cell.distribution.kinds(problem) for cell in cells),
        width=options.search_width,
        draws=options.search_draws,
        rounds=options.search_rounds,
        breeding=options.search_generations,
        time_limit=options.time_limit,
    )
    check_device()
    methods = {name: make_method(name, problem, settings) for name in names}
    check_json(options)
    told = sweep_options(options, policy, cells[0].distribution)
    console = Console()
    rows: list[Row] = []
    kept = open_sweep(options.sweep, told) if options.sweep else None
    with kept or nullcontext() as sweep:
        for name, method in methods.items():
            with console.status(f"{name}, {len(cells)} x {options.instances} instances"):
                rows += compare(comparison, name, method, cells, sweep)
    rows.sort(key=lambda row: (row.items, row.bin, row.sides))
    if options.json:
        with replace_file(options.json) as file:
            file.write(json.dumps([row.record() for row in rows], indent=2) + "\n")
    print_table(console, rows)


if __name__ == "__main__":
    run_door(main)
