"""Jobs from files: tables with PackingSolver's columns, 2DPackLib's .ins2D, BED-BPP's orders.

A table has a header with its columns in any order, capitals or not.

    2D items   WIDTH, HEIGHT [, COPIES, WEIGHT, ORIENTED, PROFIT, NAME or ID]
    2D bins    WIDTH, HEIGHT [, COST, COPIES, MAXIMUM_WEIGHT, NAME or ID]
    3D items   X, Y, Z [, COPIES, WEIGHT, ROTATION_XYZ, ..., ROTATION_ZXY, PROFIT, NAME or ID]
    3D bins    X, Y, Z [, COST, COPIES, MAXIMUM_WEIGHT, NAME or ID]

An empty cell is as no column. Items have 1 copy then and weigh nothing. In 2D ORIENTED 0 lets an
item be turned by a quarter; without that items may not be turned, as in the standard instances. In
3D items may be turned as the ROTATION columns with 1 say, without any not at all. For bins empty
or -1 is: COST their volume, COPIES any number, MAXIMUM_WEIGHT none. PROFIT is for the objective
value: without it items are worth their volume, and bins without COPIES are one. For the objective
height that of a bin may be empty or -1: it is open. Columns of more rules: docs/rules.md, all of
them: docs/file-formats.md.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from fractions import Fraction
from os import PathLike
from pathlib import Path
from typing import Any

from jaxpack.errors import UserError
from jaxpack.io.bed_bpp import read_orders
from jaxpack.io.columns import (
    BINS,
    ITEMS,
    Reading,
    Understood,
    check_ignored,
    same_unit,
    understand,
)
from jaxpack.io.ins2d import read_ins2d
from jaxpack.io.notes import Say, silent
from jaxpack.io.obstacles import with_obstacles
from jaxpack.io.spreadsheets import PARQUET, WORKBOOKS, read_table
from jaxpack.io.tables import Table, table_from_columns
from jaxpack.io.types_of_rows import bin_types, item_types
from jaxpack.model.job import Job
from jaxpack.model.numbers import fault

Bad = Callable[[str, UserError], object]
"""Takes the name of an order that cannot be read, and why."""
TABLES = (".csv", ".tsv", ".txt", PARQUET, *WORKBOOKS)
ORDER = "ORDER"
"""The column that says which order an item belongs to, where a table may hold several."""


def read_job(
    items: str | PathLike[str],
    bins: str | PathLike[str] | None = None,
    *,
    obstacles: str | PathLike[str] | None = None,
    ignore: str | Sequence[str] = (),
    packingsolver: bool = False,
    objective: str = "",
    by_order: bool = False,
    bad: Bad | None = None,
    say: Say = silent,
) -> list[Job]:
    """The jobs of a file, in its units: one, or of a BED-BPP file one per order.

    Args:
        items: path of a file .csv, .xlsx, .ins2D or .json.
        bins: of a table of bins, .csv or .xlsx. A table of items needs it; for others it replaces
            what their file says: the bin of an .ins2D file, the target of an order (a euro pallet,
            1200 x 800, if it names none, or a roll container, 800 x 700, both up to 2000 mm).
        obstacles: of a table of what is taken in the bins: see `jaxpack.io.obstacles`.
        ignore: columns that are left out of account, capitals or not.
        packingsolver: read tables exactly as PackingSolver 0.1.1233 does: without COPIES there is
            one bin, 2D items without ORIENTED may be turned, without a rotation that is 1 items
            are as given, -1 as MAXIMUM_WEIGHT is a limit, and decimals of lengths are cut off.
        objective: what is wanted of a plan, a key of `OBJECTIVES`: some obey more columns. Not
            given, the least cost if bins have costs, otherwise the fewest bins.
        by_order: read a job per order of a table too: the rows that have the same in its column
            ORDER, if it has one.
        bad: takes the name of an order that cannot be read, and why; it is raised if not given.
        say: takes a line for everything that was assumed, such as the `append` of a list.

    Raises:
        UserError: naming the file, the row and the column (of JSON the order and the key).
    """
    taken = None if obstacles is None else read_table(Path(obstacles), say)
    reading = Reading(_capitals(ignore), packingsolver, say, objective, taken)
    items, bins = Path(items), None if bins is None else Path(bins)
    kind = items.suffix.lower()
    if kind in TABLES:
        if bins is None:
            what = f"a {kind[1:].upper()} file of items needs one of bins too"
            raise fault(items, f"{what}: give both")
        return _jobs(
            read_table(items, say), read_table(bins, say), items.stem, reading, by_order, bad
        )
    if kind not in (".ins2d", ".json"):
        raise fault(
            items, f"files '{kind}' are not known: give .csv, .xlsx, .parquet, .ins2D or .json"
        )
    return _others(items, bins, reading, bad)


def job_from_columns(
    items: Any,
    bins: Any,
    name: str = "",
    *,
    obstacles: Any = None,
    ignore: str | Sequence[str] = (),
    packingsolver: bool = False,
    objective: str = "",
    say: Say = silent,
) -> Job:
    """A job from tables of a program, with the columns of the CSV files.

    Args:
        items: a data frame, a dict of columns, a structured NumPy array or a list of dicts. None,
            NaN and NA are empty cells.
        bins: likewise.
        name: the job's name.
        obstacles: likewise a table; none if not given.
        ignore, packingsolver, objective, say: see `read_job`.

    Raises:
        UserError: naming the table, the row, counted from 0, and the column.
    """
    taken = None if obstacles is None else table_from_columns(obstacles, "obstacles")
    reading = Reading(_capitals(ignore), packingsolver, say, objective, taken)
    tables = table_from_columns(items, "items"), table_from_columns(bins, "bins")
    return _jobs(*tables, name, reading)[0]


def jobs_from_columns(
    orders: Any,
    bins: Any,
    bad: Bad,
    *,
    obstacles: Any = None,
    ignore: str | Sequence[str] = (),
    objective: str = "",
    say: Say = silent,
) -> list[Job]:
    """A job for every order of a table of a program, by its column ORDER.

    Args:
        orders, bins, obstacles: see `job_from_columns`.
        bad, ignore, objective, say: see `read_job`.

    Raises:
        UserError: naming the table and the column, or the bin.
    """
    taken = None if obstacles is None else table_from_columns(obstacles, "obstacles")
    reading = Reading(_capitals(ignore), False, say, objective, taken)
    items = table_from_columns(orders, "orders")
    items.need((ORDER,))
    return _jobs(items, table_from_columns(bins, "bins"), "", reading, True, bad)


def jobs_of_groups(
    items: Table,
    bins: Table,
    groups: Iterable[tuple[str, slice]],
    *,
    obstacles: Table | None = None,
    ignore: str | Sequence[str] = (),
    objective: str = "",
    say: Say = silent,
) -> list[Job | UserError]:
    """A job for every group of a table's lines, or what is wrong with it.

    Args:
        items: a table; its column ORDER, if it has one, says nothing.
        bins: a table.
        groups: the name of each, and which lines it has.
        obstacles: a table; none if not given.
        ignore, objective, say: see `read_job`. What is said is of the columns and the bins alone.

    Raises:
        UserError: where anything is wrong with the columns or the bins.
    """
    reading = Reading(_capitals(ignore), False, say, objective, obstacles)
    known = replace(reading, ignore=reading.ignore | {ORDER})
    columns = understand(_part(items, slice(0)), ITEMS, known)
    rooms = understand(bins, BINS, reading)
    check_ignored(reading, columns, rooms)
    factor = same_unit(columns, rooms, say)
    kinds = bin_types(rooms, columns.dimension, factor, reading)
    known = replace(known, say=silent)
    try:
        goods = understand(items, ITEMS, known)
    except UserError:  # of one cell: the others are read without it
        goods = None
    jobs = list[Job | UserError]()
    for name, lines in groups:
        try:
            if goods is None:
                own = understand(_part(items, lines), ITEMS, known)
            else:
                own = replace(goods, table=_part(goods.table, lines))
            types = item_types(own, known)
            jobs.append(Job(types, kinds, columns.dimension, name, objective))
        except UserError as error:
            jobs.append(error)
    return jobs


def _part(table: Table, lines: slice) -> Table:
    return replace(table, lines=table.lines[lines])


def _capitals(names: str | Sequence[str]) -> frozenset[str]:
    names = [names] if isinstance(names, str) else names
    return frozenset(" ".join(name.upper().split()) for name in names)


def _others(items: Path, bins: Path | None, reading: Reading, bad: Bad | None) -> list[Job]:
    """The jobs of a file that has bins of its own, which those of a table replace."""
    kind, goal, taken, say = items.suffix.lower(), reading.objective, reading.obstacles, reading.say
    given = None
    if bins is not None:
        read = understand(read_table(bins, say), BINS, reading)
        check_ignored(reading, read)
        given = bin_types(read, 2 if kind == ".ins2d" else 3, Fraction(1), reading)
    else:
        check_ignored(reading)
    if kind == ".ins2d":
        jobs = [read_ins2d(items, given, reading)]
    else:
        jobs = read_orders(items, given, copies=1 if reading.goal.leaves_out else None, bad=bad)
        jobs = [replace(job, objective=goal) for job in jobs] if goal else jobs
    if given is not None or taken is None:
        return jobs
    return [
        replace(job, bins=with_obstacles(job.bins, taken, job.dimension, say=say)) for job in jobs
    ]


def _jobs(
    items: Table,
    bins: Table,
    name: str,
    reading: Reading,
    by_order: bool = False,
    bad: Bad | None = None,
) -> list[Job]:
    several = by_order and ORDER in items.columns and ORDER not in reading.ignore
    known = replace(reading, ignore=reading.ignore | {ORDER}) if several else reading
    goods, rooms = understand(items, ITEMS, known), understand(bins, BINS, reading)
    check_ignored(reading, goods, rooms)
    bad = bad if several else None
    orders = _orders(items, goods, bad) if several else {name: goods}
    types = {}
    for order, part in orders.items():
        with _kept(order, bad):
            types[order] = item_types(part, reading)
    factor = same_unit(goods, rooms, reading.say)
    kinds = bin_types(rooms, goods.dimension, factor, reading)
    jobs = []
    for order, own in types.items():
        with _kept(order, bad):
            jobs.append(Job(own, kinds, goods.dimension, order, reading.objective))
    return jobs


@contextmanager
def _kept(order: str, bad: Bad | None) -> Iterator[None]:
    """What is wrong with one order, for whoever takes it."""
    try:
        yield
    except UserError as error:
        if bad is None:
            raise
        bad(order, error)


def _orders(items: Table, goods: Understood, bad: Bad | None) -> dict[str, Understood]:
    """The rows of each order, by its name, in the order in which they first come."""
    items.need((ORDER,))
    lines: dict[str, list] = {}
    for row, line in zip(items.rows(), goods.table.lines, strict=True):
        with _kept("", bad):
            if not (name := row.text(ORDER)):
                raise fault(row.at(ORDER), "empty: say which order the item belongs to")
        if name:
            lines.setdefault(name, []).append(line)
    if not lines:
        return {"": goods}
    return {
        name: replace(goods, table=replace(goods.table, lines=own)) for name, own in lines.items()
    }
