"""Orders and orientations for the local search to start from, drawn from the bin-aware policy.

The policy was trained on a grid of cells. A bin of any size is that grid to it: every axis is
cut into so many cells that the items' sides come close to whole ones, and what it chooses needs
no more.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.learning.parameters import Params
from jaxpack.learning.recipe import Policy
from jaxpack.learning.rollout import LANES, decide
from jaxpack.model.encoding import Genes, Loading, Stock
from jaxpack.model.problem import Instance, Problem
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
    keys: Array,
    kinds: int,
) -> Decisions:
    """What the policy decides, compiled in as few seconds as can be."""
    view = Table(problem, rolled=True)
    return decide(network, view, params, instances, keys, kinds, TEMPERATURE, cuts=())


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
    most = CELLS[loading.job.dimension][-1]
    depth = 1 if loading.flat else most
    problem = Problem(
        (most, depth, most), support=loading.rules.support, inclusive=loading.rules.inclusive
    )
    network = policy.config.policy
    # Not among the keys that the search, which starts from the same seed, splits from its own.
    keys = jax.random.split(jax.random.fold_in(jax.random.key(seed), STREAM), LANES)
    drawn = draw(problem, network, policy.params, instances, keys, kinds)
    order, turn = map(np.asarray, drawn)
    # The filling up to a shape has the last numbers, and is last in every order.
    items = genes.order.shape[1]
    return genes._replace(order=order[:, :items], turn=np.where(kept, genes.turn, turn[:, :items]))


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
    turned = jnp.asarray(np.pad(whole, (*empty, (0, 0), (0, 0)), constant_values=1))
    instance = Instance(turned[:, :, 0], jnp.asarray(mask), jnp.asarray(cells, jnp.int32), turned)
    return instance, min(first_stage(SHAPES, kinds) or kinds, items)


def first_stage(stages: tuple[int, ...], count: int) -> int | None:
    """The first stage that is large enough."""
    return next((stage for stage in stages if stage >= count), None)
