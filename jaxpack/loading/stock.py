"""A job as the arrays that the kernel works on, and the kernel's layout as a plan."""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from jaxpack.errors import UserError
from jaxpack.loading.job import ORIENTATIONS, ItemType, Job, PackedBin, Placement, Plan, Sides
from jaxpack.loading.local_search import Genes, Stock
from jaxpack.loading.units import Units, in_units
from jaxpack.packing.first_fit_exact import STAGES, ExactRules


@dataclass(frozen=True)
class Loading:
    """A job for the kernel, and what its rows stand for. Padding is only in `stock`."""

    job: Job
    units: Units
    rules: ExactRules
    stock: Stock
    items: np.ndarray  # int [count], index in Job.items of every row
    ways: tuple[tuple[str, ...], ...]  # of every row of Job.items, those that fit some bin
    bins: np.ndarray  # int [S], index in Job.bins of every row


def fitting_ways(job: Job, units: Units) -> tuple[tuple[str, ...], ...]:
    """For every item type the orientations in which some bin can hold it, none if none can."""
    rooms = _rooms(job, units)

    def ways(item: ItemType) -> tuple[str, ...]:
        size = _size(job, units, item)
        able = [
            room
            for room, bin in zip(rooms, job.bins, strict=True)
            if item.weight <= bin.max_weight and bin.copies != 0
        ]
        # Of ways that come to the same, as with two equal sides, the first.
        first: dict[tuple[int, ...], str] = {}
        for way in item.orientations:
            first.setdefault(tuple(size[list(ORIENTATIONS[way])]), way)
        return tuple(
            way
            for turned, way in first.items()
            if any((np.asarray(turned) <= room).all() for room in able)
        )

    return tuple(map(ways, job.items))


def load_job(
    job: Job, units: Units, support: float, inclusive: bool, skip_unfit: bool
) -> tuple[Loading, tuple[int, ...]]:
    """The job for the kernel, and the copies (index in Job.items) that no bin can hold.

    Raises:
        UserError: naming the items that no bin can hold, unless they are to be skipped.
    """
    ways = fitting_ways(job, units)
    unfit = [number for number, some in enumerate(ways) if not some]
    if unfit and (not skip_unfit or len(unfit) == len(ways)):
        raise UserError(_unfit(job, units, unfit))
    left_out = tuple(n for n in unfit for _ in range(job.items[n].copies))
    items = np.repeat(
        [n for n, some in enumerate(ways) if some],
        [item.copies for item, some in zip(job.items, ways, strict=True) if some],
    )
    bins = np.repeat(
        np.arange(len(job.bins)),
        [len(items) if bin.copies is None else min(bin.copies, len(items)) for bin in job.bins],
    )
    stock, volumes = _stock(job, units, ways, items, bins)
    largest = float(np.asarray(stock.bins, np.float64).prod(1).max())
    most = int((np.cumsum(np.sort(volumes)) <= largest * (1 + 1e-9)).sum())
    rules = ExactRules(
        first_stage(STAGES, most) or STAGES[-1], job.dimension == 2, support, inclusive
    )
    return Loading(job, units, rules, stock, items, ways, bins), left_out


def _unfit(job: Job, units: Units, unfit: list[int]) -> str:
    """What is wrong with the first item that no bin can hold."""
    first = job.items[unfit[0]]
    called = f" ({first.name})" if first.name else ""
    others = f" and {len(unfit) - 1} more" if len(unfit) > 1 else ""
    light = replace(job, items=(replace(first, weight=0.0),))
    (ways,) = fitting_ways(light, units)
    wrong = f"no bin can hold {_sides(first.size)} in an orientation that is allowed"
    if ways:
        wrong = f"weight {first.weight:g} is over the limit of every bin that has room for it"
    return (
        f"{first.where or f'item {unfit[0]}'}{called}{others}: {wrong}; give a larger bin, or "
        "leave such items out with --skip-unfit"
    )


def plan_of(
    loading: Loading,
    order: np.ndarray,
    turn: np.ndarray,
    bin: np.ndarray,
    corner: np.ndarray,
    left_out: tuple[int, ...],
) -> Plan:
    """The kernel's layout in the user's units.

    Args:
        order, turn, bin, corner: of one lane, by row of the stock, padding included.
    """
    packed: dict[int, list[Placement]] = {}
    for row in order:
        if row >= len(loading.items):
            continue
        item, slot = int(loading.items[row]), int(bin[row])
        if slot < 0:
            left_out += (item,)
            continue
        way = loading.ways[item][turn[row]]
        x, y, z = (float(int(place) * loading.units.length) for place in corner[row])
        packed.setdefault(slot, []).append(Placement(item, way, (x, y, z)))
    bins = [PackedBin(int(loading.bins[slot]), tuple(inside)) for slot, inside in packed.items()]
    return Plan(tuple(bins), left_out)


