"""What a policy can do, whichever network it is, and the networks that there are.

A network is a frozen dataclass: its fields are its options, its methods what can be done with it
and weights. Whoever packs, trains, saves or names a policy uses these and nothing else.
"""

from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from jax import Array

from jaxpack.learning.bin_aware import BinAwareConfig
from jaxpack.learning.losses import Outcome
from jaxpack.learning.parameters import Params
from jaxpack.learning.pointer import PointerConfig
from jaxpack.model.problem import Instance, Problem
from jaxpack.packing.env import Decisions

if TYPE_CHECKING:
    from jaxpack.learning.recipe import TrainConfig


class Network(Protocol):
    """A policy's options and what it does; hashable, static under ``jit``. All else is pure."""

    __dataclass_fields__: ClassVar[dict[str, Any]]
    searches: ClassVar[tuple[str, ...]]
    """Of best-of-N, beam-N and search: how it may be named as a method, its name before it."""
    step_by_step: ClassVar[bool]
    """Whether it can leave steps out of its loss, see `TrainConfig.loss_steps`."""

    @property
    def name(self) -> str:
        """Of its kind, the key in NETWORKS; what `python -m jaxpack.evaluate` calls it."""

    @property
    def hidden(self) -> int:
        """D: width of its layers."""

    def learners(self, objective: str) -> tuple[str, ...]:
        """The rules it can be trained by towards this objective; see `TrainConfig.learner`."""

    def init(self, problem: Problem, key: Array) -> Params:
        """Fresh weights. `key` is a typed PRNG key, consumed."""

    def adopt(self, network: Any, params: Params) -> Params:
        """Weights with which this network decides what `network` decides with `params`.

        Args:
            network: of the same kind and width; what it sees may be scaled otherwise.

        Raises:
            UserError: where there are none.
        """

    def orders(
        self,
        problem: Problem,
        params: Params,
        instances: Instance,
        keys: Array | None = None,
        kinds: int | None = None,
        temperature: float | None = None,
    ) -> Decisions:
        """What it decides: the most probable choice at every step, or with keys a sample.

        Args:
            instances: leaves [B, ...].
            keys: typed PRNG keys [B].
            kinds: at least the number of distinct sizes in an instance; N if not given. Fewer may
                be faster.
            temperature: samples are drawn from probabilities to the power of 1 / temperature; the
                network's own if not given.

        Returns:
            leaves [B, N]. Where `Instance.turned` leaves a choice and the network makes none, the
            first orientation.
        """

    def beams(
        self,
        problem: Problem,
        params: Params,
        instances: Instance,
        width: int,
        kinds: int | None = None,
    ) -> Decisions:
        """Where the beams end, the greedy one first: leaves [B, width, N].

        Raises:
            UserError: where it has no beam search.
        """

    def gradient(
        self, config: "TrainConfig", params: Params, instances: Instance, keys: Array
    ) -> tuple[Params, Outcome]:
        """The gradient of the config's loss, a mean over the batch, and what the orders were like.

        Args:
            config: its `policy` is this network.
            instances: leaves [B, ...].
            keys: typed PRNG keys [B, S], one for each order that is drawn.
        """


NETWORKS: dict[str, type[Network]] = {
    network.name: network for network in (PointerConfig, BinAwareConfig)
}
"""By name. A network that is added here can be trained, saved, loaded and evaluated."""
