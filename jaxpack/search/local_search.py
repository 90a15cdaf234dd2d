"""Local search over orders, orientations and the sequence of bins: many lanes side by side.

Every lane holds one order of the items, how each is turned, and in which sequence bins are
opened; a round proposes one change per lane, packs it and keeps it if it is not worse by more
than the temperature allows. Or the lanes are a population, and a round is a generation of the
genetic algorithm (Goncalves and Resende, 2011). Everything a lane holds is an order, the decoder
is the judge.

It is compiled while somebody waits, so that there is one of everything: one packing, one sort, and
one draw of all the random numbers of a round.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.model.encoding import Genes, Stock
from jaxpack.model.objectives import Cost, Placed
from jaxpack.model.objectives.bins import bins_cost
from jaxpack.packing.decode import Bins, Items, decode
from jaxpack.packing.rules import rule_named
from jaxpack.packing.top_faces import TopFaces
from jaxpack.search.brkga import BrkgaConfig, crossed
from jaxpack.xla.pieces import in_pieces
from jaxpack.xla.target import Target, target, traced_for

QUICKLY = {"xla_backend_optimization_level": 1}
"""What XLA is asked for: a third less to compile, and the program is no slower for it."""
PIECE = 64  # lanes that are packed side by side
CHANGES = 9  # random numbers of a change


@dataclass(frozen=True)
class Decoding:
    """What stays fixed while a search runs: hashable, a static argument of ``jit``."""

    surface: TopFaces
    rule: str = "lowest"  # of positions, a name in `jaxpack.packing.rules`
    cost: Cost = bins_cost  # an objective's
    breeding: BrkgaConfig = BrkgaConfig()  # of it the shares
    made_for: Target = field(default_factory=target)


class Best(NamedTuple):
    """The best packing that any lane has met."""

    genes: Genes  # leaves without the axis P
    bin: Any  # int32 [N], index of `Stock.bins` by item, -1 for what is left out
    corner: Any  # int32 [N, 3], units
    cost: Any  # float32[]


class Lanes(NamedTuple):
    """The lanes, and the best that any of them has met."""

    seed: Any  # uint32 [2], data of a PRNG key, the same for ever
    round: Any  # int32[], folded into it
    genes: Genes
    bin: Any  # int32 [P, N], bin of every item
    cost: Any  # float32 [P]
    best: Best


def fresh_lanes(seed: Array, genes: Genes) -> Lanes:
    """Lanes that have not been packed yet; made in NumPy, as all that JAX does takes a program."""
    P, N = genes.order.shape
    first = jax.tree.map(lambda leaf: np.asarray(leaf)[0], genes)
    nothing = np.full((P, N), -1, np.int32)
    best = Best(first, nothing[0], np.zeros((N, 3), np.int32), np.float32(np.inf))
    costs = np.full(P, np.inf, np.float32)
    lanes: Lanes = jax.tree.map(jnp.asarray, Lanes(seed, np.int32(0), genes, nothing, costs, best))
    return lanes


def pack_lanes(decoding: Decoding, stock: Stock, genes: Genes) -> tuple[Array, Array, Array]:
    """(bin int32 [P, N], corner int32 [P, N, 3], cost float32 [P]); the rows are the stock's.

    The bin is an index of `Stock.bins`, the cost an objective's.
    """
    with jax.enable_x64(True):  # areas and weights may have 64 bits
        stocks = jax.tree.map(lambda leaf: leaf[None], stock)
    many = jax.tree.map(lambda leaf: leaf[None], genes)
    packed: tuple[Array, Array, Array] = jax.tree.map(
        lambda leaf: leaf[0], pack_jobs(decoding, stocks, many)
    )
    return packed


def pack_jobs(decoding: Decoding, stocks: Stock, genes: Genes) -> tuple[Array, Array, Array]:
    """`pack_lanes` of B jobs that are padded alike: leaves [B, ...] and [B, P, ...].

    Many lanes are packed piece by piece, those of the smallest jobs first: a piece takes as long as
    the longest of its lanes.
    """
    (B, P, N), surface = genes.order.shape, decoding.surface
    job, lane = jnp.arange(B)[:, None, None], jnp.arange(P)[:, None]
    item = jnp.arange(N)
    lies = stocks.sizes[job, item, genes.turn]  # [B, P, N, 3]
    sizes, rooms = (sides.astype(surface.dtype) for sides in (lies, stocks.bins[job, genes.pool]))
    with jax.enable_x64(True):
        needed, limit = stocks.needed[job, item, genes.turn], stocks.limit[job, genes.pool]
        rows = (
            sizes,
            needed,
            *(jnp.broadcast_to(leaf[:, None], (B, P, N)) for leaf in (stocks.mask, stocks.weight)),
            rooms,
            limit,
            genes.order,
        )
        rows = jax.tree.map(lambda leaf: leaf.reshape(B * P, *leaf.shape[2:]), rows)
        few = B * P <= PIECE
        placed = _placed(decoding, rows) if few else _in_pieces(decoding, rows, stocks.mask, P)
    bin, corner = jax.tree.map(lambda leaf: leaf.reshape(B, P, *leaf.shape[1:]), placed)
    bin = jnp.where(bin >= 0, genes.pool[job, lane, bin], -1)
    cost = jax.vmap(lambda *of: jax.vmap(partial(decoding.cost, jnp, of[0]))(Placed(*of[1:])))
    return bin, corner, cost(stocks, bin, corner, lies)


def _in_pieces(decoding: Decoding, rows: tuple, mask: Array, lanes: int) -> tuple[Array, Array]:
    """`_placed` of many lanes."""
    count = jnp.repeat(mask.sum(1, dtype=jnp.int32), lanes)
    by_count = jnp.argsort(count).astype(jnp.int32)
    rows = jax.tree.map(lambda leaf: leaf[by_count], rows)
    placed = in_pieces(partial(_placed, decoding), rows, PIECE)
    back = jnp.zeros_like(by_count).at[by_count].set(jnp.arange(len(count), dtype=jnp.int32))
    found: tuple[Array, Array] = jax.tree.map(lambda leaf: leaf[back], placed)
    return found


def _placed(decoding: Decoding, rows: tuple) -> tuple[Array, Array]:
    """(bin int32 [P, N], an index of the pool, corner int32 [P, N, 3]) of lanes [P, ...]."""
    sizes, needed, mask, weight, rooms, limit, order = rows
    sizes, rooms = (jnp.moveaxis(sides, -1, 0) for sides in (sizes, rooms))
    items = Items((sizes[0].T, sizes[1].T, sizes[2].T), needed.T, mask.T, weight.T)
    bins = Bins((rooms[0].T, rooms[1].T, rooms[2].T), limit.T)
    with traced_for(decoding.made_for):
        placed = decode(decoding.surface, rule_named(decoding.rule), items, bins, order.T)
    corner = jnp.moveaxis(jnp.stack(placed.corner, -1).astype(jnp.int32), 1, 0)
    return placed.bin.T.astype(jnp.int32), corner


AS_GIVEN, ANNEAL, BREED = range(3)
"""What a round does: it packs the lanes as they are, to know what they cost; or goes on."""


@partial(jax.jit, static_argnames="decoding", compiler_options=QUICKLY)
def advance(
    decoding: Decoding, stock: Stock, lanes: Lanes, rounds: Array, heat: Array, how: Array
) -> Lanes:
    """So many rounds; when annealing the worst quarter of the lanes then go on from better ones.

    The one program of a search: it takes seconds to compile.

    Args:
        rounds: int32[].
        heat: float32[], rises in cost of this size are accepted one time in three.
        how: int32[], AS_GIVEN, ANNEAL or BREED.
    """
    P, N = lanes.genes.order.shape

    def one_round(_: Array, lanes: Lanes) -> Lanes:
        key = jax.random.fold_in(jax.random.wrap_key_data(lanes.seed), lanes.round)
        drawn = jax.random.uniform(key, (P, 3 * N + CHANGES))
        proposals: list[Callable] = [_as_given, _annealed, partial(_bred, decoding.breeding)]
        new = jax.lax.switch(how, proposals, stock, drawn, lanes, heat)
        genes = Genes(jnp.argsort(new.place).astype(jnp.int32), new.turn, new.pool)
        bin, corner, cost = pack_lanes(decoding, stock, genes)
        kept = cost <= lanes.cost + new.rise
        least = jnp.argmin(cost)
        tried = Best(
            jax.tree.map(lambda leaf: leaf[least], genes), bin[least], corner[least], cost[least]
        )
        best = _better(lanes.best, tried)
        genes, bin, cost = jax.tree.map(
            lambda leaf, old: jnp.where(kept.reshape(-1, *(1,) * (leaf.ndim - 1)), leaf, old),
            (genes, bin, cost),
            (lanes.genes, lanes.bin, lanes.cost),
        )
        return Lanes(lanes.seed, lanes.round + 1, genes, bin, cost, best)

    lanes = jax.lax.fori_loop(0, rounds, one_round, lanes)
    rank = jnp.argsort(lanes.cost)
    better = rank.at[P - P // 4 :].set(rank[: P // 4])
    source = jnp.where(how == ANNEAL, better, jnp.arange(P))
    genes, bin, cost = jax.tree.map(lambda leaf: leaf[source], (lanes.genes, lanes.bin, lanes.cost))
    return lanes._replace(genes=genes, bin=bin, cost=cost)


@jax.jit
def join(lanes: Lanes, others: Lanes) -> Lanes:
    """The best of the lanes and of others, as many as there are lanes."""
    both = _side_by_side(_held(lanes), _held(others))
    genes, bin, cost = _cheapest(both, len(lanes.cost))
    best = _better(lanes.best, others.best)
    return lanes._replace(genes=genes, bin=bin, cost=cost, best=best)


@jax.jit
def exchange(one: Lanes, other: Lanes) -> tuple[Lanes, Lanes]:
    """Either with the best quarter of the other in the place of its worst."""
    P = one.cost.shape[0]
    best = _better(one.best, other.best)

    def visited(lanes: Lanes, guests: Lanes) -> Lanes:
        stay, come = _cheapest(_held(lanes), P - P // 4), _cheapest(_held(guests), P // 4)
        genes, bin, cost = _side_by_side(stay, come)
        return lanes._replace(genes=genes, bin=bin, cost=cost, best=best)

    return visited(one, other), visited(other, one)


Held = tuple[Genes, Array, Array]  # of some lanes: genes, bins and costs


def _held(lanes: Lanes) -> Held:
    return lanes.genes, lanes.bin, lanes.cost


def _side_by_side(one: Held, other: Held) -> Held:
    both: Held = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), one, other)
    return both


def _cheapest(held: Held, count: int) -> Held:
    rank = jnp.argsort(held[2])[:count]
    cheapest: Held = jax.tree.map(lambda leaf: leaf[rank], held)
    return cheapest


def _better(one: Best, other: Best) -> Best:
    """The cheaper of two; of equally good ones the first."""
    wins = other.cost < one.cost
    return jax.tree.map(lambda new, old: jnp.where(wins, new, old), other, one)


class Proposals(NamedTuple):
    """What is to be packed next in every lane. Sorting takes long to compile: it is left to one."""

    place: Array  # float32 [P, N], by item: the smallest goes first, padding last
    turn: Array  # int32 [P, N]
    pool: Array  # int32 [P, S]
    rise: Array  # float32 [P], in cost, the largest that is accepted


def _as_given(stock: Stock, drawn: Array, lanes: Lanes, heat: Array) -> Proposals:
    genes = lanes.genes
    return Proposals(_places(genes.order), genes.turn, genes.pool, jnp.zeros_like(lanes.cost))


def _annealed(stock: Stock, drawn: Array, lanes: Lanes, heat: Array) -> Proposals:
    """One random change of every lane: items change places or bins, one is turned, or bins swap."""
    (P, N), S = lanes.genes.order.shape, lanes.genes.pool.shape[1]
    genes, lane, place = lanes.genes, jnp.arange(P)[:, None], jnp.arange(N)
    choice, turns, swaps, way, *rest, rises = (drawn[:, n, None] for n in range(CHANGES))
    count = stock.mask.sum()
    one, two = ((number * count).astype(jnp.int32) for number in rest[:2])
    swapped = jnp.where(place == one, two, jnp.where(place == two, one, place))
    moved = jnp.where(place == one, two + jnp.where(two > one, 0.5, -0.5), place)
    # The items of one bin before all others.
    in_order = lanes.bin[lane, genes.order]
    dissolved = jnp.where(in_order == in_order[lane, one], place - N, place)
    rank = jnp.where(choice < 0.35, swapped, jnp.where(choice < 0.7, moved, place))
    rank = jnp.where((choice >= 0.7) & (choice < 0.8), dissolved, rank)
    rank = jnp.where(place < count, rank, place)
    item = genes.order[lane, one]
    other = (way * stock.ways[item]).astype(jnp.int32)
    turning = (jnp.arange(N) == item) & ((choice >= 0.8) | (turns < 0.1))
    used = jnp.zeros((P, S), bool).at[lane, lanes.bin].max(lanes.bin >= 0).sum(1, keepdims=True)
    several = (stock.price.max() > stock.price.min()) | (stock.bins != stock.bins[0]).any()
    first = (rest[2] * jnp.minimum(used + 1, S)).astype(jnp.int32)
    second = (rest[3] * S).astype(jnp.int32)
    slot = jnp.arange(S)
    pool = jnp.where(slot == first, genes.pool[lane, second], genes.pool)
    pool = jnp.where(slot == second, genes.pool[lane, first], pool)
    return Proposals(
        jnp.zeros((P, N)).at[lane, genes.order].set(rank),
        jnp.where(turning, other, genes.turn),
        jnp.where(several & (swaps < 0.2), pool, genes.pool),
        heat * -jnp.log1p(-rises[:, 0]),
    )


def _bred(config: BrkgaConfig, stock: Stock, drawn: Array, lanes: Lanes, heat: Array) -> Proposals:
    """The next generation: mutants, children, and the elite where no child of theirs is better.

    A child inherits every item's place and orientation from one of the elite or one other.
    """
    (P, N), lane = lanes.genes.order.shape, jnp.arange(len(lanes.cost))
    elite, mutants, _ = config.shares_of(P)
    cost = lanes.cost
    ahead = (cost < cost[:, None]) | ((cost == cost[:, None]) & (lane < lane[:, None]))
    rank = ahead.sum(1)
    best_first = jnp.zeros(P, jnp.int32).at[rank].set(lane)
    mother = best_first[(drawn[:, 0] * elite).astype(jnp.int32)]
    father = best_first[elite + (drawn[:, 1] * (P - elite)).astype(jnp.int32)]
    coins = drawn[:, 2 : N + 3] < config.bias
    fresh = drawn[:, N + 3 : 2 * N + 3], drawn[:, 2 * N + 3 : 3 * N + 3]
    born = crossed(coins[:, :N], (_places(lanes.genes.order), lanes.genes.turn), mother, father)
    mutant = (rank >= P - mutants)[:, None]
    place = jnp.where(mutant, fresh[0] * N, born[0])
    return Proposals(
        jnp.where(stock.mask, place, N + jnp.arange(N)),
        jnp.where(mutant, (fresh[1] * stock.ways).astype(jnp.int32), born[1]),
        crossed(coins[:, N:], lanes.genes.pool, mother, father),
        jnp.where(rank < elite, 0, jnp.inf),
    )


def _places(orders: Array) -> Array:
    """Where every item stands: float32 [P, N]."""
    P, N = orders.shape
    place = jnp.broadcast_to(jnp.arange(N, dtype=jnp.float32), (P, N))
    return jnp.zeros((P, N)).at[jnp.arange(P)[:, None], orders].set(place)
