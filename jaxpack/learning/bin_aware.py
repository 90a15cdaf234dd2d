"""The policy that sees the bin: which kind of item next, and how it is turned."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

from jax import Array

from jaxpack.errors import UserError, check_counts
from jaxpack.learning.beam import beam_orders
from jaxpack.learning.bin_gradients import bin_aware_gradient
from jaxpack.learning.bin_network import init_network
from jaxpack.learning.losses import Outcome
from jaxpack.learning.parameters import Params
from jaxpack.learning.rollout import choose_orders
from jaxpack.model.problem import Instance, Problem
from jaxpack.packing.env import Decisions

if TYPE_CHECKING:
    from jaxpack.learning.recipe import TrainConfig


@dataclass(frozen=True)
class BinAwareConfig:
    """Shape of the network, and which of its ingredients are there (for ablations).

    The methods are described by `Network`.
    """

    hidden: int = 64  # D: width of both layers
    placement: bool = True  # sees where the item would rest
    surroundings: bool = True  # sees what lies under and beside it there
    stock: bool = False  # sees what of the rest would fill the gaps beside and above exactly
    pooling: bool = True  # rows see the means over what remains and what fits
    attention: int = 0  # heads of attention among the rows between the layers
    temperature: float = 1.0  # of the samples that a search draws; training draws at 1
    name: str = field(default="bin-aware", init=False)
    searches: ClassVar[tuple[str, ...]] = ("best-of-N", "beam-N", "search")

    def __post_init__(self) -> None:
        if not self.placement and (self.surroundings or self.stock):
            raise UserError("surroundings and stock belong to a placement: leave it in")
        check_counts(self, "hidden", most=1 << 16)
        if not self.temperature > 0:
            raise UserError(f"temperature {self.temperature}: give more than 0")
        if self.attention < 0 or (self.attention and self.hidden % self.attention):
            raise UserError(f"attention {self.attention}: give a number of heads dividing hidden")

    def learners(self, objective: str) -> tuple[str, ...]:
        """It has no critic."""
        by_bin = ("leave-one-out-by-bin",) * (objective == "bins")  # other costs are not sums
        return "leave-one-out", *by_bin, "self-label"

    def init(self, problem: Problem, key: Array) -> Params:
        """The same for every problem."""
        return init_network(self, key)

    def orders(
        self,
        problem: Problem,
        params: Params,
        instances: Instance,
        keys: Array | None = None,
        kinds: int | None = None,
        temperature: float | None = None,
    ) -> Decisions:
        """It turns items too, where they may be turned."""
        if temperature is None:
            temperature = self.temperature
        return choose_orders(problem, self, params, instances, keys, kinds, temperature)

    def beams(
        self,
        problem: Problem,
        params: Params,
        instances: Instance,
        width: int,
        kinds: int | None = None,
    ) -> Decisions:
        """A wider beam is never worse."""
        return beam_orders(problem, self, params, instances, width, kinds)

    def gradient(
        self, config: "TrainConfig", params: Params, instances: Instance, keys: Array
    ) -> tuple[Params, Outcome]:
        """Of what is chosen, with the advantages that the learner gives."""
        return bin_aware_gradient(config, self, params, instances, keys)
