"""Conservative scales: along each axis other lengths, with which what fits a bin still does.

A scale is a function that grows and for which f(a) + f(b) <= f(a + b): items side by side in a
bin are then side by side in it scaled too, and a packing stays one (Fekete and Schepers, A general
framework for bounds for higher-dimensional orthogonal packing problems, Mathematical Methods of
Operations Research 60 (2004)). So the scaled volume of all items, each turned as it counts least,
is no more than that of the bins. The families are those of the survey of Clautiaux, Alves and
Valério de Carvalho, A survey of dual-feasible and superadditive functions, Annals of Operations
Research 179 (2010).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from jaxpack.model.cover import Need
from jaxpack.model.martello import EXACT, MARGIN, sampled

Scale = Callable[[np.ndarray], np.ndarray]

MOST_SCALES = 64  # of an axis
TABLES = 2**20  # numbers in the tables of one axis
MOST_VALUES = 256  # lengths from which limits and pieces are taken
MOST_SORTED = 2**16  # lengths that are looked up rather than scaled once each
STARTS = 3  # combinations from which the search goes on, for every price
ROUNDS = 4  # over the axes


def _as_it_is(lengths: np.ndarray) -> np.ndarray:
    return lengths


def _limit(room: int, limit: int, lengths: np.ndarray) -> np.ndarray:
    """Less than the limit, at most half the room, is nothing, and what leaves less is all."""
    scaled = np.where(lengths < limit, 0, lengths)
    return np.where(lengths > room - limit, room, scaled)


def _pieces(room: int, piece: int, lengths: np.ndarray) -> np.ndarray:
    """Twice the whole pieces of it; above half the room all but the pieces that it leaves."""
    half = 2 * lengths == room
    large = np.where(half, room // piece, 2 * (room // piece - (room - lengths) // piece))
    return np.where(2 * lengths < room, 2 * (lengths // piece), large)


def _rounded(room: int, piece: int, lengths: np.ndarray) -> np.ndarray:
    """Whole pieces, and of the rest what is more than that of the room."""
    rest = room % piece
    return lengths // piece * (piece - rest) + np.maximum(lengths % piece - rest, 0)


def _scales(lengths: np.ndarray, rooms: np.ndarray) -> Iterator[Scale]:
    """Scales for lengths in rooms of these sides: the most promising first."""
    room = int(rooms.max())
    lengths = sampled(lengths, MOST_VALUES)
    small = lengths[2 * lengths <= room]
    yield _as_it_is
    yield partial(_limit, room, (room + 1) // 2)
    pieces = [room // (many + 1) + 1 for many in (2, 3, 4)]
    for piece in pieces:
        yield partial(_pieces, room, piece)
    limits = sampled(small, 16).tolist()
    pieces += [room // (many + 1) + 1 for many in range(5, 17)]
    pieces += sampled(lengths, 12).tolist()
    pieces += sampled(lengths // 2, 8).tolist() + sampled(lengths // 3, 4).tolist()
    for limit in limits:
        yield partial(_limit, room, limit)
    for piece in pieces:
        if not 1 < piece <= room:
            continue
        yield partial(_pieces, room, piece)
        for side in sampled(rooms, 3).tolist():
            if side:
                yield partial(_rounded, side, piece)


@dataclass(frozen=True)
class _Axis:
    """The lengths along an axis in every scale."""

    items: np.ndarray  # [scales, ways, n]
    bins: np.ndarray  # [scales, kinds]


def _scaled(lengths: np.ndarray, rooms: np.ndarray, most: int) -> _Axis:
    """Tables of different scales.

    Args:
        lengths: int64 [ways, n].
        rooms: int64 [kinds]; none where the bin does not count.
        most: scales.
    """
    values, where = lengths.ravel(), np.arange(lengths.size)
    if lengths.size <= MOST_SORTED:
        values, where = np.unique(lengths, return_inverse=True)
    largest, known = int(rooms.argmax()), set()
    items, bins = [], []
    for scale in _scales(values, rooms):
        of_values, of_rooms = scale(values), scale(rooms)
        full = of_rooms[largest]
        if full <= 0:
            continue
        shape = (of_values / full).tobytes() + (of_rooms / full).tobytes()
        if shape in known:
            continue
        known.add(shape)
        items.append(of_values.astype(float)[where.reshape(lengths.shape)])
        bins.append(of_rooms.astype(float))
        if len(items) == most:
            break
    return _Axis(np.stack(items), np.stack(bins))


def scaled_needs(
    lengths: np.ndarray,
    copies: np.ndarray,
    rooms: np.ndarray,
    prices: list[np.ndarray],
    work: int,
) -> list[Need]:
    """What the items come to in the scales that say most of the bins, for each of the prices.

    Args:
        lengths: int64 [ways, n, axes], one to three axes.
        copies: int64 [n].
        rooms: int64 [kinds, axes]; no item fits a kind of 0.
        prices: float [kinds] each.
        work: products of lengths that are computed, about.
    """
    ways, n, axes = lengths.shape
    most = int(np.clip(TABLES // (ways * n), 4, MOST_SCALES))
    tables = [_scaled(lengths[..., axis], rooms[:, axis], most) for axis in range(axes)]
    tables += [_Axis(np.ones((1, ways, n)), np.ones((1, len(rooms))))] * (3 - axes)
    per_combination = max(ways * n, 4 * len(rooms))
    few = max(2, int((work / per_combination) ** (1 / axes)))
    amounts, each = _products([_Axis(t.items[:few], t.bins[:few]) for t in tables], copies)
    found = {}
    for price in prices:
        score = _score(amounts, each, price)
        for best in np.argsort(-score, axis=None)[:STARTS]:
            chosen = _climbed(tables, copies, price, np.unravel_index(best, score.shape))
            found[chosen] = _need(tables, copies, chosen)
    return list(found.values())


def _products(tables: list[_Axis], copies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Amounts [a, b, c] and what the bins hold of them [a, b, c, kinds] in all combinations."""
    first, second, third = tables
    amounts = np.array(
        [
            [(third.items * (one * two)).min(1) @ copies for two in second.items]
            for one in first.items
        ]
    )
    return amounts, np.einsum("ak,bk,ck->abck", first.bins, second.bins, third.bins)


