"""A job as the arrays that packers work on, and a packing as a plan."""

import math
from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from jaxpack.errors import UserError
from jaxpack.model.asked import Asked, asked_of
from jaxpack.model.bands import by_band
from jaxpack.model.hints import apart_message, unfit_message
from jaxpack.model.job import ORIENTATIONS, ItemType, Job, PackedBin, Placement, Plan, Sides
from jaxpack.model.objectives import Objective, objective_of
from jaxpack.model.places import beside_obstacles, room_of
from jaxpack.model.prices import bin_prices, item_profits
from jaxpack.model.rules import Rules
from jaxpack.model.shelves import fits_one_bin
from jaxpack.model.sorts import SORTS
from jaxpack.model.units import Units, in_units, units_of

NARROW = 46_340  # units a side, of which areas fit int32
LITTLE = {"footprint": 1e-6, "height": 1e-9}  # what the second key of a sort counts beside noise
MOST_ITEMS, MOST_TOGETHER = 4_096, 512  # of a job and of a bin, see `compiles`


class Stock(NamedTuple):
    """A job for a packer. K is the number of orientations, S of bins that may be opened."""

    sizes: Any  # int32 [N, K, 3], units, turned in every allowed way; the last one repeated
    needed: Any  # int32 or int64 [N, K], area of the footprint that must be carried
    ways: Any  # int32 [N], how many of the K differ
    weight: Any  # int32 or int64 [N]
    mask: Any  # bool [N], False for padding, which stands last
    bins: Any  # int32 [S, 3], units
    limit: Any  # like weight [S]; the largest number of its type: no limit
    price: Any  # float32 [S], about 1: what is minimised first, and a little of what comes next
    profit: Any  # float32 [N], share of what the bins can hold; 0 where the objective has none
    penalty: Any  # float32[], more than any packing costs: for leaving something out
    step: Any  # int32[], units: corners along x and y are multiples of it


class Genes(NamedTuple):
    """What a packer is told; P lanes side by side, or none of that axis."""

    order: Any  # int32 [P, N]
    turn: Any  # int32 [P, N], orientation of every item
    pool: Any  # int32 [P, S], sequence of the bins


@dataclass(frozen=True)
class Loading:
    """A job for a packer, and what its rows stand for."""

    job: Job  # as packers see it, where its costs count: see `by_band`
    given: Job  # as it is
    whose: tuple[int, ...]  # index in its bins of every one of the job's
    objective: Objective
    units: Units
    rules: Rules
    stock: Stock  # of NumPy, without padding
    items: np.ndarray  # int [N], index in Job.items of every row, ascending
    ways: tuple[tuple[str, ...], ...]  # of every row of Job.items, those that fit some bin
    bins: np.ndarray  # int [S], index in Job.bins of every row
    unfit: tuple[int, ...]  # index in Job.items of every copy that no bin can hold

    @property
    def by_load(self) -> bool:
        """Whether what is minimised depends on what is in each bin."""
        return self.job is not self.given

    @cached_property
    def first(self) -> np.ndarray:
        """Of each type of bins that there are a row: int [T]."""
        return np.unique(self.bins, return_index=True)[1]

    @property
    def flat(self) -> bool:
        """2D."""
        return self.job.dimension == 2

    @property
    def ruled(self) -> bool:
        """Whether more is asked than that bins hold their items, which are carried."""
        return self.job.limited or not self.rules.plain

    @cached_property
    def asked(self) -> Asked:
        """What that is."""
        return asked_of(self.job, self.rules, self.units.length)

    @cached_property
    def groups(self) -> frozenset[int]:
        """Those of `Asked.group` of which it is certain that all items fit one bin."""
        members = defaultdict[int, list[int]](list)
        for number, (code, item) in enumerate(zip(self.asked.group, self.job.items, strict=True)):
            members[int(code)] += [number] * (item.copies > 0)
        kinds = [kind for kind in self.job.bins if kind.copies != 0]
        return frozenset(
            code
            for code, items in members.items()
            if code >= 0 and any(fits_one_bin(self.job, items, kind, self.rules) for kind in kinds)
        )


def load_job(
    job: Job, rules: Rules = Rules(), resolution: float | None = None, skip_unfit: bool = False
) -> Loading:
    """The job for a packer.

    Raises:
        UserError: naming the items that no bin can hold, or more of them that are to be apart than
            there are bins, unless items may be skipped.
    """
    objective = objective_of(job)
    given = job = objective.prepared(job, rules)
    whose = tuple(range(len(job.bins)))
    if job.by_load and "cost" in objective.parts:
        job, whose = by_band(job)
    units = units_of(job, resolution, rules)
    ways = fitting_ways(job, rules)
    unfit = [n for n, some in enumerate(ways) if not some and job.items[n].copies]
    fit = [n for n, some in enumerate(ways) if some and job.items[n].copies]
    skip_unfit = skip_unfit or objective.leaves_out
    if unfit and (not skip_unfit or not fit):
        raise UserError(unfit_message(job, unfit, skip_unfit))
    if not skip_unfit and (message := apart_message(job)):
        raise UserError(message)
    left_out = tuple(n for n in unfit for _ in range(job.items[n].copies))
    items = np.repeat(fit, [job.items[n].copies for n in fit])
    copies = [
        len(items) if kind.copies is None else min(kind.copies, len(items)) for kind in job.bins
    ]
    bins = np.repeat(np.arange(len(job.bins)), copies)
    stock = _stock(job, units, rules, ways, items, bins)
    return Loading(job, given, whose, objective, units, rules, stock, items, ways, bins, left_out)


