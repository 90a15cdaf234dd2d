"""The service: what it answers at which address."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from http import HTTPStatus
from importlib import resources
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import HTTPException, RequestValidationError
from prometheus_client import CONTENT_TYPE_LATEST
from pydantic import BaseModel
from starlette.exceptions import HTTPException as PlainHTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response
from starlette.staticfiles import StaticFiles

from jaxpack import __version__
from jaxpack.io.viewer import html_page
from jaxpack.service import packing
from jaxpack.service.limits import Limits
from jaxpack.service.metrics import Metrics
from jaxpack.service.middleware import NOTHING, Measured
from jaxpack.service.orders import BINS, ITEMS, Order, Orders
from jaxpack.service.pages import Pages
from jaxpack.service.problems import MEDIA, Problem, respond
from jaxpack.service.workers import Workers

OWN = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
PAGE = (
    f"{OWN}; script-src 'self'; style-src 'self'; connect-src 'self'; frame-src 'self'; "
    "img-src data:"  # the icon, which is none
)
DOCS = (
    f"{OWN}; script-src 'self'; connect-src 'self'; img-src 'self' data:; "
    "style-src 'self' 'unsafe-inline'"
)
PLAN = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; frame-ancestors 'self'"
)
"""What the pages may do: a plan's has names from a request in it, and nothing of the service."""
FILES = {
    "/": ("page.html", "text/html", PAGE),
    "/page.js": ("page.js", "text/javascript", NOTHING),
    "/page.css": ("page.css", "text/css", NOTHING),
    "/docs": ("docs.html", "text/html", DOCS),
    "/docs.js": ("docs.js", "text/javascript", NOTHING),
}
"""Address -> file, its type, what it may do."""


ORDER = {"items": ITEMS, "bins": BINS}
ORDERS = {
    "bins": BINS,
    "orders": [{"name": "1", "items": ITEMS}, {"name": "2", "items": ITEMS[1:]}],
}


