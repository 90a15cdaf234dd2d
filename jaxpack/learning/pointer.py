"""The paper's policy: a pointer network that reads all sizes and points at one item at a time.

The network is in another file, which takes Flax: who packs with another policy does not import it.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.errors import UserError, check_counts
from jaxpack.learning.losses import Outcome
from jaxpack.learning.parameters import Params
from jaxpack.model.problem import Instance, Problem
from jaxpack.packing.env import Decisions

if TYPE_CHECKING:
    from jaxpack.learning.recipe import TrainConfig


@dataclass(frozen=True)
class PointerConfig:
    """Widths of the networks. The paper gives none; these are common for pointer networks.

    The methods are described by `Network`.
    """

    hidden: int = 64  # D: encoder channels, GRU state, attention
    critic: int = 20  # channels of the critic's own layers
    input_scale: float = 4.0  # what a side as long as the bin's is to the network
    name: str = field(default="pointer", init=False)
    searches: ClassVar[tuple[str, ...]] = ()
    step_by_step: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_counts(self, "hidden", "critic", most=1 << 16)
        if not self.input_scale > 0:
            raise UserError(f"input_scale {self.input_scale}: give more than 0")

    def learners(self, objective: str) -> tuple[str, ...]:
        """It learns by them whatever the objective."""
        return "critic", "leave-one-out"

    def init(self, problem: Problem, key: Array) -> Params:
        """Weights of actor and critic."""
        from jaxpack.learning.pointer_network import init_pointer

        return init_pointer(problem, self, key)

    def adopt(self, network: "PointerConfig", params: Params) -> Params:
        """The same, of the same scale."""
        if network.input_scale != self.input_scale:
            raise UserError(f"input_scale {self.input_scale}: give {network.input_scale}")
        return params

    def orders(
        self,
        problem: Problem,
        params: Params,
        instances: Instance,
        keys: Array | None = None,
        kinds: int | None = None,
        temperature: float | None = None,
    ) -> Decisions:
        """It sees no kinds and turns nothing."""
        from jaxpack.learning.pointer_network import greedy_order, sample_order

        def draw(one: Instance, key: Array) -> Array:
            return sample_order(problem, self, params, one, key, temperature or 1.0).order

        if keys is None:
            order = jax.vmap(lambda one: greedy_order(problem, self, params, one))(instances)
        else:
            order = jax.vmap(draw)(instances, keys)
        return Decisions(order, jnp.zeros_like(order))

    def beams(self, *_: Any, **__: Any) -> Decisions:
        """It has none."""
        raise UserError("the pointer network has no beam search: use bin-aware")

    def gradient(
        self, config: "TrainConfig", params: Params, instances: Instance, keys: Array
    ) -> tuple[Params, Outcome]:
        """Of Eq. (10)."""
        from jaxpack.learning.pointer_gradient import pointer_gradient

        return pointer_gradient(config, self, params, instances, keys)
