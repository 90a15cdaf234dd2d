"""Recipes by name."""

from jaxpack.errors import UserError
from jaxpack.learning.trainer import TrainConfig
from jaxpack.packing.instances import Distribution
from jaxpack.packing.problem import Problem

PAPER_2D = Problem(bin=(10, 1, 10), largest=(5, 1), support=0.5, inclusive=True)
PAPER_3D = Problem(bin=(10, 10, 10), largest=(5, 5), support=0.5, inclusive=False)

PRESETS = {
    # The paper's recipe, section III.A: 100,000 instances, batch 50, 5 epochs, Adam 5e-4.
    "paper-2d": TrainConfig(problem=PAPER_2D, distribution=Distribution(items=40, low=1, high=5)),
    "paper-3d": TrainConfig(problem=PAPER_3D, distribution=Distribution(items=70, low=2, high=5)),
    # The same in 2D, cut to what a first run should take.
    "quick-2d": TrainConfig(
        problem=PAPER_2D,
        distribution=Distribution(items=40, low=1, high=5),
        train_instances=125_000,
        valid_instances=1_000,
        epochs=1,
    ),
}
DEFAULT_PRESET = "quick-2d"


def preset(name: str) -> TrainConfig:
    """The recipe with this name. Raises UserError naming the recipes that there are."""
    if name not in PRESETS:
        raise UserError(f"unknown preset '{name}': choose one of {', '.join(PRESETS)}")
    return PRESETS[name]
