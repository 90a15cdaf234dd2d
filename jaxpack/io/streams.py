"""Orders of a Parquet file of any size, chunk by chunk; the rows of an order stand together."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import blake2b, sha256
from os import SEEK_END
from pathlib import Path
from typing import Any

import numpy as np

from jaxpack.errors import UserError
from jaxpack.io.arrow import arrow, first_line, opened
from jaxpack.io.jobs import ORDER, jobs_of_groups
from jaxpack.io.tables import MOST_ROWS, Row, Table, table_from_columns
from jaxpack.model.numbers import fault, show

BATCH = 16_384  # rows that are read at a time


@dataclass(frozen=True)
class Chunk:
    """Some orders that follow one another."""

    source: str  # the file's name, for messages
    number: int
    first: int  # row of the file
    names: tuple[str, ...]  # of the orders
    groups: tuple[slice, ...]  # rows of each, counted from the first of all
    rows: Any  # an Arrow table
    repeated: frozenset[int]  # which of them have come before

    def jobs(self, bins: Table, **how: Any) -> list[Any]:
        """Of each order its Job, or the UserError that says what is wrong with it.

        Args:
            bins: a table.
            how: see `jobs_of_groups`.
        """
        items = table_from_columns(self.rows, self.source, self.first)
        named = zip(self.names, self.groups, strict=True)
        jobs = jobs_of_groups(items, bins, named, **how)
        return [self._wrong(number) or job for number, job in enumerate(jobs)]

    def _wrong(self, number: int) -> UserError | None:
        """What is wrong with an order as such."""
        name, row = self.names[number], self.first + self.groups[number].start
        where = f"{self.source}: row {row}, column {ORDER}"
        if not name:
            return fault(where, "empty: say which order the item belongs to")
        if number in self.repeated:
            what = f"order {show(name)} has come before"
            return fault(where, what, "let the rows of an order stand together")
        return None


class OrderStream:
    """The orders of a file. Of those that are read only the hashes of their names stay."""

    def __init__(self, path: Path) -> None:
        """Reads what the file says of itself.

        Raises:
            UserError: where it cannot be read, or has no column ORDER.
        """
        self.path, self.file = path, opened(path)
        schema = self.file.schema_arrow
        columns = table_from_columns(schema.empty_table(), str(path))
        columns.need((ORDER,))
        self.column = columns.columns.index(ORDER)
        self.rows: int = self.file.metadata.num_rows
        self.footer = sha256(_footer(path)).hexdigest()

    def checked(self, bins: Table, **how: Any) -> None:
        """Looks at the columns and the bins, before there is any order; says what is assumed.

        Args:
            bins: a table.
            how: see `jobs_of_groups`.

        Raises:
            UserError: naming what is wrong with them.
        """
        columns = table_from_columns(self.file.schema_arrow.empty_table(), str(self.path))
        jobs_of_groups(columns, bins, (), **how)

    def chunks(self, size: int) -> Iterator[Chunk]:
        """The orders, so many at a time; they are the same whatever the file's row groups are.

        Raises:
            UserError: where the file is damaged, or an order has no end.
        """
        pa, seen = arrow(), _Seen()
        number, first, held = 0, 0, self.file.schema_arrow.empty_table()

        def cut(names: Sequence[str], ends: Sequence[int]) -> Iterator[Chunk]:
            nonlocal number, first, held
            for low in range(0, len(names), size):
                some, of_them = tuple(names[low : low + size]), ends[low : low + size]
                begin = ends[low - 1] if low else 0
                inside = [end - begin for end in of_them]
                groups = tuple(map(slice, (0, *inside), inside))
                rows, again = held.slice(begin, inside[-1]), frozenset(seen.add(some))
                yield Chunk(self.path.name, number, first + begin, some, groups, rows, again)
                number += 1
            if names:
                first, held = first + ends[-1], held.slice(ends[-1])

        for batch in self._batches():
            held = pa.concat_tables([held, pa.Table.from_batches([batch])])
            names, ends = self._groups(held, first)
            self._check_end(names, ends, first)
            whole = (len(names) - 1) // size * size  # the last one may go on
            yield from cut(names[:whole], ends[:whole])
        yield from cut(*self._groups(held, first))

    def _batches(self) -> Iterator[Any]:
        try:
            yield from self.file.iter_batches(BATCH)
        except (OSError, arrow().ArrowException) as error:
            raise fault(self.path, f"is damaged: {first_line(error)}") from error

    def _groups(self, rows: Any, first: int) -> tuple[list[str], list[int]]:
        """The orders of some rows, one after the other, and behind which row each ends."""
        column = rows.column(self.column)
        if arrow().types.is_dictionary(column.type):
            column = column.cast(column.type.value_type)
        codes = column.combine_chunks().dictionary_encode().indices.fill_null(-1).to_numpy()
        starts = np.flatnonzero(np.diff(codes, prepend=-2))
        names, begins = list[str](), list[int]()
        for start, value in zip(starts.tolist(), column.take(starts).to_pylist(), strict=True):
            name = Row(str(self.path), first + start, (value,), {ORDER: 0}).text(ORDER)
            if not names or name != names[-1]:  # but for a space, say
                names.append(name)
                begins.append(start)
        return names, [*begins[1:], len(codes)]

    def _check_end(self, names: Sequence[str], ends: Sequence[int], first: int) -> None:
        """Whether the last of some orders may still be one that is held in the memory."""
        begin = ends[-2] if len(ends) > 1 else 0
        if ends and ends[-1] - begin > MOST_ROWS:
            where = f"{self.path}: row {first + begin}, column {ORDER}"
            raise fault(
                where, f"order {show(names[-1])} has more than {MOST_ROWS:,} rows: split it"
            )


def _footer(path: Path) -> bytes:
    """What a Parquet file says of itself: the schema, and of every row group where it is."""
    with path.open("rb") as file:
        file.seek(-8, SEEK_END)
        size = int.from_bytes(file.read(4), "little")
        file.seek(-8 - size, SEEK_END)
        return file.read(size)


class _Seen:
    """Names by their hashes, 8 bytes each, in sorted arrays of which each is half the next."""

    def __init__(self) -> None:
        self.sorted = list[Any]()

    def add(self, names: Sequence[str]) -> Iterator[int]:
        """Which of the names have come before."""
        digests = b"".join(blake2b(name.encode(), digest_size=8).digest() for name in names)
        new = np.frombuffer(digests, np.uint64)
        before = np.zeros(len(new), bool)
        order = np.argsort(new, kind="stable")
        before[order[1:]] = new[order[1:]] == new[order[:-1]]
        for old in self.sorted:
            at = np.searchsorted(old, new)
            before |= old[np.minimum(at, len(old) - 1)] == new
        self.sorted.append(new[order])
        while len(self.sorted) > 1 and len(self.sorted[-2]) <= len(self.sorted[-1]):
            self.sorted[-2:] = [np.sort(np.concatenate(self.sorted[-2:]))]
        return map(int, np.flatnonzero(before))
