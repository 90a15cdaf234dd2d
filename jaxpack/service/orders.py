"""Orders in JSON: what they may say, read so that every error says where it is."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from http import HTTPStatus
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, WithJsonSchema

from jaxpack.errors import UserError
from jaxpack.io.jobs import job_from_columns
from jaxpack.io.texts import parse_json
from jaxpack.model.job import Job
from jaxpack.model.limits import MOST_OBSTACLES
from jaxpack.model.numbers import fault
from jaxpack.model.rules import Rules
from jaxpack.search.portfolio import SolveOptions
from jaxpack.service.limits import Limits
from jaxpack.service.problems import Problem
from jaxpack.solution import checked_options

MANY = 1_000_000  # packings: more than there is time for

ITEMS = [
    {"X": 210, "Y": 297, "Z": 30, "COPIES": 4, "WEIGHT": 0.6, "NAME": "book"},
    {"X": 120, "Y": 80, "Z": 60, "COPIES": 2, "ROTATION_XYZ": 1, "ROTATION_YXZ": 1},
]
BINS = [{"X": 310, "Y": 230, "Z": 160, "NAME": "S"}, {"X": 400, "Y": 300, "Z": 200, "NAME": "M"}]

_CELL = {"type": ["string", "number", "boolean", "null"]}
Table = Annotated[
    Any,
    WithJsonSchema({
        "description": "A table with the columns of the CSV files: a list of rows, or columns.",
        "oneOf": [
            {"type": "array", "items": {"type": "object", "additionalProperties": _CELL}},
            {"type": "object", "additionalProperties": {"type": "array", "items": _CELL}},
        ],
    }),
]  # fmt: skip


Model = TypeVar("Model", bound=BaseModel)


class _Given(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


RULES = {field.name for field in fields(Rules)}


class Options(_Given):
    """How to pack."""

    time_limit: float | None = Field(default=None, description="seconds for the search")
    packings: int | None = Field(
        default=None, description="that are tried at most: the same seed gives the same plan then"
    )
    seed: int = SolveOptions.seed
    support: float = Field(
        default=Rules.support, description="share of a base of which more has to be carried"
    )
    stability: str = Field(default=Rules.stability, description="share, centre or static")
    gap: float = Field(default=Rules.gap, description="between items beside each other")
    overhang: float = Field(
        default=Rules.overhang, description="how far items may reach out over the floor"
    )
    door: str = Field(default=Rules.door, description="x: items come in along x, not from above")
    balance: float | None = Field(
        default=Rules.balance, description="middle share of the floor for the centre of mass"
    )
    heavy_below: bool = Field(
        default=Rules.heavy_below, description="no item may lie on a lighter one"
    )
    objective: str = Field(default="", description="bins, price, value or height")
    skip_unfit: bool = Field(default=False, description="leave out what no bin can hold")


class Order(_Given):
    """One order: items, and the bins for them."""

    items: Table
    bins: Table
    obstacles: Table = None
    options: Options = Options()
    name: str = Field(default="", max_length=200)


class PartOfMany(_Given):
    """An order of several: what it does not say, the request says for all."""

    items: Table
    bins: Table = None
    obstacles: Table = None
    options: Options | None = None
    name: str = Field(default="", max_length=200)


class Orders(_Given):
    """Several orders, with bins and options for those that have none of their own."""

    orders: list[Any] = Field(description="each an object with items, and a name if it has one")
    bins: Table = None
    obstacles: Table = None
    options: Options = Options()


@dataclass(frozen=True)
class Asked:
    """An order that has been read."""

    job: Job
    how: SolveOptions
    free: bool  # whether the service chooses how many packings are tried
    notes: tuple[str, ...]  # what was assumed of the tables, a line each


def read_request(many: bool, body: bytes, limits: Limits) -> list[Asked | Problem]:
    """The orders of a request, or what is wrong with each of them.

    Args:
        many: whether it is `Orders`, not an `Order`.
        body: in JSON.
        limits: of its orders.

    Raises:
        Problem: with the request as a whole.
    """
    data = _parsed(body)
    if not many:
        return [_read(_checked(Order, data), limits)]
    shared = _checked(Orders, data)
    if len(shared.orders) > limits.orders:
        what = f"orders: {len(shared.orders)} of them, more than {limits.orders}: split the request"
        raise _wrong(what)
    return [_part(order, shared, limits) for order in shared.orders]


def _part(data: Any, shared: Orders, limits: Limits) -> Asked | Problem:
    try:
        part = _checked(PartOfMany, data)
        order = Order.model_construct(
            items=part.items,
            bins=shared.bins if part.bins is None else part.bins,
            obstacles=shared.obstacles if part.obstacles is None else part.obstacles,
            options=part.options or shared.options,
            name=part.name,
        )
        return _read(order, limits)
    except Problem as problem:
        return problem


def _parsed(body: bytes) -> Any:
    def refuse(name: str) -> None:
        raise ValueError(f"{name} is no number in JSON")

    try:
        return parse_json(body.decode("utf-8"), "body", refuse)
    except UnicodeDecodeError:
        raise Problem(HTTPStatus.BAD_REQUEST, "body: not UTF-8") from None
    except UserError as error:
        raise Problem(HTTPStatus.BAD_REQUEST, str(error)) from None


def _checked(model: type[Model], data: Any) -> Model:
    try:
        return model.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where = ".".join(map(str, first["loc"])) or "body"
        raise _wrong(f"{where}: {first['msg']}") from None


def _read(order: Order, limits: Limits) -> Asked:
    """Raises Problem: the UserError of what is wrong."""
    options, notes = order.options, list[str]()
    try:
        for name, table, most in (
            ("items", order.items, limits.items),
            ("bins", order.bins, limits.bins),
            ("obstacles", order.obstacles, MOST_OBSTACLES),
        ):
            if table is not None or name != "obstacles":
                _check_cells(name, table, most)
        job = job_from_columns(
            order.items,
            order.bins,
            order.name,
            obstacles=order.obstacles,
            objective=options.objective,
            say=notes.append,
        )
        if job.count > limits.items:
            raise fault("items", f"{job.count:,}, more than {limits.items:,}: split the order")
        how = SolveOptions(
            options.time_limit,
            options.seed,
            Rules(**options.model_dump(include=RULES)),
            skip_unfit=options.skip_unfit,
            packings=options.packings,
        )
        how = checked_options(how, job)
    except UserError as error:
        raise wrong_order(error) from None
    free = how.time_limit is None and how.packings is None
    return Asked(job, _capped(how, limits), free, tuple(notes))


def _capped(how: SolveOptions, limits: Limits) -> SolveOptions:
    """With an end of both kinds: without packings a search of its own would begin at last."""
    seconds = limits.time_limit if how.time_limit is None else how.time_limit
    return replace(
        how,
        time_limit=min(seconds, limits.time_limit),
        packings=MANY if how.packings is None else min(how.packings, MANY),
    )


def _check_cells(name: str, table: Any, most: int) -> None:
    """Raises UserError where there are too many rows, or a cell is a list or an object."""
    if isinstance(table, Mapping):
        cells: Iterable[tuple[int, object, object]] = (
            (row, column, cell)
            for column, values in table.items()
            if isinstance(values, list)
            for row, cell in enumerate(values)
        )
        rows = max((len(v) for v in table.values() if isinstance(v, list)), default=0)
    elif isinstance(table, Sequence) and all(isinstance(row, Mapping) for row in table):
        cells = ((n, column, cell) for n, row in enumerate(table) for column, cell in row.items())
        rows = len(table)
    else:
        raise fault(name, "not a table: give a list of objects, or an object of lists")
    if rows > most:
        raise fault(name, f"{rows:,} rows, more than {most:,}: split the order")
    for row, column, cell in cells:
        if isinstance(cell, list | dict):
            what = "a list or an object is no value: give a number or a text"
            raise fault(f"{name}: row {row}, column {column}", what)


def wrong_order(error: UserError) -> Problem:
    """The problem of an order that cannot be packed; what it calls options is what they are."""
    return _wrong(re.sub("--(skip-unfit|objective)", _as_option, str(error)))


def _as_option(found: re.Match[str]) -> str:
    return f"option {found[1].replace('-', '_')}"


def _wrong(detail: str) -> Problem:
    return Problem(HTTPStatus.UNPROCESSABLE_ENTITY, detail)
