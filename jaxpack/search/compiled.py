"""The compiled search for a plan: lanes that breed and lanes that anneal, on every core.

It takes seconds to compile the first time that a machine has a job of a size, and neither that
nor a round can be stopped: `background` runs it in a process of its own.
"""

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from time import perf_counter

import numpy as np

from jaxpack.learning.recipe import Policy
from jaxpack.learning.rollout import LANES as DRAWN
from jaxpack.model.encoding import Genes, Loading, Stock, lane_genes, padded_genes
from jaxpack.model.objectives import Placed
from jaxpack.search.local_search import (
    Best,
    Lanes,
    Packer,
    Step,
    advance,
    annealed,
    bred,
    exchange,
    join,
    packed,
)
from jaxpack.search.packer import encode, pack_lanes
from jaxpack.search.policy_orders import policy_genes
from jaxpack.xla.environment import usable_cores

LANES, FEW_LANES, MANY_ITEMS = 32, 8, 256  # fewer where a round of many items takes seconds
ROUNDS = 8  # per dispatch, fewer where they take longer than a BREATH
BREATH = 0.25  # seconds
PAIRS = 2  # of islands, where a number of packings is given
EXCHANGE = 4  # dispatches after which those that breed and those that anneal share their best
HEAT = 0.02  # of the annealing at the start, in bins


def lanes_of(items: int) -> int:
    """How many are packed side by side, each of so many rows of items."""
    return LANES if items <= MANY_ITEMS else FEW_LANES


def packer_of(loading: Loading) -> tuple[Packer, Stock]:
    """The compiled packer of a job, and the stock padded as its genes have to be."""
    decoding, stock = encode(loading)

    def packer(genes: Genes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        bin, corner = pack_lanes(decoding, stock, genes)
        lies = stock.sizes[np.arange(genes.turn.shape[1]), genes.turn]
        return bin, corner, loading.objective.cost(stock, Placed(bin, corner, lies))

    return packer, stock


def first_genes(
    loading: Loading, stock: Stock, seed: int, lanes: int, given: Genes | None = None
) -> Genes:
    """So many sorts for a padded stock: leaves [lanes, ...]; the first one may be given."""
    own = [given or lane_genes(loading, seed, 0)]
    own += [lane_genes(loading, seed, lane) for lane in range(1, lanes)]
    rows = [padded_genes(genes, len(stock.mask), len(stock.price)) for genes in own]
    return Genes(*map(np.stack, zip(*rows, strict=True)))


def search(
    loading: Loading,
    seed: int,
    seconds: float,
    first: Genes | None = None,
    policy: Policy | None = None,
    wanted: Callable[[], bool] = lambda: True,
    packings: int | None = None,
) -> Iterator[tuple[Best, int]]:
    """(the best packing so far, packings tried since), until the time is up or it is not wanted.

    Args:
        loading: the job, one that `compiles`.
        seed: of the random choices.
        seconds: how long it may take.
        first: of one lane, to begin with besides the sorts.
        policy: a bin-aware one for the job's dimension; the search goes on from its orders too.
        wanted: asked between dispatches.
        packings: at most; neither the clock nor the cores have a say in what is tried then.
    """
    limit = _Limit(seconds, packings)
    packer, stock = packer_of(loading)
    many = lanes_of(len(stock.mask))
    genes = first_genes(loading, stock, seed, many, first)
    if packings is not None and packings < many:
        return
    lanes = packed(packer, np.random.default_rng([seed, 0]), genes)
    limit.tried = many
    yield lanes.best, many
    drawn, guests = None, list[Genes]()
    with ThreadPoolExecutor() as threads:
        if policy:
            drawn = threads.submit(_draws, loading, stock, policy, seed)
            if packings is not None:
                guests, drawn = _parts(drawn, many), None
        # Two on every core, which take turns: the even ones breed, the odd ones anneal.
        pairs = min(usable_cores(), 8) if packings is None else PAIRS
        randoms = [np.random.default_rng([seed, n]) for n in range(1, 1 + 2 * pairs)]
        islands = [lanes._replace(random=random) for random in randoms]
        turn = 0
        while (rounds := limit.rounds(many * pairs, many * bool(guests))) and wanted():
            now, heat = perf_counter(), HEAT * limit.left() ** 2
            step, mine = ((bred, islands[::2]), (annealed, islands[1::2]))[turn % 2]
            visits = [None] * (len(mine) - 1) + [guests.pop() if guests else None]
            some = partial(_visited, packer, stock, step, rounds, heat)
            done = list(threads.map(some, mine, visits))
            tried = many * (rounds * len(done) + (visits[-1] is not None))
            if drawn and drawn.done():
                guests, drawn = _parts(drawn, many), None
            islands[turn % 2 :: 2] = done
            turn += 1
            if turn % EXCHANGE == 0:
                islands = _exchanged(islands, turn // EXCHANGE % 2)
            limit.spend(tried, perf_counter() - now)
            yield min((some.best for some in islands), key=lambda best: best.cost), tried


class _Limit:
    """How far a search may go, in seconds and in packings, and in what steps."""

    def __init__(self, seconds: float, packings: int | None) -> None:
        self.seconds, self.end = seconds, perf_counter() + seconds
        self.packings, self.tried = packings, 0
        self.lasted = deque([0.0], EXCHANGE)
        self.doubled = 1

    def rounds(self, each: int, more: int = 0) -> int:
        """How many rounds of so many packings may come next, with some more; 0 if none."""
        if perf_counter() + max(self.lasted) >= self.end:
            return 0
        if self.packings is None:
            return self.doubled
        return max(0, min(ROUNDS, (self.packings - self.tried - more) // each))

    def left(self) -> float:
        """The share of it that is left."""
        if self.packings is None:
            return (self.end - perf_counter()) / self.seconds
        return 1 - self.tried / self.packings

    def spend(self, packings: int, seconds: float) -> None:
        """Counts what a dispatch took."""
        self.tried += packings
        self.lasted.append(seconds)
        if 2 * seconds < BREATH:
            self.doubled = min(2 * self.doubled, ROUNDS)


def _visited(
    packer: Packer,
    stock: Stock,
    step: Step,
    rounds: int,
    heat: float,
    lanes: Lanes,
    guests: Genes | None,
) -> Lanes:
    """The lanes after so many rounds, guests in the place of worse ones. See `advance`."""
    if guests:
        lanes = join(lanes, packed(packer, lanes.random, guests))
    return advance(packer, stock, lanes, step, rounds, heat)


def _draws(loading: Loading, stock: Stock, policy: Policy, seed: int) -> Genes:
    """The policy's orders for a padded stock."""
    sorts = first_genes(loading, stock, seed, DRAWN)
    return policy_genes(loading, stock, sorts, policy, seed)


def _parts(drawn: Future[Genes], many: int) -> list[Genes]:
    orders = drawn.result()
    firsts = range(0, len(orders.order), many)
    return [Genes(*(leaf[first : first + many] for leaf in orders)) for first in firsts]


def _exchanged(islands: list[Lanes], first: int) -> list[Lanes]:
    """After all neighbours from the first on have exchanged their best: the last one's is first."""
    islands = islands[first:] + islands[:first]
    pairs = zip(islands[::2], islands[1::2], strict=True)
    islands = [lanes for pair in pairs for lanes in exchange(*pair)]
    return islands[-first:] + islands[:-first] if first else islands