def fitting_ways(job: Job, rules: Rules = Rules()) -> tuple[tuple[str, ...], ...]:
    """For every item type the orientations in which some bin can hold it, none if none can."""
    able = [(kind, room_of(kind, rules, job.dimension)) for kind in job.bins if kind.copies != 0]

    def ways(item: ItemType) -> tuple[str, ...]:
        kinds = [one for one in able if item.weight <= one[0].max_weight]
        # Of ways that come to the same, as with two equal sides, the first.
        first: dict[Sides, str] = {}
        for way in item.orientations:
            first.setdefault(item.turned(way), way)
        return tuple(
            way
            for (x, y, z), way in first.items()
            if any(
                x <= a
                and y <= b
                and z <= c
                and beside_obstacles(kind, (x, y, z), rules, job.dimension, item.limits.floor)
                for kind, (a, b, c) in kinds
            )
        )

    return tuple(map(ways, job.items))


def plan_of(
    loading: Loading,
    order: np.ndarray,
    turn: np.ndarray,
    bin: np.ndarray,
    corner: np.ndarray,
    types: dict[int, int],
) -> Plan:
    """A packing in the user's units: of the job that was given.

    Args:
        loading: what was packed.
        order: of one lane.
        turn, bin, corner: by row of the stock.
        types: index of `Stock.bins` -> index in `loading.job.bins`, of the bins that are used.
    """
    top, bottom = loading.units.length.as_integer_ratio()
    length = {n: n * top / bottom for n in set(corner.ravel().tolist())}
    packed: dict[int, list[Placement]] = {}
    left_out = list(loading.unfit)
    rows = zip(
        loading.items[order].tolist(), turn[order].tolist(), bin[order].tolist(),
        corner[order].tolist(), strict=True,
    )  # fmt: skip
    for item, way, slot, (x, y, z) in rows:
        if slot < 0:
            left_out.append(item)
            continue
        place = Placement(item, loading.ways[item][way], (length[x], length[y], length[z]))
        packed.setdefault(slot, []).append(place)
    levels: dict[int, float | None] = {}
    if loading.objective.open_bin:
        ends = corner[:, 2] + loading.stock.sizes[np.arange(len(turn)), turn, 2]
        levels = {s: int(ends[bin == s].max()) * top / bottom for s in packed}
    inside = [
        PackedBin(loading.whose[types[slot]], tuple(items), levels.get(slot))
        for slot, items in packed.items()
    ]
    return Plan(tuple(inside), tuple(left_out))


