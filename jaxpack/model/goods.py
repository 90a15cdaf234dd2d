"""The items of a job that fit some bin as arrays of whole numbers, for what bounds compute."""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from jaxpack.model.exact import whole
from jaxpack.model.job import ORIENTATIONS, BinType, Job
from jaxpack.model.places import room_of
from jaxpack.model.rules import Rules
from jaxpack.model.sums import sums

UNLIMITED = np.iinfo(np.int64).max  # a bin without limit of its weight
MOST_PAIRS = 2**21  # rows x bins of which it is noted which fits which
MOST_GROUPS = 6
LONGEST = 2**16  # units of a side of which it is found out what the items come to
_AXES = np.array(list(ORIENTATIONS.values()))


@dataclass(frozen=True)
class Goods:
    """Items that fit some bin, and the bins; rows that are alike are one. Lengths are in one unit.

    A row has its extents in every way to turn it that fits some bin, the first of them again where
    other rows have more.
    """

    sizes: np.ndarray  # int64 [ways, rows, 3]
    copies: np.ndarray  # int64 [rows]
    weights: np.ndarray  # int64 [rows]
    kinds: tuple[BinType, ...]  # those of which there are some
    rooms: np.ndarray  # int64 [kinds, 3]
    limits: np.ndarray  # int64 [kinds], of the weight, or UNLIMITED
    fits: np.ndarray  # bool [rows, kinds]; all true where there are too many to compare
    unfit: int  # copies of the other items
    axes: tuple[int, ...]  # 2D has x and z
    unit: Fraction  # the length of one
    profits: np.ndarray  # float [rows], of one; -1 for its volume

    def groups(self) -> Iterator["Goods"]:
        """All of it, then the items that fit no other bins than some, with these bins."""
        yield self
        if self.fits.all():
            return
        # As bytes, which are soon sorted.
        _, first, of_row = np.unique(
            np.packbits(self.fits, axis=1), axis=0, return_index=True, return_inverse=True
        )
        held = np.bincount(of_row.ravel(), self.copies * self.sizes[0].astype(float).prod(1))
        for number in np.argsort(-held, kind="stable")[:MOST_GROUPS]:
            kinds = self.fits[first[number]]
            if kinds.all():
                continue
            rows = ~(self.fits & ~kinds).any(1)
            yield Goods(
                self.sizes[:, rows],
                self.copies[rows],
                self.weights[rows],
                self.kinds,
                np.where(kinds[:, None], self.rooms, 0),
                np.where(kinds, self.limits, 0),
                self.fits[rows],
                0,
                self.axes,
                self.unit,
                self.profits[rows],
            )

    def filled(self) -> np.ndarray:
        """The rooms [kinds, 3] less what no items side by side fill, where that is soon said."""
        rooms = self.rooms.copy()
        for axis in self.axes:
            longest = int(rooms[:, axis].max())
            if longest > LONGEST:
                continue
            reached = sums(self.sizes[..., axis], self.copies, longest)
            rooms[:, axis] = [
                (reached & ((2 << room) - 1)).bit_length() - 1 for room in rooms[:, axis].tolist()
            ]
        return rooms


def goods_of(job: Job) -> Goods:
    """The rows of a job that some bin can hold, and the bins."""
    kinds = tuple(kind for kind in job.bins if kind.copies != 0)
    spaces = [room_of(kind, Rules(overhang=kind.limits.overhang), job.dimension) for kind in kinds]
    rooms = np.array(spaces, float).reshape(-1, 3)
    limits = np.array([kind.max_weight for kind in kinds], float)
    sides, allowed, weight, profit, copies = _rows(job)
    turned = sides[:, _AXES].swapaxes(0, 1)
    # Of ways that come to the same, the first.
    equal = (sides[:, :, None] == sides[:, None])[:, _AXES[:, None], _AXES].all(3)
    allowed &= ~(np.tril(equal, -1) & allowed.T[:, None]).any(2).T
    ways, fits = _fitting(turned, allowed, weight, rooms, limits)
    some = ways.any(0)
    unfit = int(copies[~some].sum())
    turned, ways, fits = turned[:, some], ways[:, some], fits[some]
    first = np.take_along_axis(turned, ways.argmax(0)[None, :, None], 0)
    turned = np.where(ways[..., None], turned, first)[ways.any(1) | (not some.any())]
    holding = np.any(fits, axis=0)
    kinds = tuple(kind for kind, holds in zip(kinds, holding, strict=True) if holds)
    rooms, limits, fits = rooms[holding], limits[holding], fits[:, holding]
    lengths = np.concatenate([turned.reshape(-1, 3), rooms])
    units = np.ones(lengths.shape, np.int64)  # in 2D everything is as deep as the bin
    axes = list(job.axes)
    units[:, axes], places = whole(lengths[:, axes])
    common = max(1, int(np.gcd.reduce(units[:, axes], axis=None)))
    units[:, axes] //= common
    finite = np.isfinite(limits)
    heavy, _ = whole(np.concatenate([weight[some], np.where(finite, limits, 0.0)]))
    number = int(some.sum())
    return Goods(
        sizes=units[: turned.size // 3].reshape(turned.shape),
        copies=copies[some],
        weights=heavy[:number],
        kinds=kinds,
        rooms=units[turned.size // 3 :],
        limits=np.where(finite, heavy[number:], UNLIMITED),
        fits=fits,
        unfit=unfit,
        axes=job.axes,
        unit=Fraction(common, 10**places),
        profits=profit[some],
    )


def _rows(job: Job) -> tuple[np.ndarray, ...]:
    """Sides [n, 3], allowed orientations [6, n], weights, profits, copies [n] of different items.

    Those with no profit of their own have -1.
    """
    codes: dict[tuple[str, ...], int] = {}
    count: dict[tuple[float, ...], int] = {}
    for item in job.items:
        code = codes.setdefault(item.orientations, len(codes))
        row = *item.size, item.weight, code, -1.0 if item.profit is None else item.profit
        count[row] = count.get(row, 0) + item.copies
    different = sorted(row for row, copies in count.items() if copies)
    rows, copies = np.array(different), np.array([count[row] for row in different])
    known = np.array([[way in ways for way in ORIENTATIONS] for ways in codes])
    return rows[:, :3], known[rows[:, 4].astype(int)].T, rows[:, 3], rows[:, 5], copies


def _fitting(
    turned: np.ndarray,
    allowed: np.ndarray,
    weight: np.ndarray,
    rooms: np.ndarray,
    limits: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Which ways fit some bin [6, n], and which bins hold which rows [n, kinds]."""
    every = len(weight) * len(rooms) <= MOST_PAIRS
    ways = np.zeros(allowed.shape, bool)
    fits = np.ones((len(weight), len(rooms)), bool)
    largest = np.argsort(-rooms.prod(1))
    for some in [largest] if every else largest[:, None]:
        open_rows = slice(None) if every else np.flatnonzero((allowed & ~ways).any(0))
        inside = (turned[:, open_rows, None] <= rooms[some]).all(3) & allowed[:, open_rows, None]
        inside &= weight[open_rows, None] <= limits[some]
        ways[:, open_rows] |= inside.any(2)
        if every:
            fits[:, some] = inside.any(0)
    return ways, fits
