"""Orders of real goods one item at a time, in the order of their file: nothing is put off."""

from collections.abc import Callable
from time import perf_counter

import numpy as np

from jaxpack.errors import UserError
from jaxpack.model.encoding import Loading, load_job, plan_of
from jaxpack.model.job import Job
from jaxpack.model.objectives import bounds
from jaxpack.model.plan_check import check_plan
from jaxpack.packing.rules import rule_named
from jaxpack.packing.top_map import TopMap
from jaxpack.search.portfolio import SolveOptions
from jaxpack.search.record import End, Progress

Told = Callable[[int, str, int, tuple[float, float, float]], object]
"""(item type, orientation, bin, corner) of an item that was placed, bin -1: it was left out."""


def pack_online(
    job: Job,
    options: SolveOptions,
    told: Told = lambda *_: None,
    stop: Callable[[], bool] = lambda: False,
) -> Progress:
    """Packs an order item by item: each goes into the first bin that has a place for it, at
    the position that the rule prefers, turned so that it comes to rest lowest; where none has, into
    a new bin, of the first type in the file that holds it.

    Args:
        job: what is packed; of its items copies come in a row.
        options: `rules`, `resolution` and `skip_unfit` are used.
        told: called with every item as it is placed.
        stop: asked before every item; those after are left out then.

    Returns:
        The plan, which has passed the check.

    Raises:
        UserError: where an item fits no bin, or more is asked of a load than weight, support and
            stability, or another objective than few or cheap bins.
    """
    begun = perf_counter()
    loading = load_job(job, options.rules, options.resolution, options.skip_unfit)
    if loading.ruled or loading.by_load:
        what = "items come one by one: without rules of loads and tariffs"
        raise UserError(f"{what}; leave these out, or --online")
    if loading.objective.open_bin or loading.objective.leaves_out:
        raise UserError("items come one by one: the objective is bins or price")
    top = loading.units.length
    bin, corner = np.full(len(loading.items), -1), np.zeros((len(loading.items), 3), np.int64)
    turn = np.zeros(len(loading.items), np.int64)
    bins = _Bins(loading, stop)
    for row in range(len(loading.items)):
        if not stop() and (found := bins.take(row)) is not None:
            bin[row], turn[row], corner[row] = found
        item = int(loading.items[row])
        x, y, z = (float(side * top) for side in corner[row].tolist())
        number = bins.number(int(bin[row]))
        told(item, loading.ways[item][int(turn[row])], number, (x, y, z))
    types = {slot: int(loading.bins[slot]) for slot in set(bin.tolist()) - {-1}}
    plan = plan_of(loading, np.arange(len(bin)), turn, bin, corner, types)
    check_plan(loading.given, plan, loading.rules)
    end = End.INTERRUPT if stop() else End.ONLINE
    least = bounds(job, 0.0, options.rules)
    return Progress(job, plan, least, perf_counter() - begun, 1, end)


class _Bins:
    """The bins that are open."""

    def __init__(self, loading: Loading, stop: Callable[[], bool]) -> None:
        self.loading, self.stop = loading, stop
        self.rule = rule_named(loading.rules.rule)
        self.slots = list[int]()
        self.tops = list[TopMap]()
        self.left = list[int]()  # weight that each may yet hold

    def number(self, slot: int) -> int:
        """Of a bin among those that are open, in the order in which they were; -1 of none."""
        return self.slots.index(slot) if slot >= 0 else -1

    def take(self, row: int) -> tuple[int, int, tuple[int, int, int]] | None:
        """(slot, turn, corner) of an item, which is placed there; None: no bin is left for it."""
        for number in range(len(self.slots)):
            if found := self._into(number, row):
                return found
        kinds = self.loading.bins
        for kind in dict.fromkeys(kinds.tolist()):
            unused = [slot for slot in np.flatnonzero(kinds == kind) if slot not in self.slots]
            if unused:
                self._open(int(unused[0]))
                if found := self._into(len(self.slots) - 1, row):
                    return found
                for opened in (self.slots, self.tops, self.left):
                    opened.pop()
        return None

    def _open(self, slot: int) -> None:
        stock, loading = self.loading.stock, self.loading
        x, y, z = stock.bins[slot].tolist()
        self.slots.append(slot)
        self.tops.append(TopMap((x, y, z), loading.flat, int(stock.step), loading.rules.firm))
        self.left.append(int(stock.limit[slot]))

    def _into(self, number: int, row: int) -> tuple[int, int, tuple[int, int, int]] | None:
        stock, top = self.loading.stock, self.tops[number]
        if int(stock.weight[row]) > self.left[number]:
            return None
        places = []
        for turn in range(int(stock.ways[row])):
            length, width, height = stock.sizes[row, turn].tolist()
            needed = int(stock.needed[row, turn])
            place = top.first(self.rule, (length, width, height), needed, self.stop)
            if place is not None:
                places.append((place[2], turn, place, (length, width, height)))
        if not places:
            return None
        _, turn, place, size = min(places)
        top.place(size, place)
        self.left[number] -= int(stock.weight[row])
        return self.slots[number], turn, place
