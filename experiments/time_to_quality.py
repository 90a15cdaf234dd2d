"""How long it takes to train a policy of a given quality: recipes side by side, in turns.

python experiments/time_to_quality.py --recipes "halves only" "one half" --seeds 0 1 2
python experiments/time_to_quality.py --recipes preset "by bin" --to-bar --seeds 0 1 2

After every stretch of updates the greedy policy packs the 1,000 instances of the tables (seed 0,
not those that a run validates on). Writes results/time-to-quality.csv, a line a stretch: seconds
are those of all updates so far, on the clock and of the processor, without what compiling takes
and packing the 1,000. Recipes take turns, so that other work on the machine hits all. Each ends
with its schedule, or where it has come to the bar.
"""

import time
from dataclasses import dataclass, replace

import jax
import tyro
from ablations import greedy_figures
from rich.console import Console
from rows import RESULTS, read_rows, rounded, write_rows

from jaxpack import Distribution, preset
from jaxpack.cli import prepare_jax
from jaxpack.learning.trainer import init_state, train_chunk

BAR = 3.85
"""Mean bins that are to be reached."""
STRETCH = 50
"""Updates of 32 instances between two looks, half as many of 64."""
PRESET = preset("bin-aware-3d")
PLAIN = replace(PRESET.policy, input_centre=0.0, input_scale=1.0)
BY_BIN = {
    "policy": PLAIN, "learner": "leave-one-out-by-bin", "entropy": 1e-3, "clip": 1.0, "halves": 0,
    "samples": 8,
}  # fmt: skip
"""How the shipped policy learned, but for batch, rate and number of updates."""
SMALL = BY_BIN | {"batch": 32, "learning_rate": 4e-3, "loss_steps": 0.25, "average": 0.95}
WASTE = {"batch": 32, "samples": 8, "average": 0.95, "updates": 300, "discount": 0.25}
TRIED = {
    "preset": {"updates": PRESET.updates},
    "by bin": BY_BIN | {"batch": 64, "learning_rate": 2e-3, "loss_steps": 1.0, "average": 0.0,
                        "updates": 2400},
    "64 instances": SMALL | {"batch": 64, "learning_rate": 2e-3, "average": 0.9, "updates": 100},
    "16 instances": SMALL | {"batch": 16, "learning_rate": 2e-3, "updates": 400},
    "16 instances, 4e-3": SMALL | {"batch": 16, "updates": 400},
    "halves only": SMALL | {"schedule": "constant", "learning_rate": 3e-3, "average": 0.98,
                            "updates": 500, "distribution": Distribution(items=35, low=2, high=5)},
    "one half": SMALL | {"updates": 300, "halves": 1},
    **{f"one half, {'; '.join(rules)}": SMALL | {"updates": 300, "halves": 1,
                                                 "policy": replace(PLAIN, positions=rules)}
       for rules in (("far-corner",), ("least-wasted",), ("far-corner", "least-wasted"))},
    "one half, longer": SMALL | {"average": 0.97, "updates": 480, "halves": 1},
    "three halves": SMALL | {"average": 0.97, "learning_rate": 3e-3, "updates": 600, "halves": 3},
    "by waste, discount 1": WASTE | {"policy": PLAIN, "discount": 1.0},
    "by waste, discount 0.5": WASTE | {"policy": PLAIN, "discount": 0.5},
    "by waste": WASTE | {"policy": PLAIN},
    "by waste, discount 0": WASTE | {"policy": PLAIN, "discount": 0.0},
    "by waste, scaled": WASTE | {"policy": replace(PRESET.policy, input_centre=0.0)},
    "by waste, centred": WASTE | {"policy": PRESET.policy},
    "8 samples of 64 instances": {"samples": 8, "updates": 400, "average": 0.97, "discount": 0.5},
    "4 samples, discount 0.5": {"average": 0.97, "discount": 0.5, "updates": 500},
    "2 samples of 128 instances": {"samples": 2, "batch": 128, "updates": 400},
}  # fmt: skip
"""Changes of the preset bin-aware-3d."""


@dataclass(frozen=True)
class Options:
    """Train recipes side by side."""

    recipes: tuple[str, ...] = ("preset", "by bin")
    """Which: names in TRIED."""
    seeds: tuple[int, ...] = (0,)
    """Of weights, data and samples."""
    updates: int | None = None
    """End after so many, with the schedule as it is."""
    to_bar: bool = False
    """End where the bar is reached."""


class Run:
    """A recipe with one seed, its clocks, and a row for each stretch."""

    def __init__(self, name: str, seed: int) -> None:
        self.name, self.seed = name, seed
        changes = dict(TRIED[name])
        updates = changes.pop("updates")
        self.recipe = replace(PRESET, **changes)
        batch = self.recipe.batch
        self.recipe = replace(self.recipe, train_instances=updates * batch)
        self.stretch = STRETCH * 32 // max(batch, 32)
        self.state = init_state(self.recipe, jax.random.key(seed))
        self.train = train_chunk.lower(self.recipe, self.state, self.stretch).compile()
        self.seconds, self.cpu = 0.0, 0.0
        self.rows: list[dict] = []

    def ended(self, options: Options) -> bool:
        """Its schedule or its time is over, or it has come to the bar."""
        done = len(self.rows) * self.stretch
        there = options.to_bar and any(row["bins"] <= BAR for row in self.rows)
        most = min(self.recipe.updates, options.updates or self.recipe.updates)
        return there or done + self.stretch > most

    def go_on(self) -> None:
        """One more stretch."""
        start, cpu = time.perf_counter(), time.process_time()
        self.state, metrics = jax.block_until_ready(self.train(self.state))
        self.seconds += time.perf_counter() - start
        self.cpu += time.process_time() - cpu
        update = (len(self.rows) + 1) * self.stretch
        row = {"recipe": self.name, "seed": self.seed, "update": update}
        row |= {"seconds": self.seconds, "cpu_seconds": self.cpu}
        row |= greedy_figures(replace(PRESET, policy=self.recipe.policy), self.state.kept)
        self.rows.append(rounded(row | {"sampled_bins": float(metrics.outcome.bins)}))
        Console().print(self.rows[-1])


def main() -> None:
    prepare_jax()
    options = tyro.cli(Options)
    path = RESULTS / "time-to-quality.csv"
    for seed in options.seeds:
        ours = [(name, str(seed)) for name in options.recipes]
        kept = [row for row in read_rows(path) if (row["recipe"], row["seed"]) not in ours]
        runs = [Run(name, seed) for name in options.recipes]
        while waiting := [run for run in runs if not run.ended(options)]:
            for run in waiting:
                run.go_on()
            write_rows(path, [*kept, *(row for run in runs for row in run.rows)])


if __name__ == "__main__":
    main()
