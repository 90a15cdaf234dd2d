"""How long it takes to train a policy of a given quality: recipes side by side, in turns.

python experiments/time_to_quality.py --recipes "halves only" "one half" --seeds 0 1 2
python experiments/time_to_quality.py --recipes preset "one half"

After every stretch of updates the greedy policy packs the 1,000 instances of the tables (seed 0,
not those that a run validates on). Writes results/time-to-quality.csv, a line a stretch: seconds
are those of all updates so far, on the clock and of the processor, without what compiling takes
and packing the 1,000. Recipes take turns, so that other work on the machine hits all. Each ends
with its schedule, the preset when it has come to the bar.
"""

import time
from dataclasses import dataclass, replace

import jax
import tyro
from ablations import greedy_figures
from rich.console import Console
from rows import RESULTS, read_rows, rounded, write_rows

from jaxpack import Distribution, TrainConfig, preset
from jaxpack.cli import prepare_jax
from jaxpack.learning.trainer import init_state, train_chunk

BAR = 3.85
"""Mean bins that are to be reached."""
STRETCH = 50
"""Updates between two looks, half of it for the preset's large ones."""
POLICY = preset("bin-aware-3d").policy
BASE = {"batch": 32, "learning_rate": 4e-3, "loss_steps": 0.25, "average": 0.95}
TRIED = {
    "64 instances": {"batch": 64, "learning_rate": 2e-3, "average": 0.9, "updates": 100},
    "16 instances": {"batch": 16, "learning_rate": 2e-3, "updates": 400},
    "16 instances, 4e-3": {"batch": 16, "updates": 400},
    "halves only": {"schedule": "constant", "learning_rate": 3e-3, "average": 0.98, "updates": 500,
                    "distribution": Distribution(items=35, low=2, high=5)},
    "one half": {"updates": 300, "halves": 1},
    **{f"one half, {'; '.join(rules)}": {"updates": 300, "halves": 1,
                                         "policy": replace(POLICY, positions=rules)}
       for rules in (("far-corner",), ("least-wasted",), ("far-corner", "least-wasted"))},
    "one half, longer": {"average": 0.97, "updates": 480, "halves": 1},
    "three halves": {"average": 0.97, "learning_rate": 3e-3, "updates": 600, "halves": 3},
}  # fmt: skip
"""Changes of BASE, which are changes of bin-aware-3d."""


@dataclass(frozen=True)
class Options:
    """Train recipes side by side."""

    recipes: tuple[str, ...] = ("preset", "one half")
    """Which: the preset bin-aware-3d, or names in TRIED."""
    seeds: tuple[int, ...] = (0,)
    """Of weights, data and samples."""
    updates: int | None = None
    """End after so many, with the schedule as it is."""


class Run:
    """A recipe with one seed, its clocks, and a row for each stretch."""

    def __init__(self, name: str, recipes: dict[str, TrainConfig], seed: int) -> None:
        self.name, self.seed = name, seed
        self.recipe, self.preset = recipes[name], recipes["preset"]
        self.stretch = STRETCH // 2 if name == "preset" else STRETCH
        self.state = init_state(self.recipe, jax.random.key(seed))
        self.train = train_chunk.lower(self.recipe, self.state, self.stretch).compile()
        self.seconds, self.cpu = 0.0, 0.0
        self.rows: list[dict] = []

    def ended(self, most: int | None) -> bool:
        """Its schedule or its time is over, or the preset has come to the bar."""
        done = len(self.rows) * self.stretch
        there = self.name == "preset" and any(row["bins"] <= BAR for row in self.rows)
        return there or done + self.stretch > min(self.recipe.updates, most or self.recipe.updates)

    def go_on(self) -> None:
        """One more stretch."""
        start, cpu = time.perf_counter(), time.process_time()
        self.state, metrics = jax.block_until_ready(self.train(self.state))
        self.seconds += time.perf_counter() - start
        self.cpu += time.process_time() - cpu
        update = (len(self.rows) + 1) * self.stretch
        row = {"recipe": self.name, "seed": self.seed, "update": update}
        row |= {"seconds": self.seconds, "cpu_seconds": self.cpu}
        row |= greedy_figures(replace(self.preset, policy=self.recipe.policy), self.state.kept)
        self.rows.append(rounded(row | {"sampled_bins": float(metrics.outcome.bins)}))
        Console().print(self.rows[-1])


def main() -> None:
    prepare_jax()
    options = tyro.cli(Options)
    recipes = {"preset": preset("bin-aware-3d")}
    for name, changes in TRIED.items():
        changes = BASE | changes
        changes["train_instances"] = changes["batch"] * changes.pop("updates")
        recipes[name] = replace(recipes["preset"], **changes)
    path = RESULTS / "time-to-quality.csv"
    for seed in options.seeds:
        ours = [(name, str(seed)) for name in options.recipes]
        kept = [row for row in read_rows(path) if (row["recipe"], row["seed"]) not in ours]
        runs = [Run(name, recipes, seed) for name in options.recipes]
        while waiting := [run for run in runs if not run.ended(options.updates)]:
            for run in waiting:
                run.go_on()
            write_rows(path, [*kept, *(row for run in runs for row in run.rows)])


if __name__ == "__main__":
    main()
