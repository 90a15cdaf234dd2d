"""Orders and orientations for the local search to start from, drawn from the bin-aware policy.

The policy was trained on a grid of cells. A bin of any size is that grid to it: every axis is
cut into so many cells that the items' sides come close to whole ones, and what it chooses needs
no more.
"""

from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import Array

from jaxpack.learning.parameters import Params
from jaxpack.learning.recipe import Policy
from jaxpack.learning.rollout import LANES, decide
from jaxpack.model.encoding import Genes, Loading, Stock
from jaxpack.model.problem import Instance, Problem
from jaxpack.model.rules import Rules
from jaxpack.packing.env import Decisions
from jaxpack.packing.table import Table
from jaxpack.search.packer import QUICKLY

CELLS = {2: range(8, 21), 3: range(6, 9)}
"""Dimension -> how many cells an axis may be cut into."""
SHAPES = (64, 256, 1024)
"""Numbers of items, and of kinds, that a program is compiled for: few, it takes seconds."""
STREAM = 1 << 30  # of the draws
TEMPERATURE = 2.0  # the policy is sure of itself; what is wanted here are different orders


@partial(jax.jit, static_argnames=("problem", "network", "kinds"), compiler_options=QUICKLY)
def draw(
    problem: Problem,
    network: Any,  # a bin-aware one
    params: Params,
    instances: Instance,
    seed: Array,  # int32[]
    kinds: int,
) -> Decisions:
    """What the policy decides, compiled in as few seconds as can be."""
    # Not among the keys that the search, which starts from the same seed, splits from its own.
    keys = jax.random.split(jax.random.fold_in(jax.random.key(seed), STREAM), LANES)
    view = Table(problem, rolled=True)
    return decide(network, view, params, instances, keys, kinds, TEMPERATURE, cuts=())


class Program(NamedTuple):
    """All that a program depends on, but for the rules and the policy."""

    dimension: int
    items: int
    kinds: int
    ways: int  # orientations

    def __str__(self) -> str:
        what = f"{self.items} items of {self.kinds} kinds, orientations: {self.ways}"
        return f"{self.dimension}D, the policy, {what}"

    def compile(self, policy: Policy) -> None:
        """Compiles it, which puts it in the cache."""
        whole = partial(jax.ShapeDtypeStruct, dtype=np.dtype("int32"))
        sizes, mask = (LANES, self.items, 3), jax.ShapeDtypeStruct((LANES, self.items), bool)
        turned = whole((LANES, self.items, self.ways, 3))
        leaves: Any = whole(sizes), mask, whole((LANES, 3)), turned  # shapes instead of arrays
        problem, network = _grid(self.dimension, Rules()), policy.config.policy
        draw.lower(
            problem, network, policy.params, Instance(*leaves), whole(()), self.kinds
        ).compile()


def programs(dimension: int, items: int) -> Iterator[Program]:
    """Those of all orders of so many items or fewer, at most the last of `SHAPES`, where the usual
    share of an item's base is carried.
    """
    shapes = [shape for shape in SHAPES if shape <= (first_stage(SHAPES, items) or items)]
    for count, kinds, ways in product(shapes, shapes, (1, 2) if dimension == 2 else (1, 2, 6)):
        if kinds <= count:
            yield Program(dimension, count, kinds, ways)


def policy_genes(loading: Loading, stock: Stock, genes: Genes, policy: Policy, seed: int) -> Genes:
    """Sampled orders, for the sequences of bins of some sorts: leaves [LANES, ...].

    Half of the lanes keep the sorts' orientations, in the others the policy chooses them too.

    Args:
        loading: the job.
        stock: that of the loading, padded.
        genes: LANES of the sorts, for that stock.
        policy: a bin-aware one for the job's dimension.
        seed: of the draws.
    """
    kept = np.arange(LANES)[:, None] < LANES // 2
    instances, kinds = _on_a_grid(loading, stock, genes, kept)
    problem = _grid(loading.job.dimension, loading.rules)
    drawn = draw(problem, policy.config.policy, policy.params, instances, np.int32(seed), kinds)
    order, turn = np.asarray(drawn.order), np.asarray(drawn.orientation)
    # The filling up to a shape has the last numbers, and is last in every order.
    items = genes.order.shape[1]
    # What has fewer orientations than others has its last one again in the place of those.
    turn = np.minimum(turn[:, :items], np.maximum(stock.ways - 1, 0))
    return genes._replace(order=order[:, :items], turn=np.where(kept, genes.turn, turn))


def _grid(dimension: int, rules: Rules) -> Problem:
    most = CELLS[dimension][-1]
    depth = 1 if dimension == 2 else most
    return Problem((most, depth, most), support=rules.support, inclusive=rules.inclusive)


def _on_a_grid(
    loading: Loading, stock: Stock, genes: Genes, kept: np.ndarray
) -> tuple[Instance, int]:
    """The items in cells of every lane's first bin; and how many kinds there are at most.

    Args:
        kept: bool [lanes, 1], where the orientations are those of the genes.
    """
    room = stock.bins[genes.pool[:, 0]].astype(np.float64)  # [lanes, 3]
    share = stock.sizes / room[:, None, None]  # [lanes, N, O, 3]
    choices = np.asarray(CELLS[loading.job.dimension])
    inside = (share <= 1) & stock.mask[:, None, None]
    off = np.abs(share[..., None] * choices - np.round(share[..., None] * choices)) / choices
    cells = choices[np.where(inside[..., None], off, 0).sum((1, 2)).argmin(-1)]  # [lanes, 3]
    if loading.flat:
        cells[:, 1] = 1
    grid = cells[:, None, None]
    whole = np.where(share > 1, grid + 1, np.maximum(np.round(share * grid), 1)).astype(np.int32)
    lanes, count, ways, _ = whole.shape
    chosen = np.take_along_axis(whole, genes.turn[..., None, None], 2)
    whole = np.where(kept[..., None, None], np.repeat(chosen, ways, 2), whole)
    rows = whole.reshape(lanes, count, -1)[:, stock.mask]
    kinds = max(len(np.unique(some, axis=0)) for some in rows)
    items = first_stage(SHAPES, count) or count
    empty = ((0, 0), (0, items - count))
    mask = np.pad(np.broadcast_to(stock.mask, (lanes, count)), empty)
    turned = np.pad(whole, (*empty, (0, 0), (0, 0)), constant_values=1)
    leaves: Any = turned[:, :, 0], mask, cells.astype(np.int32), turned  # of NumPy
    return Instance(*leaves), min(first_stage(SHAPES, kinds) or kinds, items)


def first_stage(stages: tuple[int, ...], count: int) -> int | None:
    """The first stage that is large enough."""
    return next((stage for stage in stages if stage >= count), None)
