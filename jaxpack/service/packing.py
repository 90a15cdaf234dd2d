"""The process of a worker: requests come in waves, each is answered as soon as it is packed."""

import json
import logging
import secrets
import signal
import traceback
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from http import HTTPStatus
from multiprocessing.connection import Connection
from typing import NamedTuple

from jaxpack.errors import UserError
from jaxpack.io.plans import plan_json
from jaxpack.io.viewer import shown_plan
from jaxpack.model.figures import levelled
from jaxpack.search.portfolio import SolveOptions
from jaxpack.search.record import Progress
from jaxpack.search.wave import pack_wave
from jaxpack.service.limits import Limits
from jaxpack.service.orders import BINS, ITEMS, Asked, read_request, wrong_order
from jaxpack.service.problems import Problem
from jaxpack.solution import solution

READY = "ready"
"""What a worker says when it is warm."""


class Request(NamedTuple):
    """What a worker is asked."""

    many: bool  # several orders
    body: bytes  # in JSON


class Page(NamedTuple):
    """What the page of a plan is made of."""

    title: str
    shown: str  # in JSON


@dataclass(frozen=True)
class Reply:
    """What a request is answered."""

    status: int
    body: bytes
    pages: dict[str, Page] = field(default_factory=dict)  # by the id of the plan
    bins: int = 0  # of all plans


def work(connection: Connection, limits: Limits) -> None:
    """Answers waves, see `answers`, with (number in the wave, `Reply`) until nobody asks."""
    for number in (signal.SIGINT, signal.SIGTERM):  # the service ends when it is done
        signal.signal(number, signal.SIG_IGN)
    example = json.dumps({"items": ITEMS, "bins": BINS}).encode()
    list(answers([Request(False, example)], 1, limits))
    try:
        connection.send(READY)
        while True:
            wave, asking = connection.recv()
            for answer in answers(wave, asking, limits):
                connection.send(answer)
    except (EOFError, OSError):
        return


def answers(wave: Sequence[Request], asking: int, limits: Limits) -> Iterator[tuple[int, Reply]]:
    """The number of each request and its reply; those of orders with equal options together.

    Args:
        wave: the requests.
        asking: requests that wait for a reply, these and others. The more, the fewer packings are
            tried for an order that asks for nothing.
        limits: of the requests.
    """
    results: dict[int, list[Asked | Progress | Problem]] = {}
    groups = defaultdict[SolveOptions, list[tuple[int, int]]](list)
    asked: dict[tuple[int, int], Asked] = {}
    for number, request in enumerate(wave):
        try:
            orders = read_request(*request, limits)
        except Problem as problem:
            yield number, Reply(problem.status, problem.body)
            continue
        results[number] = list(orders)
        asked |= {(number, n): one for n, one in enumerate(orders) if isinstance(one, Asked)}
    free = max(asking, sum(one.free for one in asked.values()))
    for place, one in asked.items():
        most = max(1, limits.packings // free) if one.free else one.how.packings
        groups[replace(one.how, packings=most)].append(place)
    waiting = {number: {at for at in asked if at[0] == number} for number in results}
    yield from _complete(wave, results, waiting, asked)
    for how, places in sorted(groups.items(), key=lambda group: _budget(*group)):
        packed = pack([asked[place] for place in places], how)
        for (number, n), found in zip(places, packed, strict=True):
            results[number][n] = found
            waiting[number].discard((number, n))
        yield from _complete(wave, results, waiting, asked)


def _budget(how: SolveOptions, places: Sequence[object]) -> tuple[float, float]:
    """What packs for less time comes first."""
    return (how.packings or 0) * len(places), how.seconds


def _complete(
    wave: Sequence[Request],
    results: dict[int, list[Asked | Progress | Problem]],
    waiting: dict[int, set[tuple[int, int]]],
    asked: dict[tuple[int, int], Asked],
) -> Iterator[tuple[int, Reply]]:
    """The replies to those that wait for no order any more."""
    for number in [number for number, places in waiting.items() if not places]:
        del waiting[number]
        given = [asked.get((number, n)) for n in range(len(results[number]))]
        yield number, _reply(wave[number].many, given, results.pop(number))


def pack(orders: Sequence[Asked], how: SolveOptions) -> list[Progress | Problem]:
    """For each order its last progress, or what is wrong with it."""
    try:
        found = pack_wave([order.job for order in orders], how)
    except Exception as error:  # a fault of this program: none but the order that has it ends
        if len(orders) > 1:
            return [one for order in orders for one in pack([order], how)]
        last = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{type(error).__name__} in {last.name}, line {last.lineno}"
        logging.getLogger("jaxpack").error("an order could not be packed: %s", what)
        return [Problem(HTTPStatus.INTERNAL_SERVER_ERROR, "a fault of this program")]
    late = Problem(HTTPStatus.GATEWAY_TIMEOUT, "no time was left: give fewer orders or more time")
    return [
        wrong_order(one) if isinstance(one, UserError) else late if one is None else one
        for one in found
    ]


def _reply(
    many: bool,
    given: Sequence[Asked | None],
    results: Sequence[Asked | Progress | Problem],
) -> Reply:
    bodies, pages, bins = [], {}, 0
    for order, found in zip(given, results, strict=True):
        if isinstance(found, Problem):
            bodies.append(found.body)
            continue
        assert order is not None
        assert isinstance(found, Progress), "it is packed"
        name = secrets.token_urlsafe(16)
        text, page = _plan(name, order, found)
        bodies.append(text)
        pages[name], bins = page, bins + found.bins
    if many:
        return Reply(HTTPStatus.OK, b"[\n" + b",\n".join(bodies) + b"]\n", pages, bins)
    status = results[0].status if isinstance(results[0], Problem) else HTTPStatus.OK
    return Reply(status, bodies[0], pages, bins)


def _plan(name: str, order: Asked, found: Progress) -> tuple[bytes, Page]:
    """The plan in JSON, with its id and what is known of it, and what its page is made of."""
    solved = solution(order.job, found, order.how.rules)
    job = levelled(order.job, found.plan)
    about = {
        "id": name,
        "page": f"/v1/plans/{name}.html",
        "status": solved.status.name.lower(),
        "lower_bound": solved.bound,
        "gap": None if solved.gap is None or solved.gap == float("inf") else round(solved.gap, 6),
        "packings": solved.packings,
        "notes": order.notes,
    }
    # Half a character, which JSON can name but UTF-8 cannot, stays its escape.
    text = plan_json(job, found.plan, order.how.rules, about).encode("utf-8", "backslashreplace")
    return text, Page(job.name or "Loading plan", shown_plan(job, found.plan))
