"""What the doors that pack share: their options of how to, and what ends them."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from tyro.conf import FlagCreatePairsOff, UseAppendAction

from jaxpack.model.numbers import as_whole
from jaxpack.model.rules import Rules
from jaxpack.rule_flags import RuleFlags
from jaxpack.search.portfolio import SolveOptions


@dataclass(frozen=True, kw_only=True)
class HowToPack(RuleFlags):
    """Options of commands."""

    time_limit: float | None = None
    """Seconds for the search, of all orders together: 10 unless packings are given, and 0.02 for
    each of more than 500 orders."""
    packings: int | None = None
    """Packings that are tried at most in each order: the plan is the same then with one seed."""
    workers: int | None = None
    """Processes that pack several orders; one for each core if not given."""
    seed: int = SolveOptions.seed
    """Gives the random choices."""
    resolution: float | None = None
    """Corners stand along x and y on a grid of this length; anywhere if not given."""
    skip_unfit: FlagCreatePairsOff[bool] = False
    """Leave out the items that no bin can hold; otherwise they are an error."""
    objective: str = ""
    """What is wanted: bins (few of them), price (theirs, low), value (of what is packed, high:
    column PROFIT) or height (in one bin, low; its own may be open). Not given, price if bins have
    a COST, otherwise bins."""
    rule: str = Rules.rule
    """Which of its allowed positions an item takes: lowest, nearest-corner, far-corner,
    most-contact or least-wasted."""
    ignore: UseAppendAction[tuple[str, ...]] = ()
    """A column of the files that need not be obeyed; may be given several times."""

    @property
    def how(self) -> SolveOptions:
        """What a search is told.

        Raises:
            UserError: of the number of workers; the others are `checked_options`'s.
        """
        if self.workers is not None:
            as_whole(self.workers, "--workers", 1)
        return SolveOptions(
            self.time_limit,
            self.seed,
            replace(self.rules, rule=self.rule),
            self.resolution,
            self.skip_unfit,
            packings=self.packings,
        )


@contextmanager
def interrupts() -> Iterator[list[int]]:
    """The SIGINTs and SIGTERMs that came in: a list that grows. A second one acts as always."""
    received: list[int] = []

    def receive(number: int, _: object) -> None:
        received.append(number)
        signal.signal(number, before[number])

    numbers: tuple[int, ...] = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, receive) for number in numbers}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
