"""The rules as options of the commands that pack and of the one that checks."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import FlagCreatePairsOff

from jaxpack.model.rules import Rules


@dataclass(frozen=True, kw_only=True)
class ObstaclesFile:
    """An option of commands."""

    obstacles: Path | None = None
    """What is taken in the bins, a row for each part: a table with BIN (name or number; all if
    empty), X, Y, Z, LX, LY, LZ, in 2D without the Y."""


@dataclass(frozen=True, kw_only=True)
class RuleFlags(ObstaclesFile):
    """Options of commands."""

    support: float = Rules.support
    """Share of an item's base, 0 to 1, of which MORE has to lie on what is under it; of 1 all."""
    support_inclusive: FlagCreatePairsOff[bool] = Rules.inclusive
    """Exactly that share of the base is enough too: such an item may tip over."""
    stability: str = Rules.stability
    """What else carries an item: share (nothing), centre (its centre lies over what stands firm) or
    static (its stack is in equilibrium)."""
    gap: float = Rules.gap
    """Between two items beside each other, in the files' unit; in 2D above each other too."""
    overhang: float = Rules.overhang
    """How far items may reach out over the edges of the floor, in the files' unit."""
    door: str = Rules.door
    """x: items come in through a door, the whole face of the bin at the far end of x. Not given,
    they come from above."""
    balance: float | None = Rules.balance
    """The middle share of the floor, such as 0.333, along x and along y, over which the centre of
    mass of all that is in a bin has to be."""
    heavy_below: FlagCreatePairsOff[bool] = Rules.heavy_below
    """No item may lie on a lighter one."""

    @property
    def rules(self) -> Rules:
        """The rules. What is wrong in them is said by `Rules.checked`."""
        return Rules(
            self.support,
            self.support_inclusive,
            stability=self.stability,
            gap=self.gap,
            overhang=self.overhang,
            door=self.door,
            balance=self.balance,
            heavy_below=self.heavy_below,
        )


def flag(option: str) -> str:
    """What an option is called on the command line."""
    known = {"inclusive": "support-inclusive"}
    return f"--{known.get(option, option).replace('_', '-')}"
