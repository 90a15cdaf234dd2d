"""What holds for every item of a job: how it is carried, and where it may stand."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np

from jaxpack.errors import UserError
from jaxpack.model.exact import clean, exact
from jaxpack.model.numbers import LONGEST, as_number

STABILITIES = ("share", "centre", "static")
DOORS = ("", "x")
MARGIN = 64
"""An item is carried beyond its centre, on all sides, by 1/64 of its length and of its width."""


def before_centre(side: Any) -> Any:
    """How far from its near edge what carries an item beyond its centre has to begin, and from the
    far edge to end, at most: whole numbers of any kind, as the side is.
    """
    half = MARGIN // 2 - 1
    return side // MARGIN * half + side % MARGIN * half // MARGIN


@dataclass(frozen=True)
class Rules:
    """What holds for every item of a job."""

    support: float = 0.5
    """Least share of a base that must be carried, 0 to 1."""
    inclusive: bool = False
    """Whether exactly that share is enough; the whole base always is."""
    rule: str = "lowest"
    """Which of its allowed positions an item takes, a key of `jaxpack.packing.rules.RULES`."""
    stability: str = "centre"
    """What else carries it: ``share``, nothing; ``centre``, its centre lies over what stands firm;
    ``static``, its stack is in equilibrium, for which packers ask that it is ``centre``.
    """
    gap: float = 0.0
    """Between two items beside each other, in the job's unit; in 2D above each other too."""
    overhang: float = 0.0
    """How far items may reach over the edges of the floor, in the job's unit."""
    door: str = ""
    """Items come in from above, or along x through a door at its far end: ``x``."""
    balance: float | None = None
    """Middle share of the floor, along x and along y, that the load's centre of mass lies in."""
    heavy_below: bool = False
    """Whether no item may lie on a lighter one."""

    @property
    def plain(self) -> bool:
        """Whether nothing but support and stability is asked."""
        return self == Rules(self.support, self.inclusive, self.rule, self.stability)

    @property
    def firm(self) -> bool:
        """Whether an item rests only on what stands firm, see `STABILITIES`."""
        return self.stability != "share"

    @cached_property
    def _share(self) -> tuple[int, int]:
        return exact(self.support).as_integer_ratio()

    def area_needed(self, area: int) -> int:
        """The least whole number that is enough of an area."""
        part, whole = self._share
        return -(-area * part // whole) if self.inclusive else min(area * part // whole + 1, area)

    def checked(
        self, called: Callable[[str], str] = lambda name: name, dimension: int = 3
    ) -> "Rules":
        """The same, if every one is of its type and in its range; `rule` is not looked at.

        Args:
            called: what messages call a rule of that name.
            dimension: of the job.

        Raises:
            UserError: naming the rule.
        """
        for name in ("inclusive", "heavy_below"):
            if not isinstance(given := getattr(self, name), bool | np.bool_):
                raise UserError(f"{called(name)} {given!r}: give True or False")
        support = as_number(self.support, called("support"))
        if not 0 <= support <= 1:
            raise UserError(f"{called('support')} {support:g}: give a share of the base, 0 to 1")
        if self.stability not in STABILITIES:
            known = ", ".join(STABILITIES)
            raise UserError(f"{called('stability')} {self.stability!r} is not known: use {known}")
        if self.door not in DOORS:
            what = "is not known: use x, or none for items that come from above"
            raise UserError(f"{called('door')} {self.door!r} {what}")
        if self.door and dimension == 2:
            raise UserError(
                f"{called('door')} {self.door}: in 2D items come from above: leave it out"
            )
        gap, overhang = (self._length(name, called(name)) for name in ("gap", "overhang"))
        balance = self.balance
        if balance is not None:
            balance = as_number(balance, called("balance"))
            if not 0 < balance <= 1:
                what = "give a share of the floor, more than 0, up to 1"
                raise UserError(f"{called('balance')} {balance:g}: {what}")
        return replace(self, support=support, balance=balance, gap=gap, overhang=overhang)

    def _length(self, name: str, called: str) -> float:
        length = clean(as_number(getattr(self, name), called))
        if not 0 <= length <= LONGEST:
            raise UserError(f"{called} {length:g}: give a length, 0 or more")
        return length

    @property
    def lengths(self) -> tuple[Fraction, ...]:
        """Those that are not 0, of which positions have to be multiples too."""
        return tuple(exact(length) for length in (self.gap, self.overhang) if length)

    def spacing(self, dimension: int) -> tuple[float, float, float]:
        """The gap along x, y and z."""
        return (self.gap, 0, self.gap) if dimension == 2 else (self.gap, self.gap, 0)

    def reach(self, dimension: int) -> tuple[float, float, float]:
        """How far items may be outside of a bin along x, y and z, at either end."""
        return (self.overhang, 0 if dimension == 2 else self.overhang, 0)
