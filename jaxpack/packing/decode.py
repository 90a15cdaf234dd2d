"""The decoder: first fit, on any surface. Whatever chooses an order, this is what places it.

An item goes into the first bin that has an allowed position for it. Bin by bin this needs one
surface at a time: bin 0 reads the whole order and takes what fits when its turn comes, what it
leaves goes to bin 1 in the same order, and so on. The placements are the same.

A turn offers one item to one bin, in every batch member its own: none waits for another's bins.
Items that are too heavy for what is left of a limit, or too large for the volume that is still
free, are passed over without a turn, and so is what is like a refused item, or higher.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxpack.packing.rules import Rule, as_decided
from jaxpack.packing.surface import Surface, Triple
from jaxpack.xla.programs import least
from jaxpack.xla.target import target

MANY_ITEMS = 128
"""From so many on, a turn less for what would be refused is worth looking for it."""

ROUNDING = 2.0**-22  # of one sum of volumes in float32, which are rounded


class Items(NamedTuple):
    """Items turned as they are to be packed, lengths of the surface's type, a trailing batch."""

    size: Triple  # [N, B] each
    needed: Array  # integer [N, B], area of the footprint that must lie at the resting height
    waiting: Array  # bool [N, B], False for what is never packed
    weight: Array | None = None  # int32 or int64 [N, B]; None: bins are all alike, without limit
    place: Array | None = None  # int32 [N, B], see `Decisions.place`


class Bins(NamedTuple):
    """The bins, in the order in which they are filled."""

    size: Triple  # [S, B] each; or [B]: all alike, as many as there are items
    limit: Array | None = None  # [S, B], of the type of `Items.weight`; its largest: no limit


class Placed(NamedTuple):
    """Where every item went, by item, of the surface's types."""

    bin: Array  # integer [N, B], -1 for what was not packed
    corner: Triple  # [N, B] each


class _Turn(NamedTuple):
    """Between two turns. Ranks are places in the packing order, from 0; N is none."""

    state: Any  # of the surface: the bin that is filled
    room: Triple | None  # [B], its sides; of bins that are all alike None
    slot: Array  # integer [B], which bin that is
    began: Array  # bool [B], whether something lies in it
    rank: Array  # integer [B], of the item that is offered next
    item: "_Item"
    left: "_Left | None"  # of bins that have limits
    shut: Array  # bool [N, B] by item, what this bin would refuse; of few items one row of False
    bin: Array  # integer [N, B] by item, -1 while waiting, -2 for what is never packed
    corner: tuple[Array, ...]  # [N, B] each; of 2D along x and z


class _Item(NamedTuple):
    """What is offered: [B]."""

    size: Triple
    needed: Array
    weight: Array | None  # where bins have limits
    place: Array | None  # where items have places of their own


class _Left(NamedTuple):
    """What a bin can still take, where bins have limits."""

    weight: Array  # int32 or int64 [B]
    volume: Array  # float32 [B]
    items: Array  # int32 [B]
    waiting: Array  # int32 [B], items that are not packed, whatever the bin


def decode(
    surface: Surface, rule: Rule, items: Items, bins: Bins, order: Array | None = None
) -> Placed:
    """Packs the items in their order, first fit, over the bins in theirs.

    Args:
        surface: what a bin looks like.
        rule: which of the positions that are allowed an item takes.
        items: by item.
        bins: those of a batch member, in the order in which they are filled.
        order: int32 [N, B], items in packing order; where those that do not wait stand in it is
            immaterial. None: the items stand in their packing order.
    """
    if bins.limit is None:
        return _decode(surface, rule, items, bins, order)
    # Areas and weights of 64 bits are whole numbers here and nowhere else: all that touches them
    # has to be traced like this. Every other type is written out.
    with jax.enable_x64(True):
        return _decode(surface, rule, items, bins, order)


