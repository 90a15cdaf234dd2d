"""What the genetic algorithms have in common, whatever an individual is and whose arrays it has.

Source: Goncalves and Resende, "Biased random-key genetic algorithms for combinatorial
optimization" (2011).
"""

from dataclasses import dataclass
from typing import Any

from jaxpack.errors import UserError


@dataclass(frozen=True)
class BrkgaConfig:
    """Budget and shares: population * generations packings, less the elite's."""

    population: int = 100
    generations: int = 60
    elite: float = 0.2  # share of the population that survives unchanged
    mutants: float = 0.14  # share that is drawn afresh
    bias: float = 0.7  # probability of inheriting a key from the elite parent

    def __post_init__(self) -> None:
        for name in ("elite", "mutants", "bias"):
            if not 0 <= getattr(self, name) <= 1:
                raise UserError(f"BRKGA {name} {getattr(self, name)}: give a share from 0 to 1")
        elite, _, children = self.shares
        if elite < 1 or children < 1 or self.generations < 0:
            raise UserError(
                f"BRKGA population {self.population}, elite {self.elite}, mutants {self.mutants}, "
                f"generations {self.generations}: leave at least one elite and one child"
            )

    @property
    def shares(self) -> tuple[int, int, int]:
        """Individuals per generation: (elite, mutants, children)."""
        return self.shares_of(self.population)

    def shares_of(self, population: int) -> tuple[int, int, int]:
        """The same of a population of another size."""
        elite, mutants = round(self.elite * population), round(self.mutants * population)
        return elite, mutants, population - elite - mutants


def crossed(inherits: Any, genes: Any, mother: Any, father: Any) -> Any:
    """Parameterised uniform crossover: from the mother where it says so, else from the father.

    Args:
        inherits: bool [..., N] or [..., 1], of NumPy or of JAX.
        genes: [P, N].
        mother, father: int [...], individuals.
    """
    where = genes.__array_namespace__().where
    return where(inherits, genes[mother], genes[father])
