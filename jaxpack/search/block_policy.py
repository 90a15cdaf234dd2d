"""The policy that says which block to put into a space: what it sees, and its network.

What it sees are shares: of the space, of the bin, of what is left. So bins and items may be of any
size. Its score is added to the hand-made one, the value of a block less the volume that it spoils,
as a share of the space. `experiments/train_blocks.py` made the weights.
"""

import json
from collections.abc import Callable
from functools import cache
from importlib import resources
from typing import Any, NamedTuple

import numpy as np

FEATURES, HIDDEN = 19, 8
Judge = Callable[[Any], Any]
"""Features of n blocks, float32 [F, n], to what is added to their score, float32 [n]."""


class Offer(NamedTuple):
    """n blocks on offer, each of one row, for the space of one lane."""

    row: Any  # int32 [n]
    lane: Any  # int32 [n]
    grid: Any  # int32 [3, n], items along each axis
    extent: Any  # int32 [3, n], units
    gap: Any  # int32 [3, n], of the space that is left beside it
    spoiled: Any  # float32 [3, n], of the gap, what no sum of edges fills


class Weights(NamedTuple):
    """Of a network with one hidden layer."""

    hidden: Any  # float32 [F, HIDDEN]
    bias: Any  # float32 [HIDDEN]
    out: Any  # float32 [HIDDEN]


def features(xp: Any, goods: Any, now: Any, space: Any, offer: Offer) -> Any:
    """What is seen of every block: float32 [F, n], most of it in [0, 1]."""
    row, lane = offer.row, offer.lane
    kind = row // (goods.side.shape[1] // len(goods.count))
    sides = xp.maximum(space.high - space.low, 1).astype(np.float32)  # [3, P]
    room = goods.room.astype(np.float32)
    share = offer.extent.astype(np.float32) / sides[:, lane]
    number = xp.maximum(offer.grid.prod(0), 1).astype(np.float32)
    left = xp.maximum(now.left, 1)[kind, lane].astype(np.float32)
    one = goods.side[:, row, lane].astype(np.float32).prod(0) / room.prod(0)[lane]
    whole = (space.carried.astype(np.float32) / sides[:2]).prod(0)
    low = space.low[2].astype(np.float32) / room[2]
    of_space = xp.stack([*(sides / room), low, whole, (sides / room).prod(0)])
    return xp.concatenate(
        [
            share,
            offer.gap.astype(np.float32) / sides[:, lane],
            offer.spoiled / sides[:, lane],
            xp.stack([share.prod(0), number / left, 1 / number, xp.sqrt(xp.sqrt(one))]),
            of_space[:, lane],
        ]
    )


def score(xp: Any, weights: Weights, seen: Any) -> Any:
    """What the policy adds for blocks of which it sees so much: float32 [n]."""
    inner = xp.maximum(weights.hidden.T @ seen + weights.bias[:, None], 0)
    return weights.out @ inner


@cache
def shipped() -> Judge:
    """The policy of the package, for NumPy's arrays."""
    record = json.loads((resources.files("jaxpack") / "weights" / "blocks.json").read_text())
    weights = Weights(*(np.array(record[name], np.float32) for name in Weights._fields))
    return lambda seen: score(np, weights, seen)
