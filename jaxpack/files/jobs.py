"""Jobs from files: PackingSolver's CSV, 2DPackLib's .ins2D and BED-BPP's JSON orders.

A CSV file has a header with its columns in any order; others are ignored, capitals or not.

    2D items   WIDTH, HEIGHT [, COPIES, WEIGHT, ORIENTED, NAME or ID]
    2D bins    WIDTH, HEIGHT [, COST, COPIES, MAXIMUM_WEIGHT, NAME or ID]
    3D items   X, Y, Z [, COPIES, WEIGHT, ROTATION_XYZ, ..., ROTATION_ZXY, NAME or ID]
    3D bins    X, Y, Z [, COST, COPIES, MAXIMUM_WEIGHT, NAME or ID]

Items have 1 copy and weigh nothing if not said. In 2D ORIENTED 0 lets an item be turned by a
quarter; without that column items may not be turned, as in the standard instances (PackingSolver
itself turns them then). In 3D items may be turned as the ROTATION columns with 1 say, without any
not at all. For bins -1 or no column is: COST their volume, COPIES any number, MAXIMUM_WEIGHT none.
"""

import math
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from jaxpack.files.tables import Row, Table, read_table, table_from_columns
from jaxpack.files.texts import member, read_json, read_text
from jaxpack.loading.job import FLAT_TURNED, ORIENTATIONS, UPRIGHT, BinType, ItemType, Job, Sides
from jaxpack.loading.numbers import as_size, as_weight, as_whole, fault, show

MOST_ITEMS = 100_000  # copies of a job's items, all together

TARGETS = {"euro-pallet": (1200.0, 800.0, 1600.0), "rollcontainer": (800.0, 700.0, 1600.0)}
"""What a BED-BPP order is loaded on, and up to which height, mm."""

_SIDES = {2: ("WIDTH", "HEIGHT"), 3: ("X", "Y", "Z")}
_ROTATIONS = {f"ROTATION_{name}": name for name in ORIENTATIONS}
_NAMES = ("NAME", "ID")


def read_job(items: Path, bins: Path | None = None) -> list[Job]:
    """The jobs of a file: one, or of a BED-BPP file one per order.

    Args:
        items: a file .csv, .ins2D or .json.
        bins: a CSV file of bins. CSV items need it; for the others it replaces what their file
            says: the bin of an .ins2D file, the target of an order (a euro pallet, 1200 x 800,
            if it names none, or a roll container, 800 x 700, both up to 1600 mm).

    Raises:
        UserError: naming the file, the row and the column (of JSON the order and the key).
    """
    kind = items.suffix.lower()
    if kind == ".csv":
        if bins is None:
            raise fault(items, "a CSV file of items needs one of bins too: give both")
        return [_job(read_table(items), read_table(bins), items.stem)]
    if kind == ".ins2d":
        return [_read_ins2d(items, None if bins is None else _bins(read_table(bins), 2))]
    if kind == ".json":
        given = None if bins is None else _bins(read_table(bins), 3)
        orders = read_json(items)
        if not isinstance(orders, dict) or not orders:
            raise fault(items, "expected an object of orders by name, as BED-BPP has them")
        return [_order(f"{items}: order '{name}'", name, orders[name], given) for name in orders]
    raise fault(items, f"files '{kind}' are not known: give .csv, .ins2D or .json")


def job_from_columns(items: Any, bins: Any, name: str = "") -> Job:
    """A job from tables of a program, with the columns of the CSV files.

    Args:
        items: a data frame, a dict of columns, a structured NumPy array or a list of dicts.
        bins: likewise.
        name: the job's name.

    Raises:
        UserError: naming the table, the row, counted from 0, and the column.
    """
    return _job(table_from_columns(items, "items"), table_from_columns(bins, "bins"), name)


def _job(items: Table, bins: Table, name: str) -> Job:
    dimension = _dimension(items)
    return Job(_items(items, dimension), _bins(bins, dimension), dimension, name)


