"""One bin after the other by rules of their own, each drawn several times: the best is taken.

A draw fills a bin of some type in a random order, by some size and what items are worth, turned at
random. What is in bins that are not well filled is worth more in the next pass.
"""

from collections.abc import Iterator

import numpy as np

from jaxpack.model.encoding import Genes, Loading, lane_genes
from jaxpack.search.ruled import Packing, Stop

DRAWS = (2, 4, 8, 16)  # of a bin, in the first passes and in all that follow
NOISE = 0.3  # at most on what items count
PASSES = 16  # after which the values begin anew

Filled = tuple[Genes, np.ndarray, np.ndarray]
"""As `pack_by_rules` has it."""


def draw_bins(loading: Loading, seed: int, stop: Stop) -> Iterator[Filled | None]:
    """Packings again and again, until `stop` says so: None then.

    Args:
        loading: what is packed.
        seed: of the draws.
        stop: asked before every placement.
    """
    random, number = np.random.default_rng([seed, 4]), 0
    while True:
        if number % PASSES == 0:
            value = _first_values(loading)
        draws = _Draws(loading, random, value, stop)
        draws.run(DRAWS[min(number, len(DRAWS) - 1)])
        yield None if stop() else draws.found()
        value = draws.charged()
        number += 1


def _first_values(loading: Loading) -> np.ndarray:
    """float64 [N], by profit where that is what counts, or else by volume."""
    profit = loading.stock.profit.astype(np.float64)
    return profit if profit.any() else loading.stock.sizes[:, 0].prod(1, dtype=np.float64)


class _Draws:
    """One pass."""

    def __init__(
        self, loading: Loading, random: np.random.Generator, value: np.ndarray, stop: Stop
    ) -> None:
        self.loading, self.random, self.value, self.stop = loading, random, value, stop
        N = len(loading.items)
        first = lane_genes(loading, 0, 0)
        self.packing = Packing(loading, first, stop, to_end=False)
        self.turn, self.slots = first.turn.copy(), first.pool
        self.bin, self.corner = np.full(N, -1, np.int32), np.zeros((N, 3), np.int32)
        self.order = list[np.ndarray]()
        self.size = np.sort(loading.stock.sizes[:, 0].astype(np.float64), 1)
        self.worth = value.copy()
        self.stacks = len(np.unique(loading.asked.stack_id)) > 1

    def run(self, draws: int) -> None:
        """Fills bins until nothing waits, or nothing fits."""
        packing, kind = self.packing, self.loading.bins
        free = {int(n): list(np.flatnonzero(kind == n)[::-1]) for n in np.unique(kind)}
        while len(packing.waiting) and free and not self.stop():
            best, waiting = None, packing.waiting
            types = self.random.permutation(list(free)).tolist()
            for draw in range(max(draws, len(types))):
                slot = int(free[types[draw % len(types)]][-1])
                packing.waiting = waiting
                self._shuffle(draw)
                rows, corners = packing.fill(slot)
                gain = self.value[rows].sum() / max(float(self.loading.stock.price[slot]), 1e-9)
                if len(rows) and (best is None or gain > best[0]):
                    best = gain, slot, rows, corners, packing.turn[rows]
            packing.waiting = waiting
            if best is None:
                return
            _, slot, rows, corners, turn = best
            packing.take(rows)
            self._keep(slot, rows, corners, turn)
            of_type = free[int(kind[slot])]
            of_type.pop()
            if not of_type:
                del free[int(kind[slot])]

    def found(self) -> Filled:
        """What was packed."""
        order = np.concatenate([*self.order, self.packing.waiting]).astype(np.int32)
        used = np.unique(self.bin[self.bin >= 0])
        pool = np.concatenate([used, np.setdiff1d(self.slots, used)])
        return Genes(order, self.turn, pool.astype(np.int32)), self.bin, self.corner

    def charged(self) -> np.ndarray:
        """float64 [N], the values with what the bins charged, alike for all copies of an item."""
        sums = np.bincount(self.loading.items, self.worth)
        means = sums / np.maximum(np.bincount(self.loading.items), 1)
        return means[self.loading.items]

    def _shuffle(self, draw: int) -> None:
        """Another order and other orientations of what waits, copies of an item together."""
        random, loading, packing = self.random, self.loading, self.packing
        waiting, kinds = packing.waiting, len(loading.job.items)
        key = (
            self.value,
            self.size[:, 1] * self.size[:, 2],
            self.size[:, 2],
            self.size[:, 1],
        )[random.integers(4)]
        noise = np.exp(NOISE * random.random() * random.standard_normal(kinds))
        share = random.random(kinds)[loading.items]
        packing.turn[:] = (share * loading.stock.ways).astype(np.int32)
        place = np.argsort(-(key * noise[loading.items])[waiting], kind="stable")
        if draw % 2 == 0:
            layer = loading.asked.layer[loading.items[waiting[place]]]
            place = place[np.argsort(layer, kind="stable")]
        packing.stacking = self.stacks and self.random.random() < 0.5
        packing.arrange(place)

    def _keep(self, slot: int, rows: np.ndarray, corners: np.ndarray, turn: np.ndarray) -> None:
        stock = self.loading.stock
        self.bin[rows], self.corner[rows], self.turn[rows] = slot, corners, turn
        self.order.append(rows)
        room = stock.bins[slot].prod(dtype=np.float64)
        held = stock.sizes[rows, 0].prod(dtype=np.float64, axis=1).sum()
        self.worth[rows] *= (1 + min(room / held, 4.0)) / 2
