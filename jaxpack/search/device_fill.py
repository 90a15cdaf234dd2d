"""Bins filled by one XLA program on one device or several: for where there are faster ones than
the cores of a CPU. What is in them is what `fill` puts there, to the bit.
"""

from functools import partial
from typing import Any

import jax
import numpy as np
from jax import numpy as jnp
from jax.sharding import PartitionSpec as P

from jaxpack.errors import UserError
from jaxpack.search import filling
from jaxpack.search.beam import fill
from jaxpack.search.blocks import step
from jaxpack.search.filling import Axes, Filling, Goods
from jaxpack.search.fillings import Kinds
from jaxpack.search.quick import Stop
from jaxpack.search.together import stacked
from jaxpack.xla.devices import DATA, WHOLE, data_mesh, split_batch

KINDS, LANES, BLOCKS, LENGTHS = 8, 256, 16, 4096
"""Least numbers that a program is for; others are for twice as many, again and again."""


class DeviceFill:
    """Fills as `fill` does, on so many devices, lanes side by side."""

    def __init__(self, devices: int) -> None:
        """With the first of them.

        Raises:
            UserError: there are not so many.
        """
        if not 1 <= devices <= (there := len(jax.local_devices())):
            raise UserError(f"devices {devices}: there are {there}; ask for 1 to {there}")
        self.devices = devices
        self.programs: dict[tuple[Axes, int, bool], Any] = {}

    def __call__(self, kinds: Kinds, goods: Goods, stop: Stop) -> Filling:
        """See `fill`; what `stop` says is looked at before."""
        if kinds.judge is not None or stop():
            return fill(kinds, goods, stop)
        blocks = bucket(kinds.blocks, BLOCKS)
        static = kinds.axes, blocks, kinds.firm
        program = self.programs.get(static)
        if program is None:
            program = self.programs[static] = self._program(*static)
        K, lanes = goods.count.shape
        full = Filling(*map(np.asarray, program(padded(goods, self.devices))))
        full = Filling(*(leaf[..., :lanes] for leaf in full))
        M = kinds.blocks
        return full._replace(
            left=full.left[:K], near=full.near[:, :M], far=full.far[:, :M],
            row=full.row[:M], grid=full.grid[:, :M], firm=full.firm[:, :M],
        )  # fmt: skip

    def _program(self, axes: Axes, blocks: int, firm: bool) -> Any:
        def filled(goods: Goods) -> Filling:
            return jax.lax.while_loop(
                lambda now: filling.goes_on(now).any(),
                partial(step, jnp, axes, goods),
                filling.empty(jnp, goods, blocks, firm),
            )

        mesh = data_mesh(self.devices)
        goods = Goods(*(_last_axis(Goods, name) for name in Goods._fields))
        full = Filling(*(_last_axis(Filling, name) for name in Filling._fields))
        return jax.jit(split_batch(mesh, filled, in_specs=(goods,), out_specs=full))


RANKS = {
    **dict.fromkeys(("side", "shortest", "less", "low", "high", "near", "far", "grid", "firm"), 3),
    **dict.fromkeys(("needed", "value", "weight", "count", "room", "first"), 2),
    **dict.fromkeys(("awake", "row", "left"), 2),
}
"""Axes of the arrays; the others have one."""


def _last_axis(kind: type, name: str) -> Any:
    if name in ("sums", "unit"):
        return WHOLE
    return P(*(None for _ in range(RANKS.get(name, 1) - 1)), DATA)


def bucket(number: int, least: int) -> int:
    """The least of `least`, twice, four times, ... as many that is not less than the number."""
    while least < number:
        least *= 2
    return least


def padded(goods: Goods, devices: int) -> Goods:
    """With as many kinds, lanes and lengths as a program is for; lanes may be cut into parts."""
    K, lanes = goods.count.shape
    ways, more = goods.side.shape[1] // K, bucket(lanes, LANES * devices) - lanes
    nothing = Goods(  # kinds that fill it up, and a lane that has nothing
        side=np.full((3, bucket(K, KINDS) * ways, more), filling.FAR, np.int32),
        shortest=np.full((3, bucket(K, KINDS), more), filling.FAR, np.int32),
        needed=np.ones((bucket(K, KINDS) * ways, more), np.int32),
        value=np.zeros((bucket(K, KINDS) * ways, more), np.float32),
        weight=np.zeros((bucket(K, KINDS), more), np.int32),
        count=np.zeros((bucket(K, KINDS), more), np.int32),
        room=np.ones((3, more), np.int32),
        limit=np.zeros(more, np.int32),
        sums=np.zeros(bucket(len(goods.sums), LENGTHS) - len(goods.sums), np.int32),
        first=np.zeros((3, more), np.int32),
        unit=goods.unit,
        less=np.zeros((3, bucket(K, KINDS) * ways, more), np.int32),
        strict=np.ones(more, np.float32),
    )  # fmt: skip
    return stacked([goods, nothing])
