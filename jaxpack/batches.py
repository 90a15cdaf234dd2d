"""Orders as rows, for engines that map a function over batches of a table."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jaxpack.errors import UserError
from jaxpack.io.arrow import arrow, first_line, typed
from jaxpack.io.jobs import ORDER, jobs_of_groups
from jaxpack.io.tables import Row, Table, table_from_columns
from jaxpack.many import PLACEMENTS, tables_of
from jaxpack.model.job import Job
from jaxpack.model.numbers import fault
from jaxpack.model.rules import Rules
from jaxpack.search.portfolio import SolveOptions
from jaxpack.solution import Solution, checked_options
from jaxpack.workers import packed

NESTED = "ITEMS"
OF_ORDERS = ("ORDER", "STATUS", "BINS", "BOUND", "COST", "GAP", "FILL", "LEFT_OUT", "MESSAGE")


def solve_batch(
    table: Any,
    *,
    bins: Any,
    packings: int = 8,
    time_limit: float | None = None,
    seed: int = 0,
    resolution: float | None = None,
    skip_unfit: bool = False,
    obstacles: Any = None,
    ignore: str | Sequence[str] = (),
    objective: str = "",
    **rules: Any,
) -> Any:
    """Packs the orders of a batch in this process, one row each, for engines that map over batches.

    With packings alone it is a pure function: an order's row depends on nothing beside it.

    Args:
        table: an Arrow table, a data frame of pandas or a dict of NumPy arrays with the columns
            ORDER and ITEMS, of each order a list of its items with the columns of the CSV files
            (list<struct<X, Y, Z, ...>>); see `orders_as_rows`.
        bins: a table of the bins, see `solve_many`.
        packings: that are tried at most for each order.
        time_limit: seconds for the batch, if they are to end it earlier.
        seed: of the random choices.
        resolution: see `solve`, as what follows: corners stand on a grid of this length.
        skip_unfit: leave out items that no bin can hold.
        obstacles: a table of what is taken in the bins: see `jaxpack.io.obstacles`.
        ignore: columns that need not be obeyed.
        objective: a key of `OBJECTIVES`.
        rules: fields of `Rules`, such as support=0.8: what carries an item, where it may stand.

    Returns:
        A table of the same kind, with a row for each of the batch, in its order: ORDER, STATUS,
        BINS, BOUND, COST, GAP, FILL, LEFT_OUT, MESSAGE, as the figures of `solve_many`, and
        PLACEMENTS, a list of what its placements have beside ORDER.

    Raises:
        UserError: where anything is wrong that is not one order's alone, in one line.
    """
    names, items, groups = _orders(as_arrow(table))
    jobs = jobs_of_groups(
        items,
        table_from_columns(bins, "bins"),
        zip(names, groups, strict=True),
        obstacles=None if obstacles is None else table_from_columns(obstacles, "obstacles"),
        ignore=ignore,
        objective=objective,
    )
    jobs = [
        job if name else _nameless(row)
        for row, (name, job) in enumerate(zip(names, jobs, strict=True))
    ]
    good = [job for job in jobs if isinstance(job, Job)]
    options = SolveOptions(
        time_limit, seed, Rules(**rules), resolution, skip_unfit, packings=packings
    )
    for job in good[:1]:
        options = checked_options(options, job)
    found = iter(packed(good, options))
    results = [next(found) if isinstance(job, Job) else str(job) for job in jobs]
    return _like(table, _nested([*zip(names, results, strict=True)]))


def orders_as_rows(table: Any) -> Any:
    """A table of items with a column ORDER as one with a row per order, for `solve_batch`.

    Args:
        table: an Arrow table, a data frame of pandas or a dict of columns, a row per item. The rows
            of an order may be anywhere in it.

    Returns:
        A table of the same kind with ORDER and ITEMS, a list of all other columns; the orders in
        which they first come.

    Raises:
        UserError: where there is no column ORDER, or a cell of it is empty.
    """
    pa, rows = arrow(), as_arrow(table)
    place = _place(rows, ORDER)
    column = rows.column(place)
    if pa.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    column = column.combine_chunks().dictionary_encode()
    if column.null_count:
        row = column.indices.is_null().index(True).as_py()
        raise fault(f"table: row {row}, column {ORDER}", "empty: say which order it belongs to")
    codes = column.indices.to_numpy()
    counts = np.bincount(codes, minlength=len(column.dictionary))
    items = rows.remove_column(place).take(np.argsort(codes, kind="stable"))
    lists = _lists(items, counts)
    return _like(table, pa.table({ORDER: column.dictionary, NESTED: lists}))


def as_arrow(table: Any) -> Any:
    """A batch as an Arrow table.

    Raises:
        UserError: where it is none that can be one.
    """
    pa = arrow()
    try:
        if isinstance(table, pa.RecordBatch):
            return pa.Table.from_batches([table])
        if isinstance(table, pa.Table):
            return table
        if isinstance(table, Mapping):
            # Arrow takes arrays of one axis, and lists of what a cell of them may hold.
            return pa.table({name: pa.array(_plain(column)) for name, column in table.items()})
        return pa.Table.from_pandas(table, preserve_index=False)
    except (pa.ArrowException, TypeError, ValueError, AttributeError) as error:
        raise fault("table", f"cannot be read: {first_line(error)}") from error


def _plain(column: Any) -> Any:
    if isinstance(column, np.ndarray) and column.dtype == object:
        return [list(cell) if isinstance(cell, np.ndarray) else cell for cell in column]
    return column


def _place(table: Any, name: str) -> int:
    """Which column has that name, capitals or not."""
    columns = Table("table", "table", tuple(one.strip().upper() for one in table.column_names), ())
    columns.need((name,))
    return columns.columns.index(name)


def _orders(table: Any) -> tuple[list[str], Table, list[slice]]:
    """The names, all items, and which of these each order has; they count from 0 in each."""
    pa = arrow()
    column = table.column(_place(table, NESTED)).combine_chunks()
    kind = column.type
    if pa.types.is_null(kind) or not (pa.types.is_list(kind) or pa.types.is_large_list(kind)):
        raise fault(f"table: column {NESTED}", f"is {kind}: give a list of items in each row")
    if not pa.types.is_struct(kind.value_type):
        raise fault(f"table: column {NESTED}", f"is {kind}: give items with named fields X, Y, Z")
    counts = column.value_lengths().fill_null(0).to_numpy()
    flat = column.flatten()
    fields = [kind.value_type.field(n).name for n in range(kind.value_type.num_fields)]
    items = table_from_columns(pa.table(flat.flatten(), fields), "items")
    ends = np.cumsum(counts).tolist()
    groups = [slice(end - count, end) for end, count in zip(ends, counts.tolist(), strict=True)]
    lines = [
        (n, items.lines[at][1])
        for group in groups
        for n, at in enumerate(range(group.start, group.stop))
    ]
    names = [
        Row("table", row, (value,), {ORDER: 0}).text(ORDER)
        for row, value in enumerate(table.column(_place(table, ORDER)).to_pylist())
    ]
    return names, Table("items", "items", items.columns, lines), groups


def _nameless(row: int) -> UserError:
    return fault(f"table: row {row}, column {ORDER}", "empty: give the order a name")


def _lists(items: Any, counts: Any) -> Any:
    """Rows of a table as lists of structs, so many in each."""
    pa = arrow()
    items = items.combine_chunks()
    columns = [
        pa.concat_arrays(c.chunks) if c.num_chunks else c.combine_chunks() for c in items.columns
    ]
    structs = pa.StructArray.from_arrays(columns, fields=list(items.schema))
    offsets = pa.array(np.concatenate([[0], np.cumsum(counts)]), pa.int32())
    return pa.ListArray.from_arrays(offsets, structs)


def _nested(results: Sequence[tuple[str, Solution | str | None]]) -> Any:
    """The tables of orders as one."""
    placements, figures = map(typed, tables_of(results))
    counts = [
        sum(len(one.placements) for one in found.plan.bins) if isinstance(found, Solution) else 0
        for _, found in results
    ]
    return figures.select(OF_ORDERS).append_column(
        "PLACEMENTS", _lists(placements.select(PLACEMENTS[1:]), counts)
    )


def _like(given: Any, table: Any) -> Any:
    """The table as one of the same kind as another."""
    if isinstance(given, Mapping):
        return {name: table[name].to_numpy() for name in table.column_names}
    pandas = type(given).__module__.partition(".")[0] == "pandas"
    return table.to_pandas() if pandas else table
