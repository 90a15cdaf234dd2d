"""The rules as options of the commands that pack and of the one that checks."""

from dataclasses import dataclass

from tyro.conf import FlagCreatePairsOff

from jaxpack.model.rules import Rules


@dataclass(frozen=True, kw_only=True)
class RuleFlags:
    """Options of commands."""

    support: float = Rules.support
    """Share of an item's base, 0 to 1, of which MORE has to lie on what is under it; of 1 all."""
    support_inclusive: FlagCreatePairsOff[bool] = Rules.inclusive
    """Exactly that share of the base is enough too: such an item may tip over."""
    stability: str = Rules.stability
    """What else carries an item: share (nothing), centre (its centre lies over what stands firm) or
    static (its stack is in equilibrium)."""

    @property
    def rules(self) -> Rules:
        """The rules. What is wrong in them is said by `Rules.checked`."""
        return Rules(self.support, self.support_inclusive, stability=self.stability)


def flag(option: str) -> str:
    """What an option is called on the command line."""
    known = {"inclusive": "support-inclusive"}
    return f"--{known.get(option, option).replace('_', '-')}"