def _dimension(table: Table) -> int:
    """2 or 3: the one whose columns are there."""
    found = [d for d, names in _SIDES.items() if set(names) <= set(table.columns)]
    if len(found) == 2:
        raise fault(table.header, "columns of 2D (WIDTH, HEIGHT) and of 3D (X, Y, Z): keep either")
    if not found:
        # The one of which most is there or misspelt is meant.
        likeness = {
            d: sum(2 * (n in table.columns) + bool(get_close_matches(n, table.columns)) for n in ns)
            for d, ns in _SIDES.items()
        }
        if not any(likeness.values()):
            there = ", ".join(table.columns)[:60] or "none"
            what = f"columns WIDTH, HEIGHT (2D) or X, Y, Z (3D) are missing: there are {there}"
            raise fault(table.header, what)
        found = [max(likeness, key=lambda d: likeness[d])]
        table.need(_SIDES[found[0]])
    if found == [2] and (third := {"LENGTH", "DEPTH"} & set(table.columns)):
        what = f"column {min(third)} beside WIDTH and HEIGHT"
        raise fault(table.header, what, "3D sides are named X, Y and Z; for 2D remove it")
    return found[0]


def _size(row: Row, dimension: int) -> Sides:
    if dimension == 2:
        return row.size("WIDTH"), 1.0, row.size("HEIGHT")
    return row.size("X"), row.size("Y"), row.size("Z")


def _items(table: Table, dimension: int) -> tuple[ItemType, ...]:
    table.need(_SIDES[dimension], ("COPIES", "WEIGHT", "ORIENTED", *_ROTATIONS, *_NAMES))
    odd = [name for name in table.columns if name.startswith("ROTATION") and name not in _ROTATIONS]
    if odd and dimension == 3:  # to ignore it would forbid what it allows
        raise fault(table.header, f"column {odd[0]} is not known", f"use {', '.join(_ROTATIONS)}")
    if not table.rows:
        raise fault(table.header, "no items below the header: give at least one")
    items = []
    total = 0
    for row in table.rows:
        copies = row.whole("COPIES", low=1) if "COPIES" in row.cells else 1
        total = _count(total + copies, f"{row.at('COPIES')}: {copies} copies")
        items.append(
            ItemType(
                _size(row, dimension),
                copies,
                row.weight("WEIGHT"),
                _flat_orientations(row) if dimension == 2 else _orientations(row),
                row.text(*_NAMES),
                row.where.rsplit(": ", 1)[-1],
            )
        )
    return tuple(items)


def _count(total: int, what: str) -> int:
    if total > MOST_ITEMS:
        raise fault(what, f"more than {MOST_ITEMS:,} items in all: split the job")
    return total


def _flat_orientations(row: Row) -> tuple[str, ...]:
    if "ORIENTED" not in row.cells or row.flag("ORIENTED"):
        return ("XYZ",)
    return FLAT_TURNED


def _orientations(row: Row) -> tuple[str, ...]:
    columns = [column for column in _ROTATIONS if column in row.cells]
    if not columns:
        return ("XYZ",)
    allowed = tuple(_ROTATIONS[column] for column in columns if row.flag(column))
    if not allowed:
        raise fault(row.where, f"columns {', '.join(columns)}", "all are 0: allow at least one")
    return allowed


def _bins(table: Table, dimension: int) -> tuple[BinType, ...]:
    if (found := _dimension(table)) != dimension:
        sides = ", ".join(_SIDES[dimension])
        what = f"bins of {found}D for items of {dimension}D"
        raise fault(table.header, what, f"give bins with columns {sides}")
    table.need(_SIDES[dimension], ("COST", "COPIES", "MAXIMUM_WEIGHT", *_NAMES))
    if not table.rows:
        raise fault(table.header, "no bins below the header: give at least one")
    return tuple(
        BinType(
            _size(row, dimension),
            _cost(row) if row.given("COST") else None,
            row.whole("COPIES", low=1) if row.given("COPIES") else None,
            row.weight("MAXIMUM_WEIGHT") if row.given("MAXIMUM_WEIGHT") else math.inf,
            row.text(*_NAMES),
        )
        for row in table.rows
    )


