"""What is wrong with a request, as problem details (RFC 9457)."""

import json
import re
from http import HTTPStatus

from starlette.responses import Response

from jaxpack.io.notes import note

MEDIA = "application/problem+json"
RETRY = 1  # seconds after which to try again what was refused for want of room
_PLACE = re.compile(r"(?:items|bins|order): row (\d+)(?:, column (\w+))?")
_ROW = re.compile(r"row (\d+)( of bins)?[ ,:(]")


class Problem(Exception):
    """Ends a request: its status, and in one line why."""

    def __init__(self, status: int, detail: str) -> None:
        super().__init__(detail)
        self.status, self.detail = status, detail

    @property
    def fields(self) -> dict[str, object]:
        """The members of the problem; `row` and `column`, from 0, where the line names them."""
        title, detail = HTTPStatus(self.status).phrase, note(self.detail)
        fields: dict[str, object] = {"title": title, "status": self.status, "detail": detail}
        if found := _PLACE.match(detail) or _ROW.match(detail):
            fields["row"] = int(found[1])
            if found.re is _PLACE and found[2]:
                fields["column"] = found[2]
        return fields

    @property
    def body(self) -> bytes:
        """The problem in JSON."""
        return json.dumps(self.fields).encode()

    def response(self) -> Response:
        """What is answered."""
        return respond(self.status, self.body)


def respond(status: int, body: bytes) -> Response:
    """JSON, of a problem where the status is one."""
    wrong = status >= HTTPStatus.BAD_REQUEST
    later = status in (HTTPStatus.TOO_MANY_REQUESTS, HTTPStatus.SERVICE_UNAVAILABLE)
    headers = {"Retry-After": str(RETRY)} if later else None
    return Response(body, status, headers, MEDIA if wrong else "application/json")
