"""Fills the bins that many searches ask for side by side: one step fills one space in all of them.

What a bin of one search holds does not depend on those of others beside it.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from jaxpack.search.beam import Asked, fill
from jaxpack.search.filling import FAR, Filling, Goods
from jaxpack.search.fillings import Kinds
from jaxpack.search.quick import Stop

AT_ONCE = 2048  # lanes
Fill = Callable[[Kinds, Goods, Stop], Filling]
"""Fills bins, as `fill` does."""


def fill_together(asked: Sequence[Asked], stop: Stop, fill: Fill = fill) -> list[Filling]:
    """The bins of each of them, filled as `fill` would.

    Args:
        asked: bins to fill, of any searches.
        stop: as of `fill`.
        fill: what fills them.
    """
    alike = defaultdict[tuple, list[int]](list)
    for n, one in enumerate(asked):
        kinds = one.kinds
        alike[kinds.ways, kinds.axes, kinds.unit, kinds.firm, id(kinds.judge)].append(n)
    filled: dict[int, Filling] = {}
    for mine in alike.values():
        mine.sort(key=lambda n: len(asked[n].goods.count))  # little is padding then
        for some in _parts(mine, [len(asked[n].goods.limit) for n in mine]):
            filled |= zip(some, _filled([asked[n] for n in some], stop, fill), strict=True)
    return [filled[n] for n in range(len(asked))]


def _parts(members: list[int], lanes: list[int]) -> list[list[int]]:
    """Members in groups of not many more lanes than are filled at once."""
    group = np.cumsum([0, *lanes])[:-1] // AT_ONCE
    starts = [0, *(np.flatnonzero(np.diff(group)) + 1).tolist(), len(members)]
    return [members[a:b] for a, b in pairwise(starts)]


def _filled(asked: list[Asked], stop: Stop, fill: Fill) -> list[Filling]:
    if len(asked) == 1:
        return [fill(*asked[0], stop)]
    kinds = replace(asked[0].kinds, blocks=max(one.kinds.blocks for one in asked))
    done = fill(kinds, stacked([one.goods for one in asked]), stop)
    each, end = [], 0
    for one in asked:
        K, start = len(one.goods.count), end
        end += len(one.goods.limit)
        mine = Filling(*(leaf[..., start:end] for leaf in done))
        each.append(mine._replace(left=mine.left[:K]))
    return each


def stacked(goods: Sequence[Goods]) -> Goods:
    """The lanes of all of them beside each other; kinds that one has less are none."""
    lanes = [len(one.limit) for one in goods]
    ends = np.cumsum(lanes)
    K = max(len(one.count) for one in goods)
    ways = goods[0].side.shape[1] // len(goods[0].count)
    empty = {
        "side": np.full((3, K * ways, ends[-1]), FAR, np.int32),
        "shortest": np.full((3, K, ends[-1]), FAR, np.int32),
        "needed": np.ones((K * ways, ends[-1]), np.int32),
        "value": np.zeros((K * ways, ends[-1]), np.float32),
        "weight": np.zeros((K, ends[-1]), np.int32),
        "count": np.zeros((K, ends[-1]), np.int32),
        "less": np.zeros((3, K * ways, ends[-1]), np.int32),
    }
    tables = np.cumsum([0, *(len(one.sums) for one in goods)])
    for one, end, many in zip(goods, ends.tolist(), lanes, strict=True):
        for name, whole in empty.items():
            part = getattr(one, name)
            whole[..., : part.shape[-2], end - many : end] = part
    first = [one.first + start for one, start in zip(goods, tables.tolist(), strict=False)]
    return Goods(
        **empty,
        room=np.concatenate([one.room for one in goods], 1),
        limit=np.concatenate([one.limit for one in goods]),
        sums=np.concatenate([one.sums for one in goods]),
        first=np.concatenate(first, 1).astype(np.int32),
        unit=goods[0].unit,
        strict=np.concatenate([one.strict for one in goods]),
    )