def first_genes(loading: Loading, random: np.random.Generator, lanes: int) -> Genes:
    """The sorts with every way to turn the items, then the same with noise: leaves [lanes, ...].

    Bins: one type before the others (a lane for each), those by cost per volume or by cost.
    """
    sizes = np.asarray(loading.stock.sizes, np.float64)
    ways, mask = np.asarray(loading.stock.ways), np.asarray(loading.stock.mask)
    N, K = sizes.shape[:2]
    S = loading.stock.bins.shape[0]
    allowed = np.arange(K) < ways[:, None]
    alike = np.concatenate([loading.items, np.full(N - len(loading.items), -1)]) + 1
    height = sizes[..., 2]
    turns = (
        np.zeros(N, np.int64),
        np.where(allowed, height, np.inf).argmin(1),  # lying flat
        np.where(allowed, height, -np.inf).argmax(1),  # standing
    )
    rooms = np.asarray(loading.stock.bins, np.float64).prod(1)
    price = np.asarray(loading.stock.price)
    worth = (price / np.maximum(rooms, 1), price)
    kinds = len(loading.job.bins)
    kind = np.concatenate([loading.bins, np.full(S - len(loading.bins), -1)])
    orders, turned, pools = [], [], []
    for lane in range(lanes):
        # Turned alike if they are alike: a random way of every kind.
        turn = (
            turns[lane % 3]
            if lane % 12 < 9
            else (random.random(alike.max() + 1)[alike] * ways).astype(int)
        )
        side = sizes[np.arange(N), turn]
        length, width, tall = side.T
        keys = (
            length * width * tall,
            length * width + tall * 1e-6,
            tall + length * width * 1e-9,
            side.max(1),
        )
        key = keys[lane // 3 % 4]
        noise = 1 + (lane // 12) * 0.15 * random.standard_normal(N)
        orders.append(np.argsort(np.where(mask, -key * noise, np.inf), kind="stable"))
        turned.append(turn)
        pools.append(np.lexsort((worth[lane % 2], kind != lane % (kinds + 1), kind < 0)))
    stacks = (np.stack(rows).astype(np.int32) for rows in (orders, turned, pools))
    return Genes(*map(jnp.asarray, stacks))


def _stock(
    job: Job,
    units: Units,
    ways: tuple[tuple[str, ...], ...],
    items: np.ndarray,
    bins: np.ndarray,
) -> tuple[Stock, np.ndarray]:
    """The arrays, padded to the next size that programs are compiled for, and the volumes."""
    most = max(map(len, ways))
    padded = 2 if most == 2 else 6 if most > 2 else 1
    turned = np.ones((len(job.items), padded, 3), np.int64)
    for number, (item, allowed) in enumerate(zip(job.items, ways, strict=True)):
        size = _size(job, units, item)
        for way in range(padded if allowed else 0):
            turned[number, way] = size[list(ORIENTATIONS[allowed[min(way, len(allowed) - 1)]])]
    weights = in_units([item.weight for item in job.items], units.weight, up=True)
    rooms = _rooms(job, units)
    heaviest = np.iinfo(np.int32).max // 2
    limited = np.isfinite([bin.max_weight for bin in job.bins])
    bounded = [bin.max_weight if has else 0.0 for bin, has in zip(job.bins, limited, strict=True)]
    limits = np.where(limited, in_units(bounded, units.weight, up=False), heaviest)
    if not limited.any():
        weights[:] = 0  # in whatever unit, they may be too large for int32
    prices = np.asarray([bin.price for bin in job.bins])
    prices = prices / prices[prices > 0].min() if (prices > 0).any() else np.ones(len(prices))
    N, S = (_power_of_two(len(rows)) for rows in (items, bins))

    def padded_rows(rows: np.ndarray, count: int, empty: int) -> np.ndarray:
        padding = np.full((count - len(rows), *rows.shape[1:]), empty, rows.dtype)
        return np.concatenate([rows, padding])

    counts = np.asarray([len(some) for some in ways])
    stock = Stock(
        sizes=jnp.asarray(padded_rows(turned[items], N, 1), jnp.int32),
        ways=jnp.asarray(padded_rows(counts[items], N, 1), jnp.int32),
        weight=jnp.asarray(padded_rows(weights[items], N, 0), jnp.int32),
        mask=jnp.arange(N) < len(items),
        bins=jnp.asarray(padded_rows(rooms[bins], S, 0), jnp.int32),
        limit=jnp.asarray(padded_rows(limits[bins], S, 0), jnp.int32),
        price=jnp.asarray(padded_rows(prices[bins], S, 0), jnp.float32),
    )
    return stock, turned[items, 0].astype(np.float64).prod(1)


def _rooms(job: Job, units: Units) -> np.ndarray:
    rooms = np.asarray([in_units(bin.size, units.length, up=False) for bin in job.bins])
    if job.dimension == 2:
        rooms[:, 1] = 1  # whatever the unit, everything is as deep as the bin
    return rooms


def _size(job: Job, units: Units, item: ItemType) -> np.ndarray:
    size = in_units(item.size, units.length, up=True)
    if job.dimension == 2:
        size[1] = 1
    return size


def _power_of_two(count: int) -> int:
    return max(16, 1 << (count - 1).bit_length())


def first_stage(stages: tuple[int, ...], count: int) -> int | None:
    """The first stage that is large enough."""
    return next((stage for stage in stages if stage >= count), None)


def _sides(size: Sides) -> str:
    return " x ".join(f"{side:g}" for side in size)
