"""The policy that sees the bin: which kind of item next, and how it is turned."""

from dataclasses import dataclass, field
from typing import ClassVar

from jaxpack.errors import UserError, check_counts
from jaxpack.learning.beam import beam_orders
from jaxpack.learning.bin_gradients import bin_aware_gradient
from jaxpack.learning.bin_network import SEES, init_network, rescale_inputs
from jaxpack.learning.parameters import Params
from jaxpack.learning.rollout import choose_orders
from jaxpack.packing.rules import rule_named


@dataclass(frozen=True)
class BinAwareConfig:
    """Shape of the network, and which of its ingredients are there (for ablations).

    The methods are described by `Network`.
    """

    hidden: int = 64  # D: width of both layers
    sees: str = "surroundings"  # of every candidate, see SEES
    pooling: bool = True  # rows see the means over what remains and what fits
    attention: int = 0  # heads of attention among the rows between the layers
    positions: tuple[str, ...] = ()  # position rules among which it chooses, beside the problem's
    temperature: float = 1.0  # of the samples that a search draws; training draws at 1
    # What it sees, as shares, enters as input_scale (share - input_centre).
    input_centre: float = 0.0
    input_scale: float = 1.0
    name: str = field(default="bin-aware", init=False)
    searches: ClassVar[tuple[str, ...]] = ("best-of-N", "beam-N", "search")
    step_by_step: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.sees not in SEES:
            raise UserError(f"sees '{self.sees}': choose {' or '.join(SEES)}")
        for name in self.positions:
            rule_named(name, "positions")
        if len(set(self.positions)) < len(self.positions):
            raise UserError(f"positions {','.join(self.positions)}: name every rule once")
        check_counts(self, "hidden", most=1 << 16)
        for name in ("temperature", "input_scale"):
            if not getattr(self, name) > 0:
                raise UserError(f"{name} {getattr(self, name)}: give more than 0")
        if self.attention < 0 or (self.attention and self.hidden % self.attention):
            raise UserError(f"attention {self.attention}: give a number of heads dividing hidden")

    def learners(self, objective: str) -> tuple[str, ...]:
        """It has no critic, and of the costs only that of the bins is a sum over bins."""
        by_bin = ("leave-one-out-by-bin", "leave-one-out-by-waste") if objective == "bins" else ()
        return "leave-one-out", *by_bin, "self-label"

    def adopt(self, network: "BinAwareConfig", params: Params) -> Params:
        """What centre and scale do goes into the first layers."""
        return rescale_inputs(params, network, self)

    init = init_network
    orders = choose_orders
    beams = beam_orders
    gradient = bin_aware_gradient
