"""Empties bins of a packing into the others: fills these anew with what they hold and those held.

Some bins are dissolved. In a round many of the others are filled by value, each in a few lanes, out
of what is in it and what is left over; it is filled so for good where less of worth is left over
then. What stays left over becomes worth more (as in guided ejection search; Nagata and Braysy,
2009), until a bin holds it all that costs less than the dissolved ones, or nothing is left. After
some rounds in vain such a bin is opened for a part of it, and where none is cheap enough, others
are dissolved. Merging bins, emptying the least full one and packing several into fewer or cheaper
ones are all of this kind.
"""

from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from jaxpack.search.beam import Asked
from jaxpack.search.draws import by_size, drawn, filled_lane
from jaxpack.search.filling import Filling
from jaxpack.search.fillings import Filled, Kinds
from jaxpack.search.local_search import Best
from jaxpack.search.quick import Stop

DISSOLVED = (1, 2, 2, 3)  # bins at once, drawn from these
UNEVEN = 0.5  # noise at most on how full a bin is; the least full ones are dissolved
LANES, FEWEST = 256, 8  # of a round, and of a bin at least
PATIENCE = 16  # rounds after which a bin is opened, or others are dissolved
DEARER = 1.2  # by this factor becomes what a round leaves over
EQUAL = 1e-6  # prices that differ by less are the same


def filled_bins(kinds: Kinds, best: Best) -> list[Filled]:
    """The bins of a packing, every item a block of its own, from low to high."""
    types = np.searchsorted(kinds.loading.bins[kinds.bins], kinds.loading.bins)
    bins = []
    for slot in np.unique(best.bin[best.bin >= 0]).tolist():
        rows = np.flatnonzero(best.bin == slot)
        rows = rows[np.argsort(best.corner[rows, 2], kind="stable")]
        held = np.bincount(kinds.rows[rows], minlength=len(kinds.count)).astype(np.int32)
        row = kinds.rows[rows] * kinds.ways + best.genes.turn[rows]
        grid = np.ones((3, len(rows)), np.int32)
        bins.append(Filled(int(types[slot]), held, row, grid, best.corner[rows].T))
    return bins


class _Lanes(NamedTuple):
    """What a round filled, Z lanes for each of some bins and then for a new one."""

    done: Filling
    which: np.ndarray  # int [K, P], kinds
    types: np.ndarray  # int [P], of the bins
    swapped: np.ndarray  # bool [P]
    worth: np.ndarray  # float [P], of what came in