def make_app(limits: Limits) -> FastAPI:
    """The service as an ASGI app; its workers live as long as its lifespan."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        async with Workers(limits) as app.state.workers:
            yield

    app = FastAPI(
        title="jaxpack",
        version=__version__,
        description="Orders in, loading plans out.",
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
    )
    app.state.limits, app.state.metrics = limits, Metrics()
    app.state.pages, app.state.admitted = Pages(limits.kept), 0
    app.add_middleware(Measured, metrics=app.state.metrics)
    _add_problems(app)
    _add_orders(app)
    _add_state(app)
    _add_files(app)
    return app


def _add_problems(app: FastAPI) -> None:
    async def problem(_: Request, error: Exception) -> Response:
        assert isinstance(error, Problem)
        return error.response()

    async def refused(_: Request, error: Exception) -> Response:
        status = error.status_code if isinstance(error, PlainHTTPException) else 422
        response = Problem(status, HTTPStatus(status).phrase).response()
        response.headers.update(getattr(error, "headers", None) or {})
        return response

    async def fault(_: Request, __: Exception) -> Response:
        return Problem(HTTPStatus.INTERNAL_SERVER_ERROR, "a fault of this program").response()

    app.add_exception_handler(Problem, problem)
    for kind in (PlainHTTPException, HTTPException, RequestValidationError):
        app.add_exception_handler(kind, refused)
    app.add_exception_handler(Exception, fault)


async def _body(request: Request, most: int) -> bytes:
    """The body of a request in JSON. Raises Problem where it is too long, or something else."""
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise Problem(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "give Content-Type: application/json")
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > most:
            what = f"body: more than {most:,} bytes: split the request"
            raise Problem(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, what)
    return bytes(body)


async def _answer(request: Request, many: bool) -> Response:
    """Admits a request, has it packed, and keeps its pages."""
    state = request.app.state
    limits: Limits = state.limits
    if state.admitted >= limits.queue:
        what = f"{limits.queue} requests are not answered yet: try again later"
        raise Problem(HTTPStatus.TOO_MANY_REQUESTS, what)
    state.admitted += 1
    state.metrics.queue.set(state.admitted)
    try:
        async with asyncio.timeout(limits.deadline):
            body = await _body(request, limits.body)
            reply = await state.workers.ask(packing.Request(many, body))
    except TimeoutError:
        what = f"no answer in {limits.deadline:g} s: give fewer items, or try again later"
        raise Problem(HTTPStatus.GATEWAY_TIMEOUT, what) from None
    except ClientDisconnect:
        raise Problem(HTTPStatus.BAD_REQUEST, "body: it ends early") from None
    finally:
        state.admitted -= 1
        state.metrics.queue.set(state.admitted)
    state.pages.keep(reply.pages)
    state.metrics.orders.inc(len(reply.pages))
    state.metrics.bins.inc(reply.bins)
    return respond(reply.status, reply.body)


def _described(
    model: type[BaseModel], example: dict[str, Any], answer: dict[str, Any]
) -> dict[str, Any]:
    """What a route says of its request and its answers in OpenAPI."""
    schema = model.model_json_schema()
    parts = schema.pop("$defs", {})
    schema["properties"]["options"] = parts["Options"]  # a part of it has no address in OpenAPI
    problem = {
        "type": "object",
        "properties": {
            "title": {"type": "string"},
            "status": {"type": "integer"},
            "detail": {"type": "string"},
            "row": {"type": "integer"},
            "column": {"type": "string"},
        },
    }
    wrong = {status: HTTPStatus(status).phrase for status in (400, 413, 415, 422, 429, 503, 504)}
    return {
        "requestBody": {
            "required": True,
            "content": {"application/json": {"schema": schema, "example": example}},
        },
        "responses": {
            "200": {"description": "OK", "content": {"application/json": {"schema": answer}}},
            **{
                str(status): {"description": name, "content": {MEDIA: {"schema": problem}}}
                for status, name in wrong.items()
            },
        },
    }


PLAN_SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {
        **{name: {"type": "string"} for name in ("id", "page", "status", "job")},
        **{name: {"type": "integer"} for name in ("lower_bound", "packings", "dimension")},
        "gap": {"type": ["number", "null"]},
        "notes": {"type": "array", "items": {"type": "string"}},
        **{name: {"type": "array", "items": {"type": "object"}} for name in ("bins", "left_out")},
    },
}
"""The plan of an order; `solve --out plan.json` writes the same from `job` on."""


def _add_orders(app: FastAPI) -> None:
    several = {"type": "array", "items": PLAN_SCHEMA}

    @app.post("/v1/solve", openapi_extra=_described(Order, ORDER, PLAN_SCHEMA))
    async def solve(request: Request) -> Response:
        """The plan of an order."""
        return await _answer(request, many=False)

    @app.post("/v1/solve-many", openapi_extra=_described(Orders, ORDERS, several))
    async def solve_many(request: Request) -> Response:
        """The plans of several orders, in their order; of one that is wrong, what is."""
        return await _answer(request, many=True)

    @app.get("/v1/plans/{name}.html")
    def page(name: str) -> Response:
        """The page of a plan, as long as it is kept."""
        found = app.state.pages.get(name)
        if found is None:
            raise Problem(HTTPStatus.NOT_FOUND, "no such plan, or not kept any more")
        headers = {"Content-Security-Policy": PLAN, "Cache-Control": "private, max-age=600"}
        return Response(html_page(*found), headers=headers, media_type="text/html")


def _add_state(app: FastAPI) -> None:
    @app.get("/healthz")
    async def healthy() -> dict[str, str]:
        """Whether the service answers at all."""
        return {"status": "ok"}

    @app.get("/readyz")
    async def ready() -> dict[str, str]:
        """Whether its workers are warm."""
        if not app.state.workers.ready:
            raise Problem(HTTPStatus.SERVICE_UNAVAILABLE, "the workers are starting")
        return {"status": "ready"}

    @app.get("/metrics")
    async def metrics() -> Response:
        """What it counts, for Prometheus."""
        return Response(app.state.metrics.text(), media_type=CONTENT_TYPE_LATEST)


def _add_files(app: FastAPI) -> None:
    own = resources.files("jaxpack.service")

    def add(address: str, file: str, kind: str, policy: str) -> None:
        body = own.joinpath(file).read_bytes()

        @app.get(address, include_in_schema=False)
        async def whole() -> Response:
            return Response(body, headers={"Content-Security-Policy": policy}, media_type=kind)

    for address, about in FILES.items():
        add(address, *about)
    app.mount("/docs-files", StaticFiles(packages=[("fastapi_offline", "static")]))
