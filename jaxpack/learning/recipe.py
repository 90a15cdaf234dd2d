"""A recipe: what is learned, from what, by which rule and for how long."""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace

from jax import Array

from jaxpack.errors import MOST, UserError, check_counts
from jaxpack.learning.networks import Network
from jaxpack.learning.parameters import Params
from jaxpack.learning.pointer import PointerConfig
from jaxpack.model.instances import Cell, Distribution, Source
from jaxpack.model.objectives import grid_costs
from jaxpack.model.problem import Instance, Packing, Problem

SCHEDULES = ("constant", "cosine")

LEARNERS = {
    "critic": "REINFORCE, what an order costs compared with what the critic expects",
    "leave-one-out": "REINFORCE, compared with the other samples of its instance",
    "leave-one-out-by-bin": "the same, a choice answers for its own bin and later ones alone",
    "leave-one-out-by-waste": "the same, for what its bin and, less, later ones waste",
    "self-label": "imitation of the best sample of each instance",
}
"""What there is to learn by; `Network.learners` says which of them go with what."""

TRACED = ("entropy", "clip", "alpha", "beta", "discount")
"""Numbers of a recipe that may be traced, so that one program trains with any of them, as it does
with any rate, which is in the state."""


@dataclass(frozen=True)
class TrainConfig:
    """Everything but the seed. Hashable, static under jit. The defaults are the paper's.

    Raises:
        UserError: where a number is out of its range, a choice is not known, or two of them do not
            go together.
    """

    problem: Problem  # the rules and the bin
    distribution: Source  # of the items
    policy: Network = PointerConfig()  # which network, and its widths
    train_instances: int = 100_000  # of the fixed training set, a function of the run's key
    valid_instances: int = 10_000  # of the fixed validation set
    batch: int = 50  # B, instances per update
    epochs: int = 5  # passes over the training set
    learning_rate: float = 5e-4  # at the start
    average: float = 0.0  # decay per update of a mean of the weights, which is kept; 0: the weights
    schedule: str = "constant"  # of the rate: constant, or cosine down to zero
    objective: str = "paper"  # the cost: R of Eq. (9), or bins + alpha (1 - C) + beta (1 - P)
    alpha: float = 0.5  # weight of compactness
    beta: float = 0.5  # weight of pyramid
    learner: str = "critic"  # see LEARNERS
    discount: float = 0.25  # of what a bin wastes to a choice one bin before: by-waste only
    samples: int = 1  # S, orders drawn per instance
    entropy: float = 0.0  # weight of the choices' entropy (summed over an order) in the loss
    clip: float = 0.0  # largest norm of a gradient; 0: any
    loss_steps: float = 1.0  # share of an order's steps, drawn at random, that enter the loss
    # Updates take turns: all items of the distribution, so many times half of them,
    halves: int = 0
    others: tuple[Cell, ...] = ()  # and one with each of these bins and distributions

    def __post_init__(self) -> None:
        self.distribution.check_fits(self.problem.bin)
        check_counts(self, "train_instances", "valid_instances", "batch", "epochs")
        check_counts(self, "samples", most=1 << 16)
        if self.batch > self.train_instances:
            raise UserError(
                f"batch {self.batch} is larger than train_instances {self.train_instances}"
            )
        if self.updates > MOST:
            raise UserError(f"epochs {self.epochs}: give at most {MOST // self.updates_per_epoch}")
        if not self.learning_rate > 0:
            raise UserError(f"learning_rate {self.learning_rate}: give a positive rate")
        for name in ("entropy", "clip"):
            if not getattr(self, name) >= 0:
                raise UserError(f"{name} {getattr(self, name)}: give 0 or more")
        if not 0 <= self.average < 1:
            raise UserError(f"average {self.average}: give a decay, 0 or more and below 1")
        if not 0 <= self.discount <= 1:
            raise UserError(f"discount {self.discount}: give a share, from 0 to 1")
        if not 0 < self.loss_steps <= 1:
            raise UserError(f"loss_steps {self.loss_steps}: give a share, above 0 and up to 1")
        if self.loss_steps < 1 and not self.policy.step_by_step:
            raise UserError(
                f"loss_steps {self.loss_steps}: give 1, the {self.policy.name} network learns from "
                "whole orders"
            )
        grid_costs("objective", self.objective)
        if self.schedule not in SCHEDULES:
            raise UserError(f"schedule '{self.schedule}': choose {' or '.join(SCHEDULES)}")
        if self.learner not in (known := self.policy.learners(self.objective)):
            raise UserError(
                f"learner '{self.learner}': choose {' or '.join(known)}, those that the "
                f"{self.policy.name} network has for objective {self.objective}"
            )
        if self.learner != "critic" and self.samples < 2:
            raise UserError(f"learner '{self.learner}' compares samples: give samples 2 or more")
        check_counts(self, "halves", least=0, most=1 << 10)
        if self.halves and not isinstance(self.distribution, Distribution):
            raise UserError(f"halves {self.halves}: give 0, orders of a file are packed whole")
        for cell in self.others:
            cell.distribution.check_fits(self.problem.resized(cell.bin, 1).bin)

    @property
    def updates_per_epoch(self) -> int:
        """Whole batches in the training set."""
        return self.train_instances // self.batch

    @property
    def updates(self) -> int:
        """Updates of a full run."""
        return self.updates_per_epoch * self.epochs

    @property
    def turns(self) -> tuple["TrainConfig", ...]:
        """The config of each turn: one bin and one distribution."""
        own = half = replace(self, halves=0, others=())
        if isinstance(self.distribution, Distribution):
            fewer = replace(self.distribution, items=-(-self.distribution.items // 2))
            half = replace(own, distribution=fewer)
        return (
            own,
            *(half,) * self.halves,
            *(
                replace(
                    own,
                    problem=self.problem.resized(cell.bin, cell.distribution.high),
                    distribution=cell.distribution,
                )
                for cell in self.others
            ),
        )

    @property
    def kinds(self) -> int:
        """K: no instance has more distinct sizes."""
        return self.distribution.kinds(self.problem)

    def traced(self, numbers: Mapping[str, Array]) -> "TrainConfig":
        """The same with arrays for some of its numbers, to be used while a program is traced.

        Args:
            numbers: float32[] each, by names of TRACED; the others stay. They are not checked.
        """
        config = copy(self)
        for name, number in numbers.items():
            object.__setattr__(config, name, number)
        return config

    def lacks(self, name: str) -> bool:
        """Whether this number is 0 whatever the program is given."""
        number = getattr(self, name)
        return isinstance(number, int | float) and number == 0

    def cost(self, instance: Instance, packing: Packing) -> Array:
        """What the training minimises, of one packing: float32 scalar."""
        return grid_costs()[self.objective](instance, packing, self.alpha, self.beta)


@dataclass(frozen=True)
class Policy:
    """A trained policy and the recipe that made it."""

    config: TrainConfig  # its recipe
    params: Params  # its weights: a pytree of float32 arrays
