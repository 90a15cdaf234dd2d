"""What nobody has to compile: bins filled by value, and orders of items, in turns."""

import math
from collections.abc import Callable, Sequence
from itertools import islice

import numpy as np

from jaxpack.model.encoding import Loading, lane_genes
from jaxpack.search.beam import Asking
from jaxpack.search.bin_values import ALL, has_values, values_asked
from jaxpack.search.block_policy import Judge
from jaxpack.search.local_search import Best
from jaxpack.search.quick import SORTS, Stop, quick_plan, search_quickly

TURN = 8  # packings of the annealing after each pass of bins by value


def all_differ(loading: Loading) -> bool:
    """Whether most items have not their like: their orders are worth searching from the start."""
    kinds = len(np.unique(loading.stock.sizes[:, 0], axis=0))
    return 2 * kinds > len(loading.items)


def search_uncompiled(
    loading: Loading,
    seed: int,
    stop: Stop,
    first: Best | None = None,
    end: float = math.inf,
    known: Callable[[], Best | None] = lambda: None,
    judge: Judge | None = None,
    draws: Sequence[int | None] = ALL,
    sorts: int = SORTS - 1,
    others: Callable[[], bool] = lambda: False,
) -> Asking:
    """(a packing or None, packings tried) again and again, until `stop` says so.

    Args:
        loading, seed, stop, end, known, judge, draws: see `values_asked`.
        first: the packing that orders are searched from; the first sort's if not given.
        sorts: how many of them there are, where items differ.
        others: whether somebody else anneals.
    """
    fills = has_values(loading)
    by_value = values_asked(loading, seed, stop, end, known, judge, draws)
    orders_first = not fills or all_differ(loading)

    def orders() -> Asking:
        begin = first or quick_plan(loading, lane_genes(loading, seed, 0), stop)
        for found in search_quickly(loading, seed, begin, stop, sorts):
            yield found, int(found is not None)

    annealing = orders()
    for _ in draws if fills else ():
        yield from _next(by_value)
    if orders_first:
        yield from islice(annealing, sorts)
    while not stop():
        if fills:
            yield from _next(by_value)
        if orders_first and not others():
            yield from islice(annealing, TURN)
        elif not fills:
            yield None, 0


def _next(search: Asking) -> Asking:
    """The next that a search finds, and what it asks for until then."""
    filled = None
    while True:
        try:
            event = search.send(filled)
        except StopIteration:
            return
        filled = yield event
        if filled is None:
            return