def _decode(surface: Surface, rule: Rule, items: Items, bins: Bins, order: Array | None) -> Placed:
    turns = _Turns(surface, rule, items, bins, order)
    done = jax.lax.while_loop(turns.more, turns.some, turns.start())
    x, *y, z = done.corner
    return Placed(jnp.maximum(done.bin, -1), (x, y[0] if y else jnp.zeros_like(x), z))


class _Turns:
    """The loop of the decoder, and what does not change in it."""

    def __init__(
        self, surface: Surface, rule: Rule, items: Items, bins: Bins, order: Array | None
    ) -> None:
        self.surface, self.rule, self.items, self.bins = surface, rule, items, bins
        self.N = len(items.waiting)
        limited = bins.limit is not None
        self.S = self.N if bins.limit is None else len(bins.limit)
        self.slots = _narrowest(("int8", "int16", "int32"), self.S)
        # Up to twice N: what comes before the current item is offered to the next bin.
        self.ranks = _narrowest(("uint8", "uint16", "uint32"), 2 * self.N)
        self.fetched, self.rank_of = _by_rank(items, order, self.ranks)
        self.many = self.N >= MANY_ITEMS or limited
        most = surface.most or self.N
        self.stock = _Stock(items, bins, most, self.rank_of) if limited else None

    def start(self) -> _Turn:
        """Before the first turn."""
        waiting, dtype = self.items.waiting, self.surface.dtype
        bin = jnp.where(waiting, -1, -2).astype(self.slots)
        slot = jnp.zeros(waiting.shape[1], self.slots)
        if self.stock is None:
            left, room = None, self.bins.size
            rank = least(jnp.where(waiting, self.rank_of, self.ranks.type(self.N)), 1)
        else:
            left, room = self.stock.opened(slot, waiting.sum(0, dtype=jnp.int32))
            rank = self.stock.following(bin, jnp.zeros_like(waiting), left, left) - self.N
        rank = rank.astype(self.ranks)
        return _Turn(
            state=self.surface.empty(room),
            room=None if self.stock is None else room,
            slot=slot,
            began=jnp.zeros(len(slot), bool),
            rank=rank,
            item=self.fetched(rank),
            left=left,
            shut=jnp.zeros((self.N if self.many else 1, len(slot)), bool),
            bin=bin,
            corner=(jnp.zeros(waiting.shape, dtype),) * (2 if self.surface.flat else 3),
        )

    def more(self, now: _Turn) -> Array:
        """Whether anything is left to offer."""
        if now.left is None:
            return (now.rank < self.N).any()
        return ((now.left.waiting > 0) & (now.slot < self.S)).any()

    def some(self, now: _Turn) -> _Turn:
        """So many turns as the target wants at once, of no effect once nothing is left."""
        for _ in range(target().turns):
            now = self.turn(now)
        return now

    def turn(self, now: _Turn) -> _Turn:
        """Offers one item to one bin."""
        (size, needed, weight, _), (length, width, height) = now.item, self.items.size
        found, room = now.rank < self.N, now.room or self.bins.size
        candidates, state = self.surface.candidates(now.state, size, needed, room, found)
        corner, fits = candidates.first(self._rule(now.item.place, room[0]))
        fits &= found
        here = (self.rank_of == now.rank) & fits
        bin, shut = jnp.where(here, now.slot, now.bin), now.shut
        kept = corner[::2] if self.surface.flat else corner
        if self.many:
            # What is like a refused item, or higher, is refused too until something comes in.
            shut |= (length == size[0]) & (width == size[1]) & (height >= size[2])
            shut &= ~fits
        began, ahead = now.began | fits, (self.rank_of > now.rank) & ~shut
        left, slot = now.left, now.slot + 1
        if self.stock is None or left is None or weight is None:
            following = jnp.where(ahead, self.rank_of, self.rank_of + self.N)
            following = least(jnp.where(bin == -1, following, self.ranks.type(2 * self.N)), 1)
            opens = (following >= self.N) & began  # or else what is left fits no bin
        else:
            left = self.stock.without(left, size, weight, fits)
            slot = self.stock.after(now.slot, began)
            fresh, other = self.stock.opened(slot, left.waiting)
            following = self.stock.following(bin, ahead, left, fresh)
            opens = (following >= self.N) & (left.waiting > 0) & (now.slot < self.S)
            left, room = jax.tree.map(
                lambda new, old: jnp.where(opens, new, old), (fresh, other), (left, room)
            )
        rank = jnp.where(opens, following - self.N, jnp.minimum(following, self.N))
        rank = rank.astype(self.ranks)
        return _Turn(
            state=self.surface.place(state, size, corner, fits, room, opens),
            room=now.room and room,
            slot=jnp.where(opens, slot, now.slot).astype(self.slots),
            began=began & ~opens,
            rank=rank,
            # Fetched here and carried: fetched where it is used, XLA fuses it into every cell.
            item=self.fetched(rank),
            left=left,
            shut=shut & ~opens,
            bin=bin,
            corner=tuple(
                jnp.where(here, new, old) for new, old in zip(kept, now.corner, strict=True)
            ),
        )

    def _rule(self, place: Array | None, length: Array) -> Rule:
        if place is None:
            return self.rule
        at = jnp.divmod(place, length.astype(jnp.int32))  # y and x; of -1, y is that too
        return as_decided(self.rule, *(side.astype(length.dtype) for side in at[::-1]))


