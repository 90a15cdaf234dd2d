"""What the columns of a table of items or bins mean.

No column that says something about the packing is passed over without a word: what is nearly a
known column is an error, so is one of PackingSolver's that is not obeyed, and any other is named
in a note.
"""

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property

from jaxpack.errors import UserError
from jaxpack.io import foreign
from jaxpack.io.notes import Say, note, silent
from jaxpack.io.spreadsheets import plain_numbers
from jaxpack.io.tables import Table
from jaxpack.model.job import ORIENTATIONS
from jaxpack.model.numbers import fault, show
from jaxpack.model.objectives import Objective, named

SIDES = {2: ("WIDTH", "HEIGHT"), 3: ("X", "Y", "Z")}
ROTATIONS = {f"ROTATION_{name}": name for name in ORIENTATIONS}
NAMES = ("NAME", "ID")
UNITS = {  # of length -> mm
    **dict.fromkeys(("MM",), Fraction(1)),
    **dict.fromkeys(("CM",), Fraction(10)),
    **dict.fromkeys(("DM",), Fraction(100)),
    **dict.fromkeys(("M",), Fraction(1000)),
    **dict.fromkeys(("IN", "INCH", "INCHES"), Fraction(254, 10)),
    **dict.fromkeys(("FT", "FEET"), Fraction(3048, 10)),
}


@dataclass(frozen=True)
class Reading:
    """How tables are read."""

    ignore: frozenset[str] = frozenset()  # columns, in capitals, that are left out of account
    packingsolver: bool = False  # what is not said means what it does in PackingSolver
    say: Say = silent  # takes a line for everything that was assumed
    objective: str = ""  # of the job; see `Job.objective`
    obstacles: Table | None = None  # in the bins, see `jaxpack.io.obstacles`

    @cached_property
    def goal(self) -> Objective:
        """What is wanted, as far as it says which columns mean something."""
        return named(self.objective or "bins")


@dataclass(frozen=True)
class Kind:
    """What a table can say beside the sides."""

    numbers: tuple[str, ...]
    flags: Mapping[int, tuple[str, ...]]  # by dimension
    meant: dict[str, str]  # another word -> the column that says it
    foreign: Mapping[str, foreign.Harmless]
    texts: tuple[str, ...] = ()  # words so common that nothing like them is taken for them

    def columns(self, dimension: int) -> tuple[str, ...]:
        """All columns that are obeyed."""
        return (*SIDES[dimension], *self.numbers, *self.flags[dimension], *self.texts, *NAMES)

    def wanted(self, goal: Objective) -> "Kind":
        """With the columns that are obeyed for that objective."""
        obeyed = [name for name in goal.obeys if name in self.foreign]
        rest = {name: what for name, what in self.foreign.items() if name not in obeyed}
        if goal.leaves_out and "COPIES_MIN" in rest:
            rest["COPIES_MIN"] = foreign.zero
        meant = {word: column for word, column in _GOALS.items() if column in obeyed}
        numbers = (*self.numbers, *obeyed)
        return Kind(numbers, self.flags, self.meant | meant, rest, self.texts)


_COUNTS = ("QTY", "QUANTITY", "COUNT", "AMOUNT", "PIECES", "PCS", "NUMBER", "UNITS", "COPY")
_LOADS = (
    *("WEIGHT", "MAX_WEIGHT", "MAXWEIGHT", "WEIGHT_LIMIT", "WEIGHT_CAPACITY", "CAPACITY"),
    *("LOAD", "MAX_LOAD", "MAXIMUM_LOAD", "PAYLOAD"),
)
_LAST = ("QTY", "QUANTITY", "PIECES", "PCS", "PAYLOAD")
"""Words that mean the same at the end of a longer name. NUMBER, say, does not: an order has one."""

_GOALS = {"VALUE": "PROFIT", "WORTH": "PROFIT", "REVENUE": "PROFIT", "PRICE": "PROFIT"}

