"""The messages of a page, and which requests of the public HTTP interface it may send."""

import re
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import Field, TypeAdapter, ValidationError

from piezod.client.wire import TIMEOUT_S, HttpRequest, http_request
from piezod.config.messages import describe
from piezod.messages.documents import Document
from piezod.messages.endpoints import LARGE_BODY, Endpoint
from piezod.messages.requests import TABLE
from piezod.web.errors import NOT_FOUND, PageError
from piezod.web.job_commands import (
    IdentifyJob,
    ImportJob,
    LearnJob,
    LookAtJob,
    PageMessage,
    ReplayJob,
    ScanJob,
)
from piezod.web.rows import RATE_HZ

LONGEST: Final = LARGE_BODY + 4096
"""Most bytes of a message: the largest body of a request, and what is around it."""
_PREFIX: Final = "/v1/"
_NOT_HERE: Final = frozenset({"telemetry", "stream", "session", "metrics", "fetch_recording"})
"""Endpoints whose request or answer is no JSON document."""
_CALLABLE: Final = {
    (row.method, _PREFIX + row.path): row for row in TABLE.values() if row.name not in _NOT_HERE
}
QUERY: Final = re.compile(r"[A-Za-z0-9_.,=&%-]{0,256}")


class ListStages(PageMessage):
    """List all stages of this machine."""

    do: Literal["stages"]


class Watch(PageMessage):
    """Send telemetry of a stage, in place of the stage that was watched before."""

    do: Literal["watch"]
    stage: str
    rate_hz: Annotated[float, Field(ge=1.0, le=RATE_HZ)] = RATE_HZ


class Unwatch(PageMessage):
    """Send no more telemetry."""

    do: Literal["unwatch"]


class CallStage(PageMessage):
    """Send a request to a stage."""

    do: Literal["call"]
    stage: str
    method: str
    path: str
    body: dict[str, Any] | None = None


class EmergencyStop(PageMessage):
    """Stop a stage in an emergency."""

    do: Literal["estop"]
    stage: str


class ReadRecording(PageMessage):
    """Read a part of a recording; `begin_s` and `end_s` are null for its begin and end."""

    do: Literal["contents", "view", "marks", "loop"]
    stage: str
    recording: Annotated[str, Field(max_length=200)]
    column: Annotated[str, Field(max_length=100)] = ""
    axis: Annotated[str, Field(max_length=100)] = ""
    begin_s: float | None = None
    end_s: float | None = None
    points: Annotated[int, Field(ge=4, le=8000)] = 2000


AnyMessage: TypeAlias = (
    ListStages
    | Watch
    | Unwatch
    | CallStage
    | EmergencyStop
    | ReadRecording
    | IdentifyJob
    | ImportJob
    | LearnJob
    | ScanJob
    | ReplayJob
    | LookAtJob
)
_READ: Final[TypeAdapter[AnyMessage]] = TypeAdapter(
    Annotated[AnyMessage, Field(discriminator="do")]
)


def read(text: str) -> AnyMessage:
    """Read a message.

    Raises:
        PageError: If it is not JSON, or no message; the text lists every problem.
    """
    try:
        return _READ.validate_json(text)
    except ValidationError as error:
        problems = []
        for found in error.errors(include_url=False, include_context=True):
            where = ".".join(str(part) for part in found["loc"][1:])
            problems.append(f"{where}: {describe(found, ())}" if where else found["msg"])
        what = "; ".join(problems)[:500]
        raise PageError("invalid", what, "docs/page.md has the messages") from error


def row_of(call: CallStage) -> Endpoint:
    """Return the row of the table of commands that a call is for.

    Raises:
        PageError: If a page may not send it.
    """
    path, _, query = call.path.partition("?")
    row = _CALLABLE.get((call.method, path))
    if row is None or not QUERY.fullmatch(query):
        what = f"{call.method[:8]} {call.path[:64]} is no request that a page may send"
        raise PageError(NOT_FOUND, what, "GET /v1/openapi lists all endpoints")
    return row


def http_request_of(call: CallStage, row: Endpoint, client: str) -> HttpRequest:
    """Return the request to a daemon.

    Raises:
        PageError: If the body has a number that is not finite.
    """
    connect_s, _, write_s, pool_s = TIMEOUT_S
    body: Document | None = None if row.method in ("GET", "DELETE") else call.body or {}
    try:
        return http_request(
            call.method,
            call.path.removeprefix(_PREFIX),
            client,
            body=body,
            timeout_s=(connect_s, row.answer_within_s, write_s, pool_s),
        )
    except ValueError as error:
        raise PageError("bad_json", f"the body is not JSON: {error}") from error
