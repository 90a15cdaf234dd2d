"""Local search over orders, orientations and the sequence of bins: many lanes side by side.

Every lane holds one order of the items, how each is turned, and in which sequence bins are
opened; a round proposes one change per lane, packs it and keeps it if it is not worse by more
than the temperature allows. Or the lanes are a population, and a round is a generation of the
genetic algorithm (Goncalves and Resende, 2011). Everything a lane holds is an order, the kernel
is the judge.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxpack.model.encoding import Genes, Stock
from jaxpack.model.objectives import Cost, Placed
from jaxpack.model.objectives.bins import bins_cost
from jaxpack.packing.first_fit_exact import Bins, ExactRules, Items, pack_exact

ELITE, MUTANTS, BIAS = 0.2, 0.14, 0.7  # as in `solvers.brkga`


class Best(NamedTuple):
    """The best packing that any lane has met."""

    genes: Genes  # leaves without the axis P
    bin: Array  # int32 [N], index of `Stock.bins` by item, -1 for what is left out
    corner: Array  # int32 [N, 3], units
    cost: Array  # float32[]


class Lanes(NamedTuple):
    """The lanes, and the best that any of them has met."""

    key: Array  # typed PRNG key[]
    genes: Genes
    bin: Array  # int32 [P, N], bin of every item
    cost: Array  # float32 [P]
    best: Best


def fresh_lanes(key: Array, genes: Genes) -> Lanes:
    """Lanes that have not been packed yet."""
    P, N = genes.order.shape
    first = jax.tree.map(lambda leaf: leaf[0], genes)
    nothing = jnp.full((P, N), -1, jnp.int32)
    best = Best(first, nothing[0], jnp.zeros((N, 3), jnp.int32), jnp.float32(jnp.inf))
    # A weak type would be another program: the search would compile twice.
    return Lanes(key, genes, nothing, jnp.full(P, jnp.inf, jnp.float32), best)


def pack_lanes(
    rules: ExactRules, stock: Stock, genes: Genes, cost: Cost = bins_cost
) -> tuple[Array, Array, Array]:
    """(bin int32 [P, N], corner int32 [P, N, 3], cost float32 [P]); the rows are the stock's.

    The bin is an index of `Stock.bins`, the cost an objective's.
    """
    lane = jnp.arange(genes.order.shape[0])[:, None]
    item, pool = genes.order, genes.pool
    turn = genes.turn[lane, item]
    sizes = stock.sizes[item, turn]  # [P, N, 3]
    size, room = jnp.moveaxis(sizes, 0, -1), jnp.moveaxis(stock.bins[pool], 0, -1)
    with jax.enable_x64(True):  # areas and weights may have 64 bits
        needed, weight, limit = stock.needed[item, turn], stock.weight[item], stock.limit[pool]
        items = Items(size, needed.T, weight.T, stock.mask[item].T)
        bins = Bins(room, limit.T, stock.step)
    layout = pack_exact(rules, items, bins)
    slot = layout.bin.T
    bin = jnp.where(slot >= 0, genes.pool[lane, slot], -1)
    by_item = jnp.zeros_like(bin).at[lane, item].set(bin)
    corner = jnp.zeros_like(sizes).at[lane, item].set(jnp.moveaxis(layout.corner, -1, 0))
    lies = stock.sizes[jnp.arange(item.shape[1]), genes.turn]
    placed = Placed(by_item, corner, lies)
    return by_item, corner, jax.vmap(partial(cost, jnp, stock))(placed)


AS_GIVEN, ANNEAL, BREED = range(3)
"""What a round does: it packs the lanes as they are, to know what they cost; or goes on."""


@partial(jax.jit, static_argnames=("rules", "objective"))
def advance(
    rules: ExactRules,
    stock: Stock,
    lanes: Lanes,
    rounds: Array,
    heat: Array,
    how: Array,
    objective: Cost = bins_cost,
) -> Lanes:
    """So many rounds; when annealing the worst quarter of the lanes then go on from better ones.

    The one program of a search: it takes seconds to compile.

    Args:
        rounds: int32[].
        heat: float32[], rises in cost of this size are accepted one time in three.
        how: int32[], AS_GIVEN, ANNEAL or BREED.
        objective: what a packing costs.
    """

    def one_round(_: Array, lanes: Lanes) -> Lanes:
        key, change_key, coin_key = jax.random.split(lanes.key, 3)
        P = lanes.cost.shape[0]
        rises = heat * jax.random.exponential(coin_key, (P,))
        proposals = [_as_given, _annealed, _bred]
        new, rises = jax.lax.switch(how, proposals, stock, change_key, lanes, rises)
        genes = Genes(jnp.argsort(new.place).astype(jnp.int32), new.turn, new.pool)
        bin, corner, cost = pack_lanes(rules, stock, genes, objective)
        kept = cost <= lanes.cost + rises
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
        return Lanes(key, genes, bin, cost, best)

    lanes = jax.lax.fori_loop(0, rounds, one_round, lanes)
    P = lanes.cost.shape[0]
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
    return Lanes(lanes.key, genes, bin, cost, _better(lanes.best, others.best))


@jax.jit
def exchange(one: Lanes, other: Lanes) -> tuple[Lanes, Lanes]:
    """Either with the best quarter of the other in the place of its worst."""
    P = one.cost.shape[0]
    best = _better(one.best, other.best)

    def visited(lanes: Lanes, guests: Lanes) -> Lanes:
        stay, come = _cheapest(_held(lanes), P - P // 4), _cheapest(_held(guests), P // 4)
        genes, bin, cost = _side_by_side(stay, come)
        return Lanes(lanes.key, genes, bin, cost, best)

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


def _as_given(stock: Stock, key: Array, lanes: Lanes, rises: Array) -> tuple[Proposals, Array]:
    return Proposals(_places(lanes.genes.order), lanes.genes.turn, lanes.genes.pool), rises


def _annealed(stock: Stock, key: Array, lanes: Lanes, rises: Array) -> tuple[Proposals, Array]:
    """One random change of every lane."""
    keys = jax.random.split(key, lanes.cost.shape[0])
    return jax.vmap(_changed, (None, 0, 0, 0))(stock, keys, lanes.genes, lanes.bin), rises


def _bred(stock: Stock, key: Array, lanes: Lanes, rises: Array) -> tuple[Proposals, Array]:
    """The next generation: mutants, children, and the elite where no child of theirs is better.

    A child inherits every item's place and orientation from one of the elite or one other.
    """
    P, N = lanes.genes.order.shape
    elite, mutants = max(1, round(ELITE * P)), round(MUTANTS * P)
    lane = jnp.arange(P)
    cost = lanes.cost
    before = (cost < cost[:, None]) | ((cost == cost[:, None]) & (lane < lane[:, None]))
    rank = before.sum(1)
    best_first = jnp.zeros(P, jnp.int32).at[rank].set(lane)
    coin_key, pair_key, fresh_key = jax.random.split(key, 3)
    coins = jax.random.uniform(coin_key, (P, N + 1)) < BIAS
    pairs = jax.random.uniform(pair_key, (2, P))
    mother = best_first[(pairs[0] * elite).astype(jnp.int32)]
    father = best_first[elite + (pairs[1] * (P - elite)).astype(jnp.int32)]
    fresh = jax.random.uniform(fresh_key, (2, P, N))
    mutant = (rank >= P - mutants)[:, None]
    place, turn = (
        jnp.where(mutant, new, jnp.where(coins[:, :N], old[mother], old[father]))
        for new, old in (
            (fresh[0] * N, _places(lanes.genes.order)),
            ((fresh[1] * stock.ways).astype(jnp.int32), lanes.genes.turn),
        )
    )
    pool = jnp.where(coins[:, N:], lanes.genes.pool[mother], lanes.genes.pool[father])
    place = jnp.where(stock.mask, place, N + jnp.arange(N))
    return Proposals(place, turn, pool), jnp.where(rank < elite, 0, jnp.inf)


def _places(orders: Array) -> Array:
    """Where every item stands: float32 [P, N]."""
    P, N = orders.shape
    return (
        jnp.zeros((P, N)).at[jnp.arange(P)[:, None], orders].set(jnp.arange(N, dtype=jnp.float32))
    )


def _changed(stock: Stock, key: Array, genes: Genes, bin: Array) -> Proposals:
    keys = jax.random.split(key, 8)
    N, S = genes.order.shape[0], genes.pool.shape[0]
    count = stock.mask.sum()
    place = jnp.arange(N, dtype=jnp.float32)
    one, two = jax.random.randint(keys[0], (2,), 0, count)
    swapped = place.at[one].set(two).at[two].set(one)
    moved = place.at[one].set(two + jnp.where(two > one, 0.5, -0.5))
    # The items of one bin before all others.
    in_order = bin[genes.order]
    mine = in_order == in_order[one]
    dissolved = jnp.where(mine, place - N, place)
    # Part of a bin last: what remains there settles anew.
    choice = jax.random.uniform(keys[1])
    rank = jnp.where(choice < 0.35, swapped, jnp.where(choice < 0.7, moved, place))
    rank = jnp.where((choice >= 0.7) & (choice < 0.8), dissolved, rank)
    rank = jnp.where(jnp.arange(N) < count, rank, place)
    item = genes.order[one]
    turns = (choice >= 0.8) | (jax.random.uniform(keys[2]) < 0.1)
    way = jax.random.randint(keys[3], (), 0, stock.ways[item])
    turn = genes.turn.at[item].set(jnp.where(turns, way, genes.turn[item]))
    used = (jnp.zeros(S).at[bin].add(bin >= 0) > 0).sum()
    first = jax.random.randint(keys[4], (), 0, jnp.minimum(used + 1, S))
    second = jax.random.randint(keys[5], (), 0, S)
    exchanged = genes.pool.at[first].set(genes.pool[second]).at[second].set(genes.pool[first])
    several = (stock.price.max() > stock.price.min()) | (stock.bins != stock.bins[0]).any()
    pool = jnp.where(several & (jax.random.uniform(keys[6]) < 0.2), exchanged, genes.pool)
    return Proposals(jnp.zeros(N).at[genes.order].set(rank), turn, pool)