_ABOVE = ("WEIGHT_ABOVE", "MAX_WEIGHT_ABOVE", "LOAD_ABOVE", "MAX_LOAD_ABOVE")
_STOPS = ("STOP_NUMBER", "UNLOADING_ORDER", "DELIVERY_ORDER", "DROP")
_FLOORS = ("FLOOR_ONLY", "ON_FLOOR", "BOTTOM_ONLY", "GROUND_ONLY")
_STACKS = ("MAX_STACKABILITY", "MAX_STACK", "MAXIMUM_STACK", "STACK_LIMIT")

ITEMS = Kind(
    numbers=(
        *("COPIES", "WEIGHT", "MAXIMUM_WEIGHT_ABOVE", "STACKABLE", "MAXIMUM_STACKABILITY"),
        *("STACKABILITY_ID", "STOP", "FLOOR"),
    ),
    flags={2: ("ORIENTED",), 3: tuple(ROTATIONS)},
    meant={
        **dict.fromkeys(_COUNTS, "COPIES"),
        **dict.fromkeys(("MASS", "UNIT_WEIGHT"), "WEIGHT"),
        **dict.fromkeys(_ABOVE, "MAXIMUM_WEIGHT_ABOVE"),
        **dict.fromkeys(_STACKS, "MAXIMUM_STACKABILITY"),
        **dict.fromkeys(_STOPS, "STOP"),
        **dict.fromkeys(_FLOORS, "FLOOR"),
        **dict.fromkeys(("GROUPS", "KEEP_TOGETHER"), "GROUP"),
        **dict.fromkeys(("APARTS", "KEEP_APART"), "APART"),
    },
    foreign=foreign.OF_ITEMS,
    texts=("GROUP", "APART"),
)
TARIFF = ("COST_PER_WEIGHT", "DIVISOR", "OWN_WEIGHT")
BINS = Kind(
    numbers=("COST", "COPIES", "MAXIMUM_WEIGHT", "MAXIMUM_ITEMS", *TARIFF),
    flags={2: (), 3: ()},
    meant={
        **dict.fromkeys(("MAX_ITEMS", "ITEM_LIMIT"), "MAXIMUM_ITEMS"),
        **dict.fromkeys((*_COUNTS, "STOCK", "AVAILABLE"), "COPIES"),
        **dict.fromkeys(_LOADS, "MAXIMUM_WEIGHT"),
        **dict.fromkeys(("PRICE", "UNIT_COST"), "COST"),
        **dict.fromkeys(("TARE", "TARE_WEIGHT", "EMPTY_WEIGHT"), "OWN_WEIGHT"),
        **dict.fromkeys(("PRICE_PER_WEIGHT", "COST_PER_KG", "PRICE_PER_KG"), "COST_PER_WEIGHT"),
    },
    foreign=foreign.OF_BINS,
    texts=("BANDS",),
)

_UNIT = "|".join(UNITS)
_SIDE = re.compile(
    rf"(LENGTH|WIDTH|HEIGHT|DEPTH|X|Y|Z)(?:[ _]?[(\[] ?({_UNIT}) ?[)\]]|[ _/]({_UNIT}))?"
)
_SOLID = (
    ("LENGTH", "WIDTH", "HEIGHT"),
    ("LENGTH", "DEPTH", "HEIGHT"),
    ("WIDTH", "DEPTH", "HEIGHT"),
)
"""What some call the sides along x, y and z."""
_SUFFIX = re.compile(r"_(KGS?|G|LBS?|T|TONS?|EUR|USD|GBP)$")  # the unit of a weight or a cost
_LONG = 6  # letters of a word that few others resemble


@dataclass(frozen=True)
class Understood:
    """A table whose columns are those that are known."""

    table: Table
    dimension: int
    unit: str = ""  # of its lengths, a key of UNITS if it names one
    sides: tuple[str, ...] = field(default=())  # what it calls x, y and z if not so
    columns: frozenset[str] = frozenset()  # all there were

    @property
    def flags(self) -> tuple[str, ...]:
        """The columns that say how an item may be turned."""
        return tuple(name for name in ITEMS.flags[self.dimension] if name in self.table.columns)


