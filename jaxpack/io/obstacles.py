"""Tables of obstacles: what in a bin is taken, such as wheel arches and pillars.

    3D   [BIN,] X, Y, Z, LX, LY, LZ
    2D   [BIN,] X, Z, LX, LZ

BIN is the name of a type of bins or its number, from 0; without it, or where it is empty, all have
the obstacle. X, Y, Z is its corner that is nearest to the origin, LX, LY, LZ are its sides, in the
unit of the bins.
"""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

from jaxpack.io.notes import Say, note, silent
from jaxpack.io.spreadsheets import plain_numbers
from jaxpack.io.tables import Row, Table
from jaxpack.model.exact import exact
from jaxpack.model.job import BinType, Sides
from jaxpack.model.limits import Obstacle
from jaxpack.model.numbers import fault, show

_COLUMNS = {2: ("X", "Z", "LX", "LZ"), 3: ("X", "Y", "Z", "LX", "LY", "LZ")}


def with_obstacles(
    kinds: Sequence[BinType],
    table: Table | None,
    dimension: int,
    factor: Fraction = Fraction(1),
    say: Say = silent,
) -> tuple[BinType, ...]:
    """The types of bins with the obstacles of a table.

    Args:
        kinds: types of bins.
        table: of obstacles; none if not given.
        dimension: 2 or 3.
        factor: what their lengths are multiplied with.
        say: takes a line for everything that was assumed.

    Raises:
        UserError: naming the row and the column.
    """
    if table is None:
        return tuple(kinds)
    obeyed = (*_COLUMNS[dimension], "BIN")
    table.need(_COLUMNS[dimension], obeyed)
    if others := [name for name in table.columns if name and name not in obeyed]:
        meant = [name for name in others if name.startswith("BIN")]
        if meant and "BIN" not in table.columns:
            raise fault(table.header, f"column {meant[0]} is not known; is BIN meant? Rename it")
        say(note(table.source, f"columns not used: {', '.join(others)[:60]}"))
    found = list[dict[str, Obstacle]]({} for _ in kinds)
    for row in plain_numbers(table, _COLUMNS[dimension], say).rows():
        obstacle = _obstacle(row, dimension, factor)
        for number in _bins(row, kinds):
            one = obstacle.checked(row.where, kinds[number].size, dimension)
            for where, other in found[number].items():
                if one.meets(other):
                    raise fault(row.where, f"overlaps the obstacle of {where}", "cut one of them")
            found[number][row.where] = one
    return tuple(
        replace(
            kind, limits=replace(kind.limits, obstacles=(*kind.limits.obstacles, *some.values()))
        )
        if some
        else kind
        for kind, some in zip(kinds, found, strict=True)
    )


def _obstacle(row: Row, dimension: int, factor: Fraction) -> Obstacle:
    def three(names: tuple[str, ...], flat: float) -> Sides:
        lengths = [
            row.size(name) if name.startswith("L") else row.number(name)
            for name in names
            if dimension == 3 or not name.endswith("Y")
        ]
        x, *y, z = lengths if factor == 1 else [float(exact(one) * factor) for one in lengths]
        return x, y[0] if y else flat, z

    return Obstacle(three(("X", "Y", "Z"), 0.0), three(("LX", "LY", "LZ"), 1.0))


def _bins(row: Row, kinds: Sequence[BinType]) -> list[int]:
    """Which types of bins the row is of."""
    name = row.text("BIN")
    if not name:
        return list(range(len(kinds)))
    if named := [number for number, kind in enumerate(kinds) if kind.name == name]:
        return named
    if name.isdecimal() and int(name) < len(kinds):
        return [int(name)]
    there = ", ".join(kind.name or str(number) for number, kind in enumerate(kinds))[:60]
    raise fault(row.at("BIN"), f"{show(name)} is no bin: there are {there}")
