"""What a carrier asks for a bin: by the weight of what is in it, and by its volume."""

from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise

from jaxpack.model.exact import clean, exact, volume
from jaxpack.model.limits import Sides, checked_weight
from jaxpack.model.numbers import as_cost, as_number, fault, plain, show

MOST_BANDS = 200


@dataclass(frozen=True)
class Tariff:
    """What is paid for a bin beside its fixed cost. `Job` checks it.

    The weight that is billed is that of the bin and of all that is in it, or the dimensional weight
    if that is more.
    """

    bands: tuple[tuple[float, float], ...] = ()
    """(the most weight that is billed by it, its price), the lightest first; the last is a limit"""
    per_weight: float = 0.0  # for one unit of the weight that is billed
    divisor: float | None = None  # the volume (2D: area) over it is the dimensional weight
    own_weight: float = 0.0  # of the bin, empty

    def billed(self, load: Fraction, size: Sides) -> Fraction:
        """The weight that is billed for a bin of those sides with so much weight in it."""
        weight = load + exact(self.own_weight)
        return weight if self.divisor is None else max(weight, volume(size) / exact(self.divisor))

    def price(self, load: Fraction, size: Sides) -> Fraction:
        """What is paid for it; above the last band as much as in it."""
        billed = self.billed(load, size)
        bands = (price for limit, price in self.bands if billed <= exact(limit))
        band = next(bands, self.bands[-1][1] if self.bands else 0.0)
        return exact(band) + exact(self.per_weight) * billed

    def limit(self, most: float) -> float:
        """The weight that may be in a bin which holds that much: what the last band leaves."""
        if not self.bands:
            return most
        return min(most, float(exact(self.bands[-1][0]) - exact(self.own_weight)))

    def checked(self, where: str, size: Sides) -> "Tariff":
        """The same, if all numbers are of their type and in their range; otherwise a UserError.

        Args:
            where: what messages call it.
            size: of the bin.
        """
        given = self.bands
        if not isinstance(given, tuple | list) or len(given) > MOST_BANDS:
            what = show(given) if isinstance(given, str) or not given else f"{len(given)} of them"
            raise fault(f"{where}, bands", what, f"give a tuple of at most {MOST_BANDS}")
        bands = tuple(_checked_band(f"{where}, band {n}", band) for n, band in enumerate(given))
        for number, (before, after) in enumerate(pairwise(bands), 1):
            if after[0] <= before[0] or after[1] < before[1]:
                shown = " ".join(f"{plain(weight)}:{plain(price)}" for weight, price in bands[:9])
                what = f"band {number} is not above the one before it ({shown})"
                raise fault(f"{where}, bands", what, "let weights rise, and no price fall")
        checked = replace(
            self,
            bands=bands,
            per_weight=clean(as_cost(self.per_weight, f"{where}, per_weight")),
            divisor=None if self.divisor is None else _checked_divisor(where, self.divisor, size),
            own_weight=checked_weight(f"{where}, own_weight", self.own_weight),
        )
        least = checked.billed(Fraction(0), size)
        if bands and least > exact(bands[-1][0]):
            what = f"{float(least):g} is billed for an empty bin, above its last band"
            raise fault(where, f"{what}, {plain(bands[-1][0])}", "add a band or leave the bin out")
        return checked


def _checked_band(where: str, band: object) -> tuple[float, float]:
    if not isinstance(band, tuple | list) or len(band) != 2:
        raise fault(where, show(band), "give a weight and a price")
    return checked_weight(f"{where}, weight", band[0]), clean(as_cost(band[1], f"{where}, price"))


def _checked_divisor(where: str, divisor: object, size: Sides) -> float:
    number = clean(as_number(divisor, f"{where}, divisor"))
    if not 1e-9 <= number <= 1e18:
        raise fault(f"{where}, divisor", f"{plain(number)}: give 1e-9 to 1e18")
    if size[2] == float("inf"):
        raise fault(f"{where}, divisor", "the height is open: give one, or no divisor")
    return number
