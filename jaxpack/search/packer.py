"""First fit of many lanes side by side, compiled: NumPy's arrays in and out.

Only the placing is compiled, the one program of a search: compiling keeps the user waiting.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from typing import NamedTuple

import jax
import numpy as np
from jax import Array

from jaxpack.model.encoding import MOST_TOGETHER, Genes, Loading, Stock, most_together, padded
from jaxpack.model.rules import Rules
from jaxpack.packing.decode import Bins, Items, decode
from jaxpack.packing.rules import rule_named
from jaxpack.packing.top_faces import SHORT, TopFaces
from jaxpack.xla.target import Target, target, traced_for

QUICKLY = {"xla_backend_optimization_level": 1}
"""What XLA is asked for: a third less to compile, and the program is no slower for it."""
PIECE = 64  # lanes that a CPU packs side by side
FEWEST = 16  # items, of an order and of a bin, that a program is compiled for
TYPES = (2, 4)
"""Types of bins, of as many copies as there are items, that programs are compiled for ahead."""


@dataclass(frozen=True)
class Decoding:
    """What a program is made for: hashable, a static argument of ``jit``."""

    surface: TopFaces
    rule: str = "lowest"  # of positions, a name in `jaxpack.packing.rules`
    made_for: Target = field(default_factory=target)

    @property
    def whole(self) -> np.dtype:
        """Of areas and weights: int32 where sides are short, or else int64."""
        return np.dtype("int32" if self.surface.short else "int64")


class Program(NamedTuple):
    """All that a program depends on, but for the number of lanes."""

    decoding: Decoding
    items: int  # rows, and those of the bins
    bins: int

    def __str__(self) -> str:
        surface = self.decoding.surface
        dimension, sides = "2D" if surface.flat else "3D", "short" if surface.short else "long"
        items = f"{self.items} items, {surface.most} in a bin"
        return f"{dimension}, {items}, {self.bins} bins, {sides} sides"

    def compile(self, lanes: int) -> None:
        """Compiles it, which puts it in the cache."""
        N, S = self.items, self.bins
        length, whole = self.decoding.surface.dtype, self.decoding.whole
        tables = (
            ((3, N, lanes), length), ((N, lanes), whole), ((N, lanes), bool), ((N, lanes), whole),
            ((3, S, lanes), length), ((S, lanes), whole),
        )  # fmt: skip
        with jax.enable_x64(True):
            shapes = [jax.ShapeDtypeStruct(*table) for table in tables]
            first_fit.lower(self.decoding, *shapes).compile()


def programs(flat: bool, items: int) -> Iterator[Program]:
    """Those of all orders of so many items or fewer, small ones first; but for position rules and
    grids that are not the usual ones, and for more than so many `TYPES` of bins.
    """
    powers = [FEWEST << n for n in range((_power_of_two(items) // FEWEST).bit_length())]
    for count, most, types, short in product(powers, powers, TYPES, (True, False)):
        if most == count if flat else most <= min(count, MOST_TOGETHER):
            surface = TopFaces(most, flat, short, firm=Rules().firm)
            yield Program(Decoding(surface), count, types * count)


def program_of(loading: Loading) -> Program:
    """The one for a job. They are few: room for bins, and for items in one in 2D, costs little."""
    stock, items = loading.stock, _power_of_two(len(loading.items))
    short = int(stock.bins.max()) <= SHORT and stock.weight.dtype == np.int32
    most = items if loading.flat else _power_of_two(most_together(stock))
    surface = TopFaces(most, loading.flat, short, int(stock.step), loading.rules.firm)
    bins = max(TYPES[0] * items, _power_of_two(len(loading.bins)))
    return Program(Decoding(surface, loading.rules.rule), items, bins)


def encode(loading: Loading) -> tuple[Decoding, Stock]:
    """What is static of the program, and the stock padded to the next size that has one."""
    decoding, items, bins = program_of(loading)
    return decoding, padded(loading.stock, items, bins)


def pack_lanes(decoding: Decoding, stock: Stock, genes: Genes) -> tuple[np.ndarray, np.ndarray]:
    """(bin int32 [P, N], an index of `Stock.bins` or -1, corner int32 [P, N, 3]) by row."""
    stocks, many = Stock(*(leaf[None] for leaf in stock)), Genes(*(leaf[None] for leaf in genes))
    bin, corner = pack_jobs(decoding, stocks, many)
    return bin[0], corner[0]


def pack_jobs(decoding: Decoding, stocks: Stock, genes: Genes) -> tuple[np.ndarray, np.ndarray]:
    """`pack_lanes` of B jobs that are padded alike: leaves [B, ...] and [B, P, ...].

    Many lanes are packed piece by piece, those of the smallest jobs first: a piece takes as long as
    the longest of its lanes.
    """
    B, P, N = genes.order.shape
    piece = min(B * P, decoding.made_for.lanes(PIECE))
    job, lane = np.divmod(np.argsort(stocks.mask.sum(1).repeat(P), kind="stable"), P)
    bin, corner = np.empty((B, P, N), np.int32), np.empty((B, P, N, 3), np.int32)
    for first in range(0, B * P, piece):
        some = slice(first, first + piece)
        rows = [np.resize(column[some], piece) for column in (job, lane)]  # the last one filled up
        bin[*rows], corner[*rows] = _piece(decoding, stocks, genes, *rows)
    return bin, corner


def _piece(
    decoding: Decoding, stocks: Stock, genes: Genes, job: np.ndarray, lane: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Of the lanes [P] of the jobs [P]."""
    order, turn, pool = (leaf[job, lane] for leaf in genes)
    which, row = job[:, None], np.arange(len(job))[:, None]
    turned = turn[row, order]
    dtype, whole = decoding.surface.dtype, decoding.whole
    limit = stocks.limit[which, pool]
    if limit.dtype != whole:
        unlimited = limit == np.iinfo(limit.dtype).max
        limit = np.where(unlimited, np.iinfo(whole).max, limit.astype(whole))
    tables = (
        stocks.sizes[which, order, turned].astype(dtype).T,
        stocks.needed[which, order, turned].astype(whole, copy=False).T,
        stocks.mask[which, order].T,
        stocks.weight[which, order].astype(whole, copy=False).T,
        stocks.bins[which, pool].astype(dtype).T,
        limit.T,
    )
    with jax.enable_x64(True):  # areas and weights may have 64 bits
        slot, place = map(np.asarray, first_fit(decoding, *tables))
    bin, corner = np.empty_like(order), np.empty((*order.shape, 3), np.int32)
    bin[row, order] = np.where(slot.T < 0, -1, pool[row, slot.T])
    corner[row, order] = place.T
    return bin, corner


@partial(jax.jit, static_argnames="decoding", compiler_options=QUICKLY)
def first_fit(
    decoding: Decoding,
    sizes: Array,  # [3, N, P], units, the items in their packing order
    needed: Array,  # [N, P]
    waiting: Array,  # bool [N, P]
    weight: Array,  # [N, P]
    rooms: Array,  # [3, S, P], units, the bins in theirs
    limit: Array,  # [S, P]
) -> tuple[Array, tuple[Array, Array, Array]]:
    """(bin [N, P], its place in the sequence of bins or -1, corner [N, P] each)."""
    items = Items((sizes[0], sizes[1], sizes[2]), needed, waiting, weight)
    bins = Bins((rooms[0], rooms[1], rooms[2]), limit)
    with traced_for(decoding.made_for):
        return decode(decoding.surface, rule_named(decoding.rule), items, bins)


def _power_of_two(count: int) -> int:
    return max(FEWEST, 1 << (count - 1).bit_length())