class Between:
    """A packing whose bins are emptied one after the other."""

    def __init__(self, kinds: Kinds, random: np.random.Generator) -> None:
        self.kinds, self.random = kinds, random
        self.price = kinds.loading.stock.price[kinds.bins].astype(float)
        self.bins = list[Filled]()  # the best packing
        self.kept = list[Filled]()  # without those that are dissolved
        self.left = 0 * kinds.count  # int32 [K], what no bin holds
        self.value, self.budget, self.idle = by_size(kinds), 0.0, 0

    def begin(self, bins: list[Filled]) -> None:
        """With a packing of everything, or of less, which stays as it is."""
        self.bins = [one._replace(times=1) for one in bins for _ in range(one.times)]
        self._dissolve()

    def price_of(self, bins: list[Filled]) -> float:
        """Of bins together."""
        return float(sum(self.price[one.type] for one in bins))

    def round(self, stop: Stop) -> Generator[Asked, Filling, list[Filled]]:
        """Fills some of the bins anew, which may make `bins` cheaper; all fillings worth keeping.

        Args:
            stop: asked all the time; what it cuts off is lost.
        """
        some, types = self._chosen()
        if not some and not len(types):
            self._dissolve()
            return []
        lanes = yield from self._fill(some, types)
        if stop():
            return []
        P = len(lanes.types)
        each = P // (len(some) + (len(types) > 0))
        full = np.flatnonzero(~(lanes.done.left > 0).any(0) & (np.arange(P) >= each * len(some)))
        if len(full):
            last = self._filled(lanes, int(full[self.price[lanes.types[full]].argmin()]))
            self.begin([*self.kept, last])
            return [last]
        firsts = range(0, each * len(some), each)
        best = np.array([n + lanes.worth[n : n + each].argmax() for n in firsts], int)
        gains = lanes.worth[best] - [self.kept[n].held @ self.value for n in some]
        made = []
        for n in np.argsort(-gains, kind="stable").tolist():
            one, before = self._filled(lanes, int(best[n])), self.kept[some[n]]
            made.append(one)
            left = self.left + before.held - one.held
            if gains[n] >= 0 and (left >= 0).all():  # nobody took of it before
                self.left, self.kept[some[n]] = left, one
        self.value[self.left > 0] *= DEARER
        self.idle += 1
        if not self.left.any():
            self.begin(self.kept)
        elif self.idle > PATIENCE and len(types):
            worth = lanes.worth[each * len(some) :] / self.price[lanes.types[each * len(some) :]]
            made.append(self._filled(lanes, each * len(some) + int(worth.argmax())))
            self._open(made[-1])
        elif self.idle > PATIENCE:
            self._dissolve()
        return made

    def _open(self, one: Filled) -> None:
        """A new bin, if what is left over has all that is in it."""
        if one.held.any() and (one.held <= self.left).all():
            self.kept.append(one)
            self.left = self.left - one.held
            self.budget -= self.price[one.type]
            self.idle = 0

    def _dissolve(self) -> None:
        kinds, random = self.kinds, self.random
        volume = np.array([one.held @ kinds.size for one in self.bins])
        noise = UNEVEN * random.random() * random.standard_normal(len(volume))
        order = np.argsort(volume / volume.max(initial=1e-9) + noise)
        gone = set(order[: int(random.choice(DISSOLVED))].tolist())
        self.kept = [one for n, one in enumerate(self.bins) if n not in gone]
        self.left = sum((self.bins[n].held for n in gone), 0 * kinds.count)
        self.budget = self.price_of(self.bins) - self.price_of(self.kept) - EQUAL
        self.value, self.idle = by_size(kinds), 0

    def _chosen(self) -> tuple[list[int], np.ndarray]:
        """(which bins to fill anew, types that a new one for what is left over may have)."""
        used = np.bincount([one.type for one in self.kept], minlength=len(self.price))
        types = np.flatnonzero((self.price < self.budget) & (used < self.kinds.there))
        most = LANES // FEWEST - 1
        return self.random.permutation(len(self.kept))[:most].tolist(), types

    def _fill(self, some: list[int], types: np.ndarray) -> Generator[Asked, Filling, _Lanes]:
        kinds, random = self.kinds, self.random
        counts = [self.left + self.kept[n].held for n in some] + [self.left] * (len(types) > 0)
        count = np.array(counts)  # [G, K]
        Z = LANES // len(count)
        group, draw = np.divmod(np.arange(len(count) * Z), Z)
        most = int((count > 0).sum(1).max())
        which = np.argsort(count == 0, 1, kind="stable")[:, :most]
        left = np.take_along_axis(count, which, 1)[group].T
        which = np.where(left > 0, which[group].T, -1)
        of = np.repeat([self.kept[n].type for n in some], Z).astype(int)
        if len(types):
            of = np.append(of, random.choice(types, Z))
        value = np.where(left > 0, self.value[which], 0)
        sums = np.concatenate([kinds.sums(row) for row in count])
        goods, swapped = drawn(kinds, which, value, left, of, sums, group, draw, random)
        done = yield Asked(kinds, goods)
        return _Lanes(done, which, of, swapped, ((left - done.left) * value).sum(0))

    def _filled(self, lanes: _Lanes, lane: int) -> Filled:
        return filled_lane(
            self.kinds, lanes.done, lane, lanes.which[:, lane], int(lanes.types[lane]),
            bool(lanes.swapped[lane]),
        )  # fmt: skip
