"""2DPackLib's files .ins2D as jobs."""

import math
from pathlib import Path

from jaxpack.io.columns import Reading
from jaxpack.io.texts import read_text
from jaxpack.model.job import BinType, ItemType, Job, Sides, counted
from jaxpack.model.numbers import as_profit, as_size, as_whole, fault


def read_ins2d(path: Path, bins: tuple[BinType, ...] | None, reading: Reading) -> Job:
    """Lines `m`, `W H`, then m of `i w h [dmin [dmax [profit]]]`: dmin copies; may not be turned.

    Where items may be left out there are dmax copies, and one bin. A strip packing file has -1 for
    H, which is open; it needs `bins` for other objectives than the height.

    Raises:
        UserError: naming the file, the row and the column.
    """
    goal = reading.goal
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
        one = 1 if goal.leaves_out else None
        size = _flat(second, W=wide, H="1" if goal.open_bin and high == "-1" else high)
        size = (*size[:2], math.inf) if goal.open_bin and high == "-1" else size
        bins = (BinType(size, copies=one, where="row 2"),)
    items = []
    total = 0
    for where, fields in lines[2:]:
        if not 3 <= len(fields) <= 6:
            raise fault(where, f"{len(fields)} fields, expected 'i w h dmin dmax profit'")
        size = _flat(where, w=fields[1], h=fields[2])
        place, column = (4, "dmax") if goal.leaves_out and len(fields) > 4 else (3, "dmin")
        copies = 1
        if len(fields) > place:
            copies = as_whole(fields[place], f"{where}, column {column}", low=1)
        total = counted(total + copies, f"{where}, column {column}: {copies} copies")
        row, profit = where.rsplit(": ", 1)[-1], None
        if "PROFIT" in goal.obeys and len(fields) > 5:
            profit = as_profit(fields[5], f"{where}, column profit")
        items.append(ItemType(size, copies, name=fields[0], where=row, profit=profit))
    return Job(tuple(items), bins, dimension=2, name=path.stem, objective=reading.objective)


def _flat(where: str, **sides: str) -> Sides:
    width, height = (as_size(text, f"{where}, column {name}") for name, text in sides.items())
    return width, 1.0, height
