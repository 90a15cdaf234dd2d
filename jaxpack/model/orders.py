"""Orders of customers as instances: the items of each, in whole units, and the bin they go into."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.errors import UserError
from jaxpack.model.encoding import Loading, fitting_ways, load_job, most_together
from jaxpack.model.job import BinType, Job
from jaxpack.model.problem import Instance, Problem, check_bin
from jaxpack.model.rules import Rules
from jaxpack.model.units import common


class Goods(NamedTuple):
    """What the orders are made of. U is the number of distinct items, K of orientations."""

    turned: np.ndarray  # int16 [U, K, 3], units, in every allowed way that fits; repeated up to K
    rows: (
        np.ndarray
    )  # int32 [orders, N], index along U of every item; -1 for padding, which is last


NOTHING = Goods(np.zeros((0, 1, 3), np.int16), np.zeros((0, 0), np.int32))


@dataclass(frozen=True)
class OrderFiles:
    """Where orders come from, and how they are read."""

    orders: str  # path of the items
    bins: str | None = None  # path of the bins, None where the orders name theirs
    bin_type: str = ""  # name or row of the one that is used; "" where there is one
    ignore: tuple[str, ...] = ()  # columns left out of account
    skip_unfit: bool = False  # leave out the items that the bin cannot hold


@dataclass(frozen=True)
class Orders:
    """The orders of a file as a distribution; see `jaxpack.model.instances.Source`.

    Two are equal where their files and the digest of what was in them are: no array is compared.
    """

    files: OrderFiles
    digest: str  # of the bin and the goods
    bin: tuple[int, int, int]  # units
    most: int  # items, of which no bin holds more
    goods: Goods = field(default=NOTHING, compare=False, repr=False)
    """What was read; nothing in the recipe of a policy, which needs none of it."""
    surface: ClassVar[str] = "faces"

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.goods.rows)

    @property
    def items(self) -> int:
        """N: those of the longest order."""
        return self.goods.rows.shape[1]

    @property
    def low(self) -> int:
        """The shortest side of an item, units."""
        axes = self.problem().axes
        return int(self.goods.turned[..., axes].min())

    @property
    def high(self) -> int:
        """The longest one."""
        return int(self.goods.turned.max())

    @property
    def numbers(self) -> Any:
        """See `Source.numbers`."""
        return self.goods

    def problem(self) -> Problem:
        """The rules of `jaxpack.solve` for the bin."""
        rules = Rules()
        return Problem(
            self.bin,
            support=rules.support,
            inclusive=rules.inclusive,
            surface=self.surface,
            most=self.most,
            stability=rules.stability,
        )

    def kinds(self, problem: Problem) -> int:
        """K: the most distinct items that an order has."""
        return max(len(np.unique(row[row >= 0])) for row in self.goods.rows)

    def check_fits(self, bin: tuple[int, int, int]) -> None:
        """Raises UserError where the bin is not that of the orders."""
        if bin != self.bin:
            raise UserError(f"bin {bin}: the orders of {self.files.orders} are for {self.bin}")

    def draw(self, problem: Problem, key: Array) -> Instance:
        """One of the orders, all equally probable."""
        index = jax.random.randint(key, (), 0, self.count)
        return self.make(problem, self.items, key, index, self.goods, problem.bin)

    @staticmethod
    def make(
        problem: Problem, slots: int, key: Array, index: Array, numbers: Any, bin: Any
    ) -> Instance:
        """The order with this index, whatever the key."""
        turned, rows = jax.tree.map(jnp.asarray, numbers)
        row = jnp.pad(rows[index], (0, slots - rows.shape[1]), constant_values=-1)
        mask = row >= 0
        ways = jnp.where(mask[:, None, None], turned[row].astype(jnp.int32), 1)
        choice = ways if ways.shape[1] > 1 else None
        return Instance(ways[:, 0], mask, jnp.asarray(bin, jnp.int32), choice)


def orders_of(jobs: Sequence[Job], files: OrderFiles) -> Orders:
    """The orders in the coarsest unit in which all their sides are whole.

    Args:
        jobs: the orders, all with one and the same type of bins.
        files: where they come from, for messages.

    Raises:
        UserError: naming the order where an item fits no bin in an orientation that is allowed, or
            a bin is too long in units.
    """
    loadings = [loading for job in jobs if (loading := _loaded(job, files))]
    if not loadings:
        raise UserError(f"{files.orders}: no order has an item that the bin can hold")
    unit = common([one.units.length for one in loadings])
    flat = loadings[0].flat
    scales = [int(one.units.length / unit) for one in loadings]
    sides = [np.array([scale, 1 if flat else scale, scale]) for scale in scales]
    length, width, height = (loadings[0].stock.bins[0] * sides[0]).tolist()
    bin = length, width, height
    try:
        check_bin(bin, Orders.surface)
    except UserError as error:
        what = f"in units of {float(unit):g}, of which every side is a multiple: {error}"
        raise UserError(f"{files.bins or files.orders}: {what}") from None
    ways = max(one.stock.sizes.shape[1] for one in loadings)
    turned = []
    for one, scale in zip(loadings, sides, strict=True):
        last = np.minimum(np.arange(ways), one.stock.sizes.shape[1] - 1)
        turned.append((one.stock.sizes * scale)[:, last].reshape(-1, ways * 3))
    distinct, which = np.unique(np.concatenate(turned), axis=0, return_inverse=True)
    counts = [len(part) for part in turned]
    rows = np.full((len(turned), max(counts)), -1, np.int32)
    rows[np.arange(max(counts)) < np.array(counts)[:, None]] = which.ravel()
    goods = Goods(distinct.reshape(-1, ways, 3).astype(np.int16), rows)
    digest = hashlib.sha256(repr((bin, ways, rows.shape)).encode())
    for leaf in goods:
        digest.update(leaf.tobytes())
    most = max(most_together(one.stock) for one in loadings)
    return Orders(files, digest.hexdigest()[:16], bin, most, goods)


def _loaded(job: Job, files: OrderFiles) -> Loading | None:
    """None where nothing is left of it."""
    if files.skip_unfit and not any(
        ways and item.copies for ways, item in zip(fitting_ways(job), job.items, strict=True)
    ):
        return None
    try:
        return load_job(job, skip_unfit=files.skip_unfit)
    except UserError as error:
        raise UserError(f"{files.orders}: order '{job.name}': {error}") from None


def bin_of(jobs: Sequence[Job], files: OrderFiles) -> BinType:
    """The one type of bins that the orders are packed into.

    Raises:
        UserError: where there are several and none is picked, where the one that is picked is not
            there, or where it has a limit that instances do not have.
    """
    where, kinds = files.bins or files.orders, list(dict.fromkeys(k for j in jobs for k in j.bins))
    if any(job.limited for job in jobs):
        what = "columns of rules that instances do not have, such as STACKABLE or MAXIMUM_ITEMS"
        raise UserError(f"{where}: {what}: leave them out with --ignore, or use `jaxpack solve`")
    rows = [kind.where.split(" of ")[0].removeprefix("row ") for kind in kinds]
    called = {row: kind for row, kind in zip(rows, kinds, strict=True) if row}
    called |= {kind.name: kind for kind in reversed(kinds) if kind.name}
    names = " or ".join(k.name or row for row, k in zip(rows, kinds, strict=True))
    kind = called.get(files.bin_type) if files.bin_type else kinds[0]
    if kind is None:
        raise UserError(f"--bin-type '{files.bin_type}': {where} has {names}")
    if not files.bin_type and len(kinds) > 1:
        what = f"{len(kinds)} types of bins, of which one is used: choose {names}"
        raise UserError(f"{where}: {what} with --bin-type; `jaxpack solve` uses all")
    if kind.copies is not None:
        what = f"COPIES {kind.copies}, but instances have as many bins as they need"
        raise UserError(f"{where}: {what}: use --ignore COPIES, or `jaxpack solve`")
    limited = kind.max_weight < math.inf and any(i.weight for job in jobs for i in job.items)
    if limited:
        column = "BANDS" if kind.tariff and kind.tariff.bands else "MAXIMUM_WEIGHT"
        what = f"{column}, but instances have no weights"
        raise UserError(f"{where}: {what}: use --ignore {column}, or `jaxpack solve`")
    return kind
