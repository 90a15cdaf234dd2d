"""Local search over orders, orientations and the sequence of bins: many lanes side by side.

Every lane holds one order of the items, how each is turned, and in which sequence bins are
opened; a round proposes one change per lane, packs it and keeps it if it is not worse by more
than the temperature allows. Or the lanes are a population, and a round is a generation of the
genetic algorithm (Goncalves and Resende, 2011). Lanes hold decisions, the decoder judges them.

All of this is NumPy: a round takes the packer far longer, and nothing here has to be compiled.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from jaxpack.model.encoding import Genes, Stock
from jaxpack.search.breeding import BrkgaConfig, crossed

BREEDING = BrkgaConfig()
"""Of it the shares."""

Packer = Callable[[Genes], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Genes of P lanes -> (bin int32 [P, N], corner int32 [P, N, 3], cost float64 [P])."""


class Best(NamedTuple):
    """A packing, and genes that make it or one near it."""

    genes: Genes  # of one lane
    bin: np.ndarray  # int32 [N], index of `Stock.bins` by item, -1 for what is left out
    corner: np.ndarray  # int32 [N, 3], units
    cost: float


class Lanes(NamedTuple):
    """The lanes, and the best that any of them has met."""

    random: np.random.Generator
    genes: Genes
    bin: np.ndarray  # int32 [P, N], bin of every item
    cost: np.ndarray  # float64 [P]
    best: Best


class Proposals(NamedTuple):
    """What is to be packed next in every lane."""

    genes: Genes
    rise: np.ndarray  # float64 [P], in cost, the largest that is accepted


Step = Callable[[Stock, Lanes, float], Proposals]
"""(job, lanes, heat) -> what to try."""


def packed(packer: Packer, random: np.random.Generator, genes: Genes) -> Lanes:
    """The lanes with these genes."""
    bin, corner, cost = packer(genes)
    least = int(np.argmin(cost))
    own = Genes(*(leaf[least] for leaf in genes))
    best = Best(own, bin[least], corner[least], float(cost[least]))
    return Lanes(random, genes, bin, cost, best)


def advance(
    packer: Packer, stock: Stock, lanes: Lanes, step: Step, rounds: int, heat: float
) -> Lanes:
    """So many rounds.

    Args:
        step: `annealed`, after which the worst quarter of the lanes go on from better ones, or
            `bred`.
        heat: rises in cost of this size are accepted one time in three.
    """
    for _ in range(rounds):
        genes, rise = step(stock, lanes, heat)
        new = packed(packer, lanes.random, genes)
        kept = new.cost <= lanes.cost + rise
        best = better(lanes.best, new.best)
        lanes = _by_lane(partial(_where, kept), new, lanes)._replace(best=best)
    if step is annealed:
        rank, few = np.argsort(lanes.cost, kind="stable"), len(lanes.cost) // 4
        rank[len(rank) - few :] = rank[:few]
        lanes = _by_lane(lambda leaf: leaf[rank], lanes)
    return lanes


def join(lanes: Lanes, others: Lanes) -> Lanes:
    """The best of the lanes and of others, as many as there are lanes."""
    return _cheapest(_side_by_side(lanes, others), len(lanes.cost))


def exchange(one: Lanes, other: Lanes) -> tuple[Lanes, Lanes]:
    """Either with the best quarter of the other in the place of its worst."""
    few = len(one.cost) // 4

    def visited(lanes: Lanes, guests: Lanes) -> Lanes:
        stay = _cheapest(lanes, len(lanes.cost) - few)
        return _side_by_side(stay, _cheapest(guests, few))

    return visited(one, other), visited(other, one)


def better(one: Best, other: Best) -> Best:
    """The cheaper of two; of equally good ones the first."""
    return other if other.cost < one.cost else one


