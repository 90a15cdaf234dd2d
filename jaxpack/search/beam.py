"""Fills bins from start to end: greedily, or by a beam whose children are worth their completion.

A beam holds some bins that are partly filled. Each of them is continued by several blocks in turn,
the best ones of different kinds or orientations, and every child is filled up greedily: it is worth
what it then holds. The best children are the next beam; of those that hold the same blocks in the
same places, in whatever order they came, there is one. Beams and children are lanes.
"""

from collections.abc import Generator
from typing import Any, NamedTuple

import numpy as np

from jaxpack.search import filling
from jaxpack.search.blocks import step
from jaxpack.search.filling import Filling, Goods, some_lanes
from jaxpack.search.fillings import Kinds
from jaxpack.search.quick import Stop


class Asked(NamedTuple):
    """Bins that a search waits for: whoever drives it sends them back filled, see `fill`."""

    kinds: Kinds
    goods: Goods


Asking = Generator[Any, Any, Any]
"""A search that yields what it finds, and `Asked` between."""


def alone(search: Asking, stop: Stop) -> Asking:
    """The same search, its bins filled for it alone.

    Args:
        search: of one job.
        stop: as of `fill`.
    """
    filled = None
    while True:
        try:
            event = search.send(filled)
        except StopIteration as end:
            return end.value
        filled = fill(*event, stop) if isinstance(event, Asked) else None
        if filled is None:
            yield event


def fill(kinds: Kinds, goods: Goods, stop: Stop, now: Filling | None = None) -> Filling:
    """Bins that are filled greedily, or as far as `stop` lets them.

    Args:
        kinds: what is packed.
        goods: of it, for every lane.
        stop: asked all the time.
        now: bins to go on with; empty ones if not given.
    """
    now = now or filling.empty(np, goods, kinds.blocks, kinds.firm)
    done, lanes = Filling(*map(np.array, now)), np.arange(len(now.used))
    while (going := filling.goes_on(now)).any() and not stop():
        if 2 * going.sum() <= len(going):  # the others are done
            _put(done, lanes[~going], some_lanes(now, ~going))
            lanes, now, goods = lanes[going], some_lanes(now, going), some_lanes(goods, going)
        now = step(np, kinds.axes, goods, now, judge=kinds.judge)
    _put(done, lanes, now)
    return done


def fill_by_beam(
    kinds: Kinds, goods: Goods, value: np.ndarray, width: int, children: int, stop: Stop
) -> Filling:
    """The best filling that a beam meets, one beam in every lane.

    Args:
        kinds, goods, stop: as of `fill`.
        value: float64 [K], of an item: what is to be large in the end.
        width: bins that are continued side by side; with one and one child it is `fill`.
        children: blocks that each of them is continued by.
    """
    G, n = len(goods.limit), width * children
    first = filling.empty(np, goods, kinds.blocks, kinds.firm)
    best, most = first, np.full(G, -np.inf)
    nodes = some_lanes(first, np.repeat(np.arange(G), width))
    # The beam begins with one bin; the other lanes have no space.
    nodes = nodes._replace(awake=nodes.awake & (np.arange(G * width) % width == 0))
    known = np.full(G * width, -np.inf)
    goods = some_lanes(goods, np.repeat(np.arange(G), n))
    nth = np.tile(np.arange(children), G * width)
    while (there := filling.goes_on(nodes)).any() and not stop():
        mother = np.repeat(np.arange(G * width), children)
        bins = some_lanes(nodes, mother)
        kids = step(np, kinds.axes, goods, bins, nth, kinds.judge)
        # A first child is filled up as its mother was.
        new = (nth > 0) | np.isneginf(known[mother])
        full = fill(kinds, goods, stop, kids._replace(awake=kids.awake & new))
        worth = np.where(new, value @ (goods.count - full.left), known[mother])
        worth = np.where(there[mother], worth, -np.inf).reshape(G, n)
        lane = np.where(new.reshape(G, n), worth, -np.inf).argmax(1) + np.arange(G) * n
        better = worth.reshape(-1)[lane] > most
        better &= new[lane]
        most = np.where(better, worth.reshape(-1)[lane], most)
        best = _chosen(better, some_lanes(full, lane), best)
        chosen, known = _fittest(worth, _twins(kids).reshape(G, n), width)
        nodes = some_lanes(kids, chosen)
        nodes = nodes._replace(awake=nodes.awake & ~np.isneginf(known))
    return best


def _put(all_lanes: Filling, lanes: np.ndarray, now: Filling) -> None:
    for leaf, some in zip(all_lanes, now, strict=True):
        leaf[..., lanes] = some


def _chosen(which: np.ndarray, one: Filling, other: Filling) -> Filling:
    return Filling(*(np.where(which, a, b) for a, b in zip(one, other, strict=True)))


def _fittest(worth: np.ndarray, twins: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """(lanes [G width], their worth, minus infinity where there is none) of [G, n]."""
    order = np.argsort(-worth, 1, kind="stable")
    worth, twins = (np.take_along_axis(table, order, 1) for table in (worth, twins))
    again = np.tril(twins[:, :, None] == twins[:, None], -1).any(2)
    worth = np.where(again, -np.inf, worth)
    some = np.argsort(-worth, 1, kind="stable")[:, :width]
    order, worth = (np.take_along_axis(table, some, 1) for table in (order, worth))
    return (order + np.arange(len(order))[:, None] * twins.shape[1]).ravel(), worth.ravel()


def _twins(now: Filling) -> np.ndarray:
    """A number for each lane that is the same where the same blocks are: uint64 [P]."""
    with np.errstate(over="ignore"):
        mixed = now.row.astype(np.uint64)
        for column in (*now.near, *now.grid):
            mixed = (mixed + column.astype(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
            mixed ^= mixed >> np.uint64(29)
        there = np.arange(len(now.row))[:, None] < now.used
        return np.where(there, mixed, 0).sum(0, np.uint64)