def understand(table: Table, kind: Kind, reading: Reading) -> Understood:
    """The table with the sides named as SIDES, and numbers as programs write them.

    Raises:
        UserError: naming the column that is missing, twice there, misspelt or not obeyed.
    """
    there, kind = frozenset(table.columns), kind.wanted(reading.goal)
    kept = tuple("" if name in reading.ignore else name for name in table.columns)
    table, called, unit = _renamed(replace(table, columns=kept), reading.say)
    dimension = _dimension(table)
    obeyed = kind.columns(dimension)
    table.need(SIDES[dimension], obeyed)
    unknown = [
        name
        for name in dict.fromkeys(table.columns)
        if name not in obeyed and name not in reading.ignore
    ]
    for name in unknown:
        _check_misnamed(table, name, kind, dimension)
    numbers = (
        *SIDES[dimension],
        *kind.numbers,
        *(name for name in unknown if name in kind.foreign),
    )
    table = plain_numbers(table, numbers, reading.say)
    for name in unknown:
        if name in kind.foreign:
            for row in table.rows():
                foreign.check_foreign(row, name, kind.foreign[name])
    if others := [name for name in unknown if name and name not in kind.foreign]:
        more = f" and {len(others) - 9} more" if len(others) > 9 else ""
        names = ", ".join(name[:30] for name in others[:9])
        reading.say(note(table.source, f"columns not used: {names}{more}"))
    return Understood(table, dimension, unit, called, there)


def _renamed(table: Table, say: Say) -> tuple[Table, tuple[str, ...], str]:
    """The table with its sides called as they are known, what they were called, and their unit."""
    columns = table.columns
    if any(set(names) <= set(columns) for names in ((*SIDES[3],), (*SIDES[2],))) and not (
        set(SIDES[3]) - set(columns) and {"LENGTH", "DEPTH"} & set(columns)
    ):
        return table, (), ""
    found: dict[str, list[str]] = {}
    units: dict[str, str] = {}
    for name in columns:
        if match := _SIDE.fullmatch(name):
            found.setdefault(match[1], []).append(name)
            units[name] = match[2] or match[3] or ""
    called = _called(table, found)
    if not called:
        return table, (), ""
    named: dict[str, str] = {}
    for side, word in zip(SIDES[len(called)], called, strict=True):
        if len(found[word]) > 1:
            raise fault(table.header, f"columns {' and '.join(found[word])}: keep one of them")
        named[found[word][0]] = side
    unit = {units[name] for name in named}
    if len({UNITS.get(one) for one in unit}) > 1:
        raise fault(table.header, f"columns {', '.join(named)}: give all sides in one unit")
    told = ", ".join(f"{name} as {side}" for name, side in named.items() if name != side)
    say(note(table.source, f"read {told}"))
    renamed = tuple(named.get(name, name) for name in columns)
    words = called if called in _SOLID else ()
    return replace(table, columns=renamed), words, next(iter(unit))


def _called(table: Table, found: Mapping[str, object]) -> tuple[str, ...]:
    """Which of the columns' words are the sides, by axis; none if they are not all there."""
    solid = [words for words in (SIDES[3], *_SOLID) if set(words) <= set(found)]
    if len(solid) > 1:
        what = f"{', '.join(found)}: which are the three sides?"
        raise fault(table.header, what, "name them X, Y and Z")
    if solid:
        return solid[0]
    flat = set(SIDES[2]) <= set(found) and not {"LENGTH", "DEPTH"} & set(found)
    return SIDES[2] if flat else ()