def annealed(stock: Stock, lanes: Lanes, heat: float) -> Proposals:
    """One random change of every lane: items change places or bins, one is turned, or bins swap."""
    (P, N), S = lanes.genes.order.shape, lanes.genes.pool.shape[1]
    genes, lane, place = lanes.genes, np.arange(P)[:, None], np.arange(N)
    drawn = lanes.random.random((9, P, 1))
    choice, turns, swaps, way, *rest = drawn
    count = int(stock.mask.sum())
    one, two = ((number * count).astype(np.int32) for number in rest[:2])
    swapped = np.where(place == one, two, np.where(place == two, one, place))
    moved = np.where(place == one, two + np.where(two > one, 0.5, -0.5), place)
    # The items of one bin before all others.
    in_order = lanes.bin[lane, genes.order]
    dissolved = np.where(in_order == in_order[lane, one], place - N, place)
    rank = np.where(choice < 0.35, swapped, np.where(choice < 0.7, moved, place))
    rank = np.where((choice >= 0.7) & (choice < 0.8), dissolved, rank)
    rank = np.where(place < count, rank, place)
    item = genes.order[lane, one]
    other = (way * stock.ways[item]).astype(np.int32)
    turning = (np.arange(N) == item) & ((choice >= 0.8) | (turns < 0.1))
    used = np.zeros((P, S), bool)
    packed, _ = np.nonzero(lanes.bin >= 0)
    used[packed, lanes.bin[lanes.bin >= 0]] = True
    there = stock.bins[:, 0] > 0  # or else padding
    several = len(np.unique(np.column_stack([stock.price, stock.bins])[there], axis=0)) > 1
    first = (rest[2] * np.minimum(used.sum(1, keepdims=True) + 1, S)).astype(np.int32)
    second = (rest[3] * S).astype(np.int32)
    slot = np.arange(S)
    pool = np.where(slot == first, genes.pool[lane, second], genes.pool)
    pool = np.where(slot == second, genes.pool[lane, first], pool)
    new = Genes(
        genes.order[lane, np.argsort(rank, 1, kind="stable")],
        np.where(turning, other, genes.turn),
        np.where(several & (swaps < 0.2), pool, genes.pool),
    )
    return Proposals(new, heat * -np.log1p(-rest[4][:, 0]))


def bred(stock: Stock, lanes: Lanes, heat: float) -> Proposals:
    """The next generation: mutants, children, and the elite where no child of theirs is better.

    A child inherits every item's place and orientation from one of the elite or one other.
    """
    (P, N), random = lanes.genes.order.shape, lanes.random
    elite, mutants, _ = BREEDING.shares_of(P)
    best_first = np.argsort(lanes.cost, kind="stable")
    mother = best_first[random.integers(elite, size=P)]
    father = best_first[elite + random.integers(P - elite, size=P)]
    place = np.empty((P, N))
    place[np.arange(P)[:, None], lanes.genes.order] = np.arange(N)
    coins = random.random((P, N + 1)) < BREEDING.bias
    place, turn, pool = (
        crossed(inherits, leaf, mother, father)
        for inherits, leaf in (
            (coins[:, :N], place),
            (coins[:, :N], lanes.genes.turn),
            (coins[:, N:], lanes.genes.pool),
        )
    )
    mutant = best_first[P - mutants :]
    place[mutant] = random.random((mutants, N))
    turn[mutant] = random.integers(stock.ways, size=(mutants, N))
    place[:, ~stock.mask] = N
    rise = np.full(P, np.inf)
    rise[best_first[:elite]] = 0
    order = np.argsort(place, 1, kind="stable").astype(np.int32)
    return Proposals(Genes(order, turn, pool), rise)


def _by_lane(change: Callable[..., np.ndarray], *lanes: Lanes) -> Lanes:
    """The first of these with all that its lanes hold changed, together with the others'."""
    held = ((*some.genes, some.bin, some.cost) for some in lanes)
    order, turn, pool, bin, cost = map(change, *held)
    return lanes[0]._replace(genes=Genes(order, turn, pool), bin=bin, cost=cost)


def _where(lanes: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.where(lanes.reshape(-1, *(1,) * (one.ndim - 1)), one, other)


def _side_by_side(one: Lanes, other: Lanes) -> Lanes:
    both = _by_lane(lambda *leaves: np.concatenate(leaves), one, other)
    return both._replace(best=better(one.best, other.best))


def _cheapest(lanes: Lanes, count: int) -> Lanes:
    rank = np.argsort(lanes.cost, kind="stable")[:count]
    return _by_lane(lambda leaf: leaf[rank], lanes)