def _score(amounts: np.ndarray, each: np.ndarray, price: np.ndarray) -> np.ndarray:
    """What the amounts [...] cost in the bins [..., kinds] that have most of it for their price."""
    worth = np.divide(each, price, out=np.full(each.shape, np.inf), where=price > 0)
    most = np.where(each > 0, worth, 0).max(-1)
    return np.divide(amounts, most, out=np.zeros_like(amounts), where=most > 0)


def _climbed(
    tables: list[_Axis], copies: np.ndarray, price: np.ndarray, start: tuple
) -> tuple[int, ...]:
    """The combination that is best along every axis, the others being as they are."""
    chosen, best = [int(scale) for scale in start], -1.0
    for _ in range(ROUNDS):
        before = best
        for axis in range(3):
            items, bins = _others(tables, chosen, axis)
            amounts = (tables[axis].items * items).min(1) @ copies
            score = _score(amounts, tables[axis].bins * bins, price)
            chosen[axis], best = int(score.argmax()), float(score.max())
        if best <= before * (1 + MARGIN):
            break
    return tuple(chosen)


def _others(tables: list[_Axis], chosen: list[int], axis: int) -> tuple[np.ndarray, np.ndarray]:
    one, two = (tables[other] for other in range(3) if other != axis)
    first, second = (chosen[other] for other in range(3) if other != axis)
    return one.items[first] * two.items[second], one.bins[first] * two.bins[second]


def _need(tables: list[_Axis], copies: np.ndarray, chosen: tuple[int, ...]) -> Need:
    items, bins = _others(tables, list(chosen), 2)
    amount = float((tables[2].items[chosen[2]] * items).min(0) @ copies)
    each = tables[2].bins[chosen[2]] * bins
    return Need(amount if amount < EXACT / 2 else amount * (1 - MARGIN), tuple(each.tolist()))