def _dimension(table: Table) -> int:
    """2 or 3: the one whose columns are there."""
    found = [d for d, names in SIDES.items() if set(names) <= set(table.columns)]
    if len(found) == 2:
        raise fault(table.header, "columns of 2D (WIDTH, HEIGHT) and of 3D (X, Y, Z): keep either")
    if not found:
        # The one of which most is there or misspelt is meant.
        likeness = {
            d: sum(
                2 * (n in table.columns) + bool(difflib.get_close_matches(n, table.columns))
                for n in names
            )
            for d, names in SIDES.items()
        }
        if not any(likeness.values()):
            there = ", ".join(table.columns)[:60] or "none"
            what = f"columns WIDTH, HEIGHT (2D) or X, Y, Z (3D) are missing: there are {there}"
            raise fault(table.header, what)
        found = [max(likeness, key=lambda d: likeness[d])]
        table.need(SIDES[found[0]])
    return found[0]


def _check_misnamed(table: Table, name: str, kind: Kind, dimension: int) -> None:
    """Refuses a column that says in other words what a known one says."""
    if name in kind.foreign:
        return
    flags = kind.flags[dimension]
    of_other = kind.flags[5 - dimension]
    if flags and (name in of_other or "ROTAT" in name):  # to ignore it would forbid
        place = f" in {dimension}D" if name in of_other else ""  # what it allows
        raise fault(table.header, f"column {name} is not known{place}", f"use {', '.join(flags)}")
    meant = _meant(name, kind, flags)
    if meant and meant not in table.columns:
        advice = f"Rename it, or leave it out of account with --ignore {show(name)}"
        raise fault(table.header, f"column {name} is not known; is {meant} meant? {advice}")


def _meant(name: str, kind: Kind, flags: tuple[str, ...]) -> str:
    """The known column that a name says in other words, misspelt or at its end; "" if none."""
    bare = re.sub(r"(?<=.)[(\[].*", "", name)  # behind a bracket is a unit
    bare = _SUFFIX.sub("", re.sub(r"[^A-Z0-9]+", "_", bare).strip("_"))
    words = {column: column for column in (*kind.numbers, *flags)} | kind.meant
    for word in (bare, bare.removesuffix("S")):
        if word in words:
            return words[word]
    for word in (*kind.numbers, *_LAST):
        if word in words and bare.endswith(f"_{word}"):
            return words[word]
    if len(bare) >= 30 or _SIDE.fullmatch(bare):
        return ""
    close = difflib.get_close_matches(bare, (*kind.numbers, *flags), 1, 0.8)
    long = [word for word in kind.meant if len(word) >= _LONG]
    close = close or difflib.get_close_matches(bare, long, 1, 0.85)
    return words[close[0]] if close else ""


def same_unit(items: Understood, bins: Understood, say: Say) -> Fraction:
    """What the lengths of the bins are multiplied with to be in the unit of the items.

    Raises:
        UserError: where the two do not mean the same by their columns.
    """
    if items.sides and bins.sides and items.sides != bins.sides:
        called = f"sides {', '.join(bins.sides)}, but those of the items are"
        raise fault(bins.table.header, f"{called} {', '.join(items.sides)}", "call them alike")
    if items.unit and bins.unit:
        factor = UNITS[bins.unit] / UNITS[items.unit]
        if factor != 1:
            what = f"lengths in {bins.unit} are read as {items.unit}, that of the items"
            say(note(bins.table.source, f"{what}: times {_shown(factor)}"))
        return factor
    if items.unit or bins.unit:
        one, other = (items, bins) if items.unit else (bins, items)
        say(note(other.table.source, f"lengths are taken to be in {one.unit} too"))
    return Fraction(1)


def _shown(factor: Fraction) -> str:
    return str(factor) if factor.denominator > 1000 else f"{float(factor):g}"


def check_ignored(reading: Reading, *tables: Understood) -> None:
    """Refuses to ignore a column that is nowhere: it may be misspelt.

    Raises:
        UserError: naming it.
    """
    there = frozenset[str]().union(*(table.columns for table in tables))
    for name in sorted(reading.ignore - there):
        found = ", ".join(sorted(there))[:60] or "none"
        raise UserError(f"--ignore {show(name)}: there is no such column: there are {found}")
