"""Recipes by name."""

from dataclasses import replace

from jaxpack.errors import UserError
from jaxpack.learning.bin_aware import BinAwareConfig
from jaxpack.learning.recipe import TrainConfig
from jaxpack.model.instances import Cell, Distribution
from jaxpack.model.problem import Problem

PAPER_2D = Problem(bin=(10, 1, 10), largest=(5, 1), support=0.5, inclusive=True)
PAPER_3D = Problem(bin=(10, 10, 10), largest=(5, 5), support=0.5, inclusive=False)

# Of policies that learn for an hour: those shipped, and those with other bins and items besides.
LONG = TrainConfig(
    problem=PAPER_2D,
    distribution=Distribution(items=40, low=1, high=5),
    policy=BinAwareConfig(sees="all", temperature=1.5),
    train_instances=19_200,
    valid_instances=1_000,
    batch=64,
    epochs=1,
    learning_rate=2e-3,
    schedule="cosine",
    objective="bins",
    alpha=1.0,
    beta=0.05,
    learner="leave-one-out",
    samples=8,
    entropy=0.001,
    clip=1.0,
)

LONG_3D = replace(
    LONG,
    problem=PAPER_3D,
    distribution=Distribution(items=70, low=2, high=5),
    policy=BinAwareConfig(sees="all"),
    train_instances=153_600,
    learner="leave-one-out-by-bin",
)

# What gets nearly as far in a fraction of the time. Centred inputs are what matters most: where all
# lie above zero, one direction of the first layer learns fast and the others slowly. In 3D it is
# better to have fewer samples of more instances.
BIN_AWARE_2D = replace(
    LONG,
    policy=BinAwareConfig(sees="all", temperature=1.5, input_centre=0.3, input_scale=4.0),
    train_instances=12_800,
    batch=32,
    learning_rate=4e-3,
    average=0.97,
    learner="leave-one-out-by-waste",
    discount=0.5,
    entropy=3e-4,
    clip=0.1,
    loss_steps=0.25,
)
BIN_AWARE_3D = replace(
    BIN_AWARE_2D,
    problem=PAPER_3D,
    distribution=LONG_3D.distribution,
    policy=BinAwareConfig(sees="all", input_centre=0.3, input_scale=4.0),
    train_instances=32_000,
    batch=64,
    average=0.95,
    samples=4,
    discount=0.25,
    halves=1,
)

# From five bins an instance to one that is not full, from cubes of one cell to half the bin.
RANGE = (
    Cell((10, 10, 10), Distribution(items=50, low=1, high=5)),
    Cell((10, 10, 10), Distribution(items=30, low=1, high=8)),
    Cell((8, 8, 8), Distribution(items=50, low=1, high=5)),
    Cell((12, 12, 12), Distribution(items=100, low=1, high=5)),
    Cell((16, 16, 16), Distribution(items=60, low=1, high=5)),
    Cell((20, 20, 20), Distribution(items=100, low=1, high=5)),
)
RANGE_3D = (
    *RANGE,
    # Every order takes two bins, or one: only the heights matter.
    Cell((12, 12, 12), Distribution(items=80, low=1, high=5)),
    Cell((20, 20, 20), Distribution(items=80, low=1, high=5)),
)

# What `jaxpack.solve` makes of a bin and of items that may be turned.
TURNED_2D = (
    Cell((20, 1, 20), Distribution(items=40, low=2, high=14, turns="all")),
    Cell((16, 1, 16), Distribution(items=60, low=1, high=8)),
    Cell((12, 1, 12), Distribution(items=60, low=1, high=6, turns="all")),
    Cell((10, 1, 10), Distribution(items=30, low=1, high=8, turns="all")),
    Cell((8, 1, 8), Distribution(items=50, low=1, high=5)),
)
TURNED_3D = (
    Cell((8, 8, 8), Distribution(items=30, low=1, high=5, turns="all")),
    Cell((8, 8, 8), Distribution(items=40, low=2, high=5, turns="upright")),
    Cell((8, 8, 8), Distribution(items=60, low=1, high=6)),
    Cell((7, 7, 7), Distribution(items=30, low=1, high=6, turns="all")),
    Cell((6, 6, 6), Distribution(items=50, low=1, high=4, turns="upright")),
)

PRESETS = {
    # The policy that sees the bin; every instance is met once.
    "bin-aware-2d": BIN_AWARE_2D,
    "bin-aware-3d": BIN_AWARE_3D,
    # One policy for bins and items of many sizes.
    "bin-aware-2d-range": replace(
        LONG,
        train_instances=80_640,
        learning_rate=5e-3,
        learner="leave-one-out-by-bin",
        others=RANGE,
    ),
    "bin-aware-3d-range": replace(
        LONG_3D, train_instances=80_640, learning_rate=5e-3, others=RANGE_3D
    ),
    "bin-aware-2d-turned": replace(
        LONG,
        train_instances=38_400,
        learning_rate=5e-3,
        learner="leave-one-out-by-bin",
        others=TURNED_2D,
    ),
    "bin-aware-3d-turned": replace(
        LONG_3D, train_instances=38_400, learning_rate=5e-3, others=TURNED_3D
    ),
    # The paper's recipe, section III.A: 100,000 instances, batch 50, 5 epochs, Adam 5e-4.
    "paper-2d": TrainConfig(problem=PAPER_2D, distribution=Distribution(items=40, low=1, high=5)),
    "paper-3d": TrainConfig(problem=PAPER_3D, distribution=Distribution(items=70, low=2, high=5)),
}
DEFAULT_PRESET = "bin-aware-2d"


def preset(name: str) -> TrainConfig:
    """The recipe with this name.

    Args:
        name: bin-aware-2d or -3d, also with -range or -turned; paper-2d or paper-3d, the recipes
            of Wang and Dong, section III.A.

    Raises:
        UserError: naming the recipes that there are.
    """
    if name not in PRESETS:
        raise UserError(f"unknown preset '{name}': choose one of {', '.join(PRESETS)}")
    return PRESETS[name]
