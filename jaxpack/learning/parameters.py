"""What both networks share, and what describes the pointer network.

The description is not beside the network, which takes Flax: recipes name either network, and who
packs with the bin-aware policy alone does not import Flax.
"""

from dataclasses import dataclass

from jaxpack.errors import UserError, check_counts

Params = dict
"""Nested dict of float32 arrays."""

MASKED = -1e9
"""The score of what must not be chosen: a finite floor, -inf makes NaN gradients."""


@dataclass(frozen=True)
class PointerConfig:
    """Widths of the networks. The paper gives none; these are common for pointer networks."""

    hidden: int = 64  # D: encoder channels, GRU state, attention
    critic: int = 20  # channels of the critic's own layers
    input_scale: float = 4.0  # what a side as long as the bin's is to the network

    def __post_init__(self) -> None:
        check_counts(self, "hidden", "critic", most=1 << 16)
        if not self.input_scale > 0:
            raise UserError(f"input_scale {self.input_scale}: give more than 0")
