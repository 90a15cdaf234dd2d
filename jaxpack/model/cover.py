"""The least that bins cost which together come up to several needs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heappop, heappush

from jaxpack.model.martello import MARGIN

WORK = 30_000  # looks at one bin type for one need

Price = tuple[int, ...]
"""Of what is minimised the most important first; prices are added up part by part."""


@dataclass(frozen=True)
class Need:
    """So much of something is needed; every bin of a type has so much of it at most."""

    amount: float
    of_kind: tuple[float, ...]


def least(prices: Sequence[Price], copies: Sequence[float], needs: Sequence[Need]) -> Price:
    """A price below that of every choice of bins that meets all needs, mostly the least itself.

    By search for the best choice first: what is most promising when the work is done is a bound
    all the same. If all bins together do not meet one of the needs, it is what they cost.

    Args:
        prices: of one bin of each type.
        copies: of each type; infinite is any number.
        needs: what the bins are for.
    """
    search = _Search(prices, copies, needs)
    left = tuple(need.amount for need in needs)
    nothing = (0,) * len(prices[0])
    start = search.bound(nothing, 0, 0, left)[0]
    # Bound, bins (more is nearer to the end), what they cost, type, taken of it, still needed.
    queue: list[_Entry] = [(start, 0, nothing, 0, 0, left)]
    for _ in range(WORK // search.looks + 1):
        if not queue:
            return start
        entry = heappop(queue)
        if all(amount <= 0 for amount in entry[-1]):
            return entry[0]
        for following in search.following(entry):
            heappush(queue, following)
    return queue[0][0] if queue else start


_Entry = tuple[Price, int, Price, int, int, tuple[float, ...]]


class _Search:
    """Takes types of bins one after the other, one more of a type each time."""

    def __init__(
        self, prices: Sequence[Price], copies: Sequence[float], needs: Sequence[Need]
    ) -> None:
        def dear(kind: int) -> float:
            met = sum(need.of_kind[kind] / need.amount for need in needs if need.amount > 0)
            return prices[kind][0] / met if met else math.inf

        order = sorted(range(len(prices)), key=dear)
        self.prices, self.copies = [prices[k] for k in order], [copies[k] for k in order]
        self.rows = [[need.of_kind[k] for k in order] for need in needs]
        self.parts = range(len(prices[0]))
        self.cheapest = [[self._cheapest(part, row) for row in self.rows] for part in self.parts]
        self.looks = len(prices) * max(len(needs), 1) * len(self.parts)

    def _cheapest(self, part: int, row: list[float]) -> list[int]:
        some = (kind for kind, each in enumerate(row) if each > 0)
        return sorted(some, key=lambda kind: self.prices[kind][part] / row[kind])

    def following(self, entry: _Entry) -> list[_Entry]:
        """One more of this type, or no more but of the next ones, where all needs can be met."""
        _, bins, spent, kind, taken, left = entry
        steps = [(bins, spent, kind + 1, 0, left)] if kind + 1 < len(self.prices) else []
        useful = any(a > 0 and row[kind] > 0 for a, row in zip(left, self.rows, strict=True))
        if useful and taken < self.copies[kind]:
            less = tuple(a - row[kind] for a, row in zip(left, self.rows, strict=True))
            price = tuple(map(sum, zip(spent, self.prices[kind], strict=True)))
            steps.append((bins - 1, price, kind, taken + 1, less))
        found = []
        for step in steps:
            bound, enough = self.bound(*step[1:])
            if enough:
                found.append((bound, *step))
        return found

    def bound(
        self, spent: Price, kind: int, taken: int, left: tuple[float, ...]
    ) -> tuple[Price, bool]:
        """A price below that of what is spent and what is left, and if there are enough bins."""
        parts, enough = [], True
        for part in self.parts:
            most = 0.0
            for row, order, amount in zip(self.rows, self.cheapest[part], left, strict=True):
                if amount > 0:
                    cost, met = self._alone(part, row, order, kind, taken, amount)
                    most, enough = max(most, cost), enough and met
            parts.append(spent[part] + math.ceil(most * (1 - MARGIN)))
        return tuple(parts), enough

    def _alone(
        self, part: int, row: list[float], order: list[int], kind: int, taken: int, amount: float
    ) -> tuple[float, bool]:
        """What one need costs, bins in parts, from this type on; and if it is met."""
        cost = 0.0
        for k in order:
            if k < kind:
                continue
            there = self.copies[k] - (taken if k == kind else 0)
            bins = amount / row[k]
            if bins <= there:
                return cost + bins * self.prices[k][part], True
            cost, amount = cost + there * self.prices[k][part], amount - there * row[k]
        return cost, False
