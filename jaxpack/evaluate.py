"""`python -m jaxpack.evaluate`: methods side by side on fresh instances, or over a grid."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from tyro.conf import FlagCreatePairsOff, Positional

from jaxpack.cli import parse_options, parse_sides, parse_whole, run_door
from jaxpack.comparison import Cell, Comparison, Row, compare, grid_cells, grid_problem
from jaxpack.errors import UserError
from jaxpack.files.atomic import replace_file
from jaxpack.files.runs import read_policy
from jaxpack.files.weights import Policy, load_policy
from jaxpack.learning.presets import preset
from jaxpack.learning.trainer import TrainConfig
from jaxpack.methods import OBJECTIVES, MethodOptions, make_method
from jaxpack.solvers.brkga import BrkgaConfig
from jaxpack.tables import print_table


@dataclass(frozen=True)
class EvaluateOptions:
    """Compare methods on fresh instances. Lists in --items, --bin, --sides span a grid."""

    preset: Positional[str] = "paper-2d"
    """paper-2d, paper-3d or quick-2d."""
    methods: str = "random,volume,footprint,height,best-of-1000,brkga,pointer"
    """Comma-separated: random, volume, footprint, height, best-of-N, brkga, pointer."""
    instances: int = 1000
    """Instances per cell and seed."""
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
    run: Path | None = None
    """The run folder whose policy `pointer` uses; the shipped one if not given."""
    json: Path | None = None
    """Write the rows to this file."""
    no_validate: FlagCreatePairsOff[bool] = False
    """Skip the independent check of every packing."""
    objective: str = "bins"
    """What best-of-N and brkga minimise: bins (bins, then C, then P) or paper (R)."""
    brkga_population: int = BrkgaConfig.population
    """Individuals per generation."""
    brkga_generations: int = BrkgaConfig.generations
    """Generations after the first population."""
    brkga_unseeded: FlagCreatePairsOff[bool] = False
    """Start brkga from random keys alone, not from the sorts."""


def make_cells(options: EvaluateOptions, recipe: TrainConfig) -> list[Cell]:
    """The grid that the options span around the preset."""
    d, bin = recipe.distribution, recipe.problem.bin
    items = parse_whole("items", options.items) if options.items else [d.items]
    sides = parse_sides(options.sides) if options.sides else [(d.low, d.high)]
    bins = parse_whole("bin", options.bin) if options.bin else [max(bin)]
    return grid_cells(recipe.problem, items, bins, sides)


def pointer_policy(run: Path | None, recipe: TrainConfig) -> Policy | None:
    """The policy of a run folder, or the shipped one for the preset's dimension.

    Raises:
        UserError: where the policy is for another dimension than the preset.
    """
    axes = len(recipe.problem.axes)
    policy = read_policy(run) if run else load_policy(f"pointer-{axes}d")
    theirs = len(policy.config.problem.axes)
    if theirs != axes:
        raise UserError(f"{run}: its policy is for {theirs}D, the preset is {axes}D; name another")
    return policy


def main(argv: Sequence[str]) -> None:
    """Parses, compares, prints."""
    options = parse_options(EvaluateOptions, "evaluate", argv)
    recipe = preset(options.preset)
    if options.objective not in OBJECTIVES:
        raise UserError(f"--objective '{options.objective}': choose bins or paper")
    names = [name.strip() for name in options.methods.split(",") if name.strip()]
    if not names:
        raise UserError("--methods names none: give some, such as random,height")
    cells = make_cells(options, recipe)
    problem = grid_problem(recipe.problem, cells)
    comparison = Comparison(
        problem, options.instances, options.seed, options.seeds, options.batch,
        validate=not options.no_validate,
    )  # fmt: skip
    settings = MethodOptions(
        objective=options.objective,
        brkga=BrkgaConfig(options.brkga_population, options.brkga_generations),
        brkga_seeded=not options.brkga_unseeded,
        policy=pointer_policy(options.run, recipe) if "pointer" in names else None,
    )
    methods = {name: make_method(name, problem, settings) for name in names}
    if options.json and not options.json.absolute().parent.is_dir():
        raise UserError(f"--json {options.json}: its folder does not exist; make it first")
    console = Console()
    rows: list[Row] = []
    for name, method in methods.items():
        with console.status(f"{name}, {len(cells)} x {options.instances} instances"):
            rows += compare(comparison, name, method, cells)
    rows.sort(key=lambda row: (row.items, row.bin, row.sides))
    if options.json:
        with replace_file(options.json) as file:
            file.write(json.dumps([row.record() for row in rows], indent=2) + "\n")
    print_table(console, rows)


if __name__ == "__main__":
    run_door(main)
