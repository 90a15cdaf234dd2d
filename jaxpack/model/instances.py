"""Random instances: the paper's uniform sizes, reproducible one by one."""

from dataclasses import dataclass
from itertools import permutations
from typing import Any, ClassVar, Protocol

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from jaxpack.errors import MOST, UserError
from jaxpack.model.problem import MOST_CELLS, Instance, Problem, check_bin

MOST_ITEMS = 1 << 20
"""Of an instance that is drawn."""

TURNS: dict[str, tuple[tuple[int, ...], ...]] = {
    "fixed": ((0, 1, 2),),
    "upright": ((0, 1, 2), (1, 0, 2)),
    "all": tuple(permutations(range(3))),
}
"""Name -> the orientations that are allowed: which side lies along x, y and z of the bin."""


class Source(Protocol):
    """What instances are made of: random sizes, or the orders of a file (`model.orders`).

    Hashable, static under ``jit``; arrays that it has are handed on as `numbers`.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]
    surface: ClassVar[str]
    """See `Problem.surface`."""

    @property
    def count(self) -> int:
        """How many different instances there are to evaluate on."""

    @property
    def items(self) -> int:
        """N: the most items of an instance."""

    @property
    def low(self) -> int:
        """The shortest side of an item, in cells or units."""

    @property
    def high(self) -> int:
        """The longest one."""

    @property
    def numbers(self) -> Any:
        """What `make` needs besides, a pytree."""

    def kinds(self, problem: Problem) -> int:
        """K: the most distinct sizes that an instance can have."""

    def check_fits(self, bin: tuple[int, int, int]) -> None:
        """Raises UserError where an item may be larger than the bin."""

    def draw(self, problem: Problem, key: Array) -> Instance:
        """One instance by a typed PRNG key, consumed: to learn from."""

    @staticmethod
    def make(
        problem: Problem, slots: int, key: Array, index: Array, numbers: Any, bin: Any
    ) -> Instance:
        """The instance of that number and key: to evaluate on. The same for all of the type.

        Args:
            problem: the rules; of its bin only which axes are flat.
            slots: the padded length (static), at least `items`.
            key: typed PRNG key [], consumed.
            index: int32[].
            numbers: as the source has them.
            bin: int [3], the instance's bin.
        """


@dataclass(frozen=True)
class Distribution:
    """Items with sides uniform on low..high, both included, in every axis the bin extends in.

    Raises:
        UserError: where a number is out of its range, or `turns` is not known.
    """

    items: int  # N, of every instance
    low: int  # cells, the shortest side
    high: int  # cells, the longest side
    turns: str = "fixed"  # how items may be turned, a name in TURNS
    surface: ClassVar[str] = "cells"  # see `Source`
    count: ClassVar[int] = MOST  # of different instances: any number

    def __post_init__(self) -> None:
        if self.turns not in TURNS:
            raise UserError(f"turns '{self.turns}': choose {' or '.join(TURNS)}")
        if not 1 <= self.items <= MOST_ITEMS:
            raise UserError(
                f"items {self.items}: an instance needs at least 1 item, and at most {MOST_ITEMS}"
            )
        if self.low < 1:
            raise UserError(f"sides {self.low}-{self.high}: a side is at least 1 cell")
        if self.high < self.low:
            raise UserError(f"sides {self.low}-{self.high}: give the smaller side first")
        if self.high > MOST_CELLS:
            raise UserError(f"sides {self.low}-{self.high}: no bin is longer than {MOST_CELLS}")

    @property
    def numbers(self) -> Any:
        """See `Source.numbers`."""
        return self.items, self.low, self.high

    def draw(self, problem: Problem, key: Array) -> Instance:
        """See `Source.draw`."""
        drawn = self.make(problem, self.items, key, jnp.int32(0), self.numbers, problem.bin)
        if self.turns == "fixed":
            return drawn
        # A flat axis stays flat.
        flat = [axis for axis in range(3) if axis not in problem.axes]
        ways = [way for way in TURNS[self.turns] if all(way[axis] == axis for axis in flat)]
        return drawn._replace(turned=drawn.size[:, jnp.asarray(ways)])

    @staticmethod
    def make(
        problem: Problem, slots: int, key: Array, index: Array, numbers: Any, bin: Any
    ) -> Instance:
        """See `Source.make`: by the key alone, not turned."""
        items, low, high = numbers
        return uniform_instance(problem, key, slots, items, low, high, bin)

    def kinds(self, problem: Problem) -> int:
        """K: the most distinct sizes that an instance can have."""
        return int(min(self.items, (self.high - self.low + 1) ** len(problem.axes)))

    def check_fits(self, bin: tuple[int, int, int]) -> None:
        """Raises UserError where an item of this distribution may be larger than the bin."""
        room = min(side for side in bin if side > 1) if max(bin) > 1 else 1
        if self.high > room:
            raise UserError(
                f"sides {self.low}-{self.high}: items of side {self.high} are larger than the bin "
                f"{bin}; lower the sides or enlarge the bin"
            )


@dataclass(frozen=True)
class Cell:
    """One combination of a grid: items of a distribution in a bin.

    Raises:
        UserError: where the bin is not three whole sides, or has too many cells or units.
    """

    bin: tuple[int, int, int]  # (L, W, H) in cells, or units
    distribution: Source  # of the items

    def __post_init__(self) -> None:
        check_bin(self.bin, self.distribution.surface)


def uniform_instance(
    problem: Problem,
    key: Array,
    slots: int,
    items: ArrayLike,
    low: ArrayLike,
    high: ArrayLike,
    bin: ArrayLike | tuple[int, int, int],
) -> Instance:
    """One random instance. An item's size depends on the key and its index, not on `slots`.

    Args:
        problem: the rules; only the axes its bin extends in are drawn, the others are 1.
        key: typed PRNG key, consumed.
        slots: N, the padded length (static).
        items: number of items, at most `slots`.
        low, high: smallest and largest side in cells, both included.
        bin: int [3], the instance's bin.
    """
    drawn = jax.random.randint(key, (slots, 3), low, jnp.asarray(high) + 1)
    flat = jnp.asarray(problem.bin) == 1
    mask = jnp.arange(slots) < items
    size = jnp.where(flat | ~mask[:, None], 1, drawn)
    return Instance(size=size, mask=mask, bin=jnp.asarray(bin, jnp.int32))


def sample(problem: Problem, distribution: Source, key: Array, count: int) -> Instance:
    """The first `count` instances of a distribution: leaves [count, ...].

    Args:
        problem: the rules; its bin is that of all instances.
        distribution: how many items, and of which sizes.
        key: typed PRNG key []. Instance i depends on the key and on i alone.
        count: how many (static).
    """
    return sample_at(problem, distribution, key, jnp.arange(count))


def sample_at(problem: Problem, distribution: Source, key: Array, indices: Array) -> Instance:
    """The instances with these indices (int [B]): leaves [B, ...].

    Instance i depends on (key, i) and on nothing else, so a set of any size needs no storage.
    """

    def one(index: Array) -> Instance:
        return distribution.draw(problem, jax.random.fold_in(key, index))

    return jax.vmap(one)(indices)