class _Stock:
    """Bins of several types, with limits on their weight, and what decides whether to offer."""

    def __init__(self, items: Items, bins: Bins, most: int, rank_of: Array) -> None:
        assert items.weight is not None
        assert bins.limit is not None
        self.weight, self.limit, self.sides = items.weight, bins.limit, bins.size
        self.most, self.rank_of = most, rank_of
        self.lane = jnp.arange(items.waiting.shape[1], dtype=jnp.int32)
        self.volume = _volume(items.size)
        self.capacity = _volume(bins.size) * np.float32(1 + len(items.waiting) * ROUNDING)
        self.unlimited = np.iinfo(bins.limit.dtype).max
        self.other = self._of_another_type()

    def _of_another_type(self) -> Array:
        """The next slot whose bin differs from that of each: int32 [S, B]."""
        S, batch = self.limit.shape
        columns = (*self.sides, self.limit)
        changes = jnp.stack([column[1:] != column[:-1] for column in columns]).any(0)

        def back(following: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
            change, index = row
            following = jnp.where(change, index, following)
            return following, following

        rows = changes, jnp.arange(1, S, dtype=jnp.int32)
        _, other = jax.lax.scan(back, jnp.full(batch, S, jnp.int32), rows, reverse=True)
        return jnp.concatenate([other, jnp.full((1, batch), S, jnp.int32)])

    def opened(self, slot: Array, waiting: Array) -> tuple[_Left, Triple]:
        """An empty bin: what it can take, nothing beyond the last one; and its sides."""
        S = len(self.limit)
        row, there = jnp.minimum(slot.astype(jnp.int32), S - 1), slot < S
        x, y, z = (side[row, self.lane] for side in self.sides)
        weight = jnp.where(there, self.limit[row, self.lane], -1)
        volume = jnp.where(there, self.capacity[row, self.lane], np.float32(0))
        most = jnp.full(len(slot), self.most, jnp.int32)
        return _Left(weight, volume, most, waiting), (x, y, z)

    def after(self, slot: Array, began: Array) -> Array:
        """The next slot; after a bin that took nothing the next one of another type."""
        row = jnp.minimum(slot.astype(jnp.int32), len(self.other) - 1)
        return jnp.where(began, slot.astype(jnp.int32) + 1, self.other[row, self.lane])

    def without(self, left: _Left, size: Triple, weight: Array, fits: Array) -> _Left:
        """What is left once an item has come in where it fits."""
        limited = left.weight < self.unlimited
        came = fits.astype(jnp.int32)
        return _Left(
            left.weight - jnp.where(fits & limited, weight, 0),
            left.volume - jnp.where(fits, _volume(size), np.float32(0)),
            left.items - came,
            left.waiting - came,
        )

    def following(self, bin: Array, ahead: Array, left: _Left, fresh: _Left) -> Array:
        """The lowest rank of what waits and may fit: `ahead` into this bin, or else, N higher, into
        a fresh one; 2 N if there is neither.
        """
        N = self.rank_of.dtype.type(len(bin))

        def may(bins: _Left) -> Array:
            light = (self.weight <= bins.weight) & (self.volume <= bins.volume)
            return light & (bins.items > 0)

        rank = jnp.where(may(fresh), self.rank_of + N, N + N)
        rank = jnp.where(ahead & may(left), self.rank_of, rank)
        return least(jnp.where(bin == -1, rank, N + N), 1)


def _volume(sides: Triple) -> Array:
    length, width, height = (side.astype(jnp.float32) for side in sides)
    return length * width * height


def _by_rank(items: Items, order: Array | None, dtype: np.dtype) -> tuple[Any, Array]:
    """(rank [B] -> the item that has it, rank of every item [N, B])."""
    N, batch = items.waiting.shape
    lane = jnp.arange(batch, dtype=jnp.int32)
    columns = [*items.size, items.needed]
    as_word = all(column.dtype.itemsize == 1 for column in columns)
    tables = [jnp.stack(columns, -1)] if as_word else [jnp.stack(items.size, -1), items.needed]
    if as_word:  # XLA gathers one element after the other
        tables = [jax.lax.bitcast_convert_type(tables[0], jnp.int32)]
    tables += [column for column in (items.weight, items.place) if column is not None]
    if order is None:
        ranked, rank_of = tables, jax.lax.broadcasted_iota(dtype, (N, batch), 0)
    else:
        ranked, rank_of = _sorted(tables, order, dtype)

    def fetched(rank: Array) -> _Item:
        row = jnp.minimum(rank, N - 1).astype(jnp.int32)
        sides, *rest = (table.at[row, lane].get(mode="promise_in_bounds") for table in ranked)
        if as_word:
            sides = jax.lax.bitcast_convert_type(sides, columns[0].dtype)
        length, width, height, *more = (*jnp.unstack(sides, axis=-1), *rest)
        weight = None if items.weight is None else more.pop(1)
        place = None if items.place is None else more.pop(1)
        return _Item((length, width, height), more[0], weight, place)

    return fetched, rank_of


def _sorted(tables: list[Array], order: Array, dtype: np.dtype) -> tuple[list[Array], Array]:
    """(the tables [N, B, ...] in packing order, rank of every item [N, B])."""
    N, batch = order.shape
    lane = jnp.arange(batch, dtype=jnp.int32)
    number = jax.lax.broadcasted_iota(dtype, (N, batch), 0)
    if not target().whole_loops:
        rank_of = jnp.zeros_like(number).at[order, lane].set(number, unique_indices=True)
        return [table.at[order, lane].get(mode="promise_in_bounds") for table in tables], rank_of

    # Comparing a whole column costs less than writing one number to where it belongs.
    def place(rank: Array, found: tuple[list[Array], Array]) -> tuple[list[Array], Array]:
        rows = [table.at[order[rank], lane].get(mode="promise_in_bounds") for table in tables]
        here = number == order[rank].astype(dtype)
        done = [table.at[rank].set(row) for table, row in zip(found[0], rows, strict=True)]
        return done, jnp.where(here, rank.astype(dtype), found[1])

    nothing = [jnp.zeros_like(table) for table in tables], jnp.zeros((N, batch), dtype)
    done: tuple[list[Array], Array] = jax.lax.fori_loop(jnp.int32(0), N, place, nothing)
    return done


def _narrowest(names: tuple[str, ...], largest: int) -> np.dtype:
    """The first of these integer types that holds `largest`, its maximum kept free."""
    return np.dtype(next(name for name in names if np.iinfo(name).max > largest))