def lane_genes(loading: Loading, seed: int, lane: int) -> Genes:
    """One of the sorts, with one of the ways to turn the items; the later the more noise. Half of
    them begin with what carries most, where a job asks for that.

    Bins: by price per volume, which comes first, or by price; or one type before the others (a lane
    for each).
    """
    random = np.random.default_rng([seed, lane])
    stock = loading.stock
    sizes = stock.sizes.astype(np.float64)
    N, K = sizes.shape[:2]
    height = np.where(np.arange(K) < stock.ways[:, None], sizes[..., 2], np.nan)
    if lane % 12 == 9:  # so that a bin holds most of its like
        alike = (stock.bins[0] // stock.sizes).astype(np.float64).prod(2)
        turn = np.where(np.arange(K) < stock.ways[:, None], alike, -1).argmax(1)
    elif lane % 12 > 9:  # turned alike if they are alike: a random way of every kind
        share = random.random(len(loading.job.items))
        turn = (share[loading.items] * stock.ways).astype(np.int64)
    else:  # as given, lying flat, standing
        turn = (np.zeros(N, np.int64), np.nanargmin(height, 1), np.nanargmax(height, 1))[lane % 3]
    side = sizes[np.arange(N), turn]
    name = list(SORTS)[lane // 3 % 4]
    first, *others = SORTS[name](*side.T)
    key = first + sum(LITTLE[name] * other for other in others)
    noise = 1 + (lane // 12) * 0.15 * random.standard_normal(len(loading.job.items))
    order = np.argsort(-key * noise[loading.items], kind="stable")
    if loading.ruled and lane % 4 in (0, 3):
        order = order[np.argsort(loading.asked.layer[loading.items[order]], kind="stable")]
    rooms = stock.bins.astype(np.float64).prod(1)
    worth = (stock.price / rooms, stock.price)[lane % 2]
    kinds = len(loading.job.bins)
    pool = np.lexsort((worth, loading.bins != (lane - 1) % (kinds + 1)))
    return Genes(*(rows.astype(np.int32) for rows in (order, turn, pool)))


def padded(stock: Stock, items: int, bins: int) -> Stock:
    """The stock filled up to so many rows of items and bins."""

    def rows(values: np.ndarray, count: int, empty: int) -> np.ndarray:
        padding = np.full((count - len(values), *values.shape[1:]), empty, values.dtype)
        return np.concatenate([values, padding])

    return stock._replace(
        sizes=rows(stock.sizes, items, 1),
        needed=rows(stock.needed, items, 1),
        ways=rows(stock.ways, items, 1),
        weight=rows(stock.weight, items, 0),
        mask=rows(stock.mask, items, 0),
        bins=rows(stock.bins, bins, 0),
        limit=rows(stock.limit, bins, 0),
        price=rows(stock.price, bins, 0),
        profit=rows(stock.profit, items, 0),
    )


def padded_genes(genes: Genes, items: int, bins: int) -> Genes:
    """Genes of one lane for a padded stock: what was added comes last."""
    return Genes(
        np.concatenate([genes.order, np.arange(len(genes.order), items, dtype=np.int32)]),
        np.concatenate([genes.turn, np.zeros(items - len(genes.turn), np.int32)]),
        np.concatenate([genes.pool, np.arange(len(genes.pool), bins, dtype=np.int32)]),
    )


def compiles(loading: Loading) -> bool:
    """Whether there is a compiled search for the job: for one of not very many items, in all and in
    a bin, whose time and memory grow with the square of it, and without rules of its own.
    """
    if loading.ruled:
        return False
    most = MOST_ITEMS if loading.flat else MOST_TOGETHER
    return len(loading.items) <= MOST_ITEMS and most_together(loading.stock) <= most


def most_together(stock: Stock) -> int:
    """A number of items that no bin holds more of."""
    volumes = np.sort(stock.sizes[:, 0].astype(np.float64).prod(1))
    largest = stock.bins.astype(np.float64).prod(1).max() * (1 + 1e-9)
    return max(1, int((np.cumsum(volumes) <= largest).sum()))


def _stock(
    job: Job,
    units: Units,
    rules: Rules,
    ways: tuple[tuple[str, ...], ...],
    items: np.ndarray,
    bins: np.ndarray,
) -> Stock:
    orientations = max(map(len, ways))
    orientations = 2 if orientations == 2 else 6 if orientations > 2 else 1  # few programs
    rooms = _lengths(job, units, [kind.size for kind in job.bins])
    # What fits no bin may be longer than any number that a packer takes, and is not among its rows.
    size = np.minimum(_lengths(job, units, [item.size for item in job.items]), np.int32(2**31 - 1))
    area = np.int32 if rooms[:, :2].max() <= NARROW else np.int64
    turned, needed = [], []
    for sides, allowed in zip(size.tolist(), ways, strict=True):
        rows = [[sides[side] for side in ORIENTATIONS[way]] for way in allowed] or [[1, 1, 1]]
        rows += [rows[-1]] * (orientations - len(rows))
        turned.append(rows)
        needed.append([rules.area_needed(x * y) for x, y, _ in rows])
    weight, limit = _weights(job, units)
    price = bin_prices(job, items)
    counts = np.asarray([len(some) for some in ways], np.int32)
    dearest = np.sort(price[bins])[-len(items) :]
    return Stock(
        sizes=np.array(turned, np.int32)[items],
        needed=np.array(needed, area)[items],
        ways=counts[items],
        weight=weight[items],
        mask=np.ones(len(items), bool),
        bins=rooms[bins].astype(np.int32),
        limit=limit[bins],
        price=price[bins].astype(np.float32),
        profit=item_profits(job)[items],
        penalty=np.float32(2 + 2 * dearest.sum()),
        step=np.int32(units.step),
    )


def _lengths(job: Job, units: Units, sizes: list[Sides]) -> np.ndarray:
    """int64 [n, 3], units; of 2D everything is as deep as the bin, whatever the unit."""
    flat = [side for size in sizes for side in ((size[0], size[2]) if job.dimension == 2 else size)]
    whole = in_units(flat, units.length).reshape(len(sizes), -1)
    return np.insert(whole, 1, 1, axis=1) if job.dimension == 2 else whole


def _weights(job: Job, units: Units) -> tuple[np.ndarray, np.ndarray]:
    """Of items and bins, units; an item that is too heavy for every limit weighs one unit more."""
    limited = [kind.max_weight for kind in job.bins if math.isfinite(kind.max_weight)]
    if not limited:
        nothing = np.zeros(len(job.items), np.int32)
        return nothing, np.full(len(job.bins), np.iinfo(np.int32).max, np.int32)
    most = int(in_units([max(limited)], units.weight)[0])
    kind = np.int32 if most < 2**30 else np.int64
    weights = [min(item.weight, max(limited)) for item in job.items]
    whole = in_units(weights, units.weight)
    whole += np.asarray([item.weight > max(limited) for item in job.items])
    limits = np.full(len(job.bins), np.iinfo(kind).max, kind)
    bounded = np.isfinite([one.max_weight for one in job.bins])
    limits[bounded] = in_units(limited, units.weight)
    return whole.astype(kind), limits