def _cost(row: Row) -> float:
    cost = row.number("COST")
    if cost < 0:
        raise fault(row.at("COST"), f"{cost:g} is negative: give 0 or more, or -1 for the volume")
    return cost


def _read_ins2d(path: Path, bins: tuple[BinType, ...] | None) -> Job:
    """Lines `m`, `W H`, then m of `i w h [dmin [dmax [profit]]]`: dmin copies; may not be turned.

    A strip packing file has -1 for H and needs `bins`.
    """
    lines = [
        (f"{path}: row {number}", line.split())
        for number, line in enumerate(read_text(path).split("\n"), 1)
        if line.strip()
    ]
    for (where, fields), names in zip(lines, ("m", "W H"), strict=False):
        if len(fields) != len(names.split()):
            raise fault(where, f"{len(fields)} fields, expected '{names}'")
    if len(lines) < 2:
        raise fault(path, "expected a line 'm' and a line 'W H' before the items")
    (first, (count,)), (second, (wide, high)) = lines[:2]
    number = as_whole(count, f"{first}, column m", low=1)
    if number != len(lines) - 2:
        raise fault(first, "column m", f"{number} items announced, {len(lines) - 2} are there")
    if bins is None:
        bins = (BinType(_flat(second, W=wide, H=high)),)
    items = []
    total = 0
    for where, fields in lines[2:]:
        if not 3 <= len(fields) <= 6:
            raise fault(where, f"{len(fields)} fields, expected 'i w h dmin dmax profit'")
        size = _flat(where, w=fields[1], h=fields[2])
        copies = as_whole(fields[3], f"{where}, column dmin", low=1) if len(fields) > 3 else 1
        total = _count(total + copies, f"{where}, column dmin: {copies} copies")
        row = where.rsplit(": ", 1)[-1]
        items.append(ItemType(size, copies, name=fields[0], where=row))
    return Job(tuple(items), bins, dimension=2, name=path.stem)


def _flat(where: str, **sides: str) -> Sides:
    width, height = (as_size(text, f"{where}, column {name}") for name, text in sides.items())
    return width, 1.0, height


def _order(where: str, name: str, order: Any, bins: tuple[BinType, ...] | None) -> Job:
    """An order of BED-BPP, mm and kg: equal items are copies of one; upright, any side ahead."""
    sequence = member(order, "item_sequence", dict, where)
    if not sequence:
        raise fault(where, "key 'item_sequence' has no items: give at least one")
    copies: dict[ItemType, int] = {}
    for key, item in sequence.items():
        kind = _ordered_item(f"{where}, item '{key}'", item)
        copies[kind] = copies.get(kind, 0) + 1
    _count(len(sequence), where)
    items = tuple(replace(kind, copies=number) for kind, number in copies.items())
    return Job(items, bins or (_target(where, order),), name=name)


def _ordered_item(where: str, item: Any) -> ItemType:
    x, y, z = (
        as_size(member(item, key, object, where), f"{where}, key '{key}'")
        for key in ("length/mm", "width/mm", "height/mm")
    )
    key = "weight/kg"
    weight = as_weight(member(item, key, object, where), f"{where}, key '{key}'")
    label = next((item[key] for key in ("article", "id") if item.get(key) is not None), "")
    if not isinstance(label, str | int):
        raise fault(where, f"article or id {show(label)}", "expected a text")
    return ItemType((x, y, z), weight=weight, orientations=UPRIGHT, name=str(label))


def _target(where: str, order: Any) -> BinType:
    properties = order.get("properties", {})
    if not isinstance(properties, dict):
        raise fault(where, "key 'properties'", "expected an object")
    target = properties.get("target", "euro-pallet")
    if not isinstance(target, str) or target not in TARGETS:
        what = f"{show(target)} is not known: use {' or '.join(TARGETS)}, or give a file of bins"
        raise fault(where, "key 'target'", what)
    return BinType(TARGETS[target], name=target)
