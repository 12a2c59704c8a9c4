"""HTTP details that both clients share: addresses, headers, bodies and answers."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final, TypedDict, TypeVar
from urllib.parse import quote, urlencode

from piezod.client.calls import Call
from piezod.client.errors import error_of, unexpected
from piezod.client.place import Place
from piezod.errors import RefusedError
from piezod.messages.documents import Document
from piezod.messages.endpoints import ANSWER_WITHIN_S, ENDPOINTS

if TYPE_CHECKING:
    import ssl

    import httpcore

_HERE: Final = Place()
TIMEOUT_S: Final = (2.0, ANSWER_WITHIN_S, 10.0, 10.0)
"""To connect, read, write, and get a connection of the pool, in s."""
_TELEMETRY: Final = ENDPOINTS["telemetry"].path
STREAM: Final = ENDPOINTS["stream"].path
SESSION: Final = ENDPOINTS["session"].path
_JSON: Final = "application/json"
_NDJSON: Final = "application/x-ndjson"
WAITING_RATE_HZ: Final = 20.0
"""Rate of telemetry while a method waits for a movement, in Hz."""

ResultT = TypeVar("ResultT")


class PoolOptions(TypedDict):
    """Arguments of a pool of httpcore."""

    uds: str | None
    ssl_context: "ssl.SSLContext | None"
    max_connections: int
    keepalive_expiry: float


class HttpRequest(TypedDict):
    """Arguments of `request` and `stream` of a pool of httpcore."""

    method: str
    url: str
    headers: list[tuple[bytes | str, bytes | str]]
    content: Any
    extensions: dict[str, Any]


def pool_options(place: Place) -> PoolOptions:
    """Return the options of the connections of a client; a task of asyncio may need several.

    Raises:
        ClientError: If the certificates to trust cannot be read.
    """
    return {
        "uds": str(place.socket) if place.socket else None,
        "ssl_context": place.trusted(),
        "max_connections": 100,
        "keepalive_expiry": 5.0,
    }


def http_request(
    method: str,
    path: str,
    client: str,
    *,
    body: Document | None = None,
    lines: object = None,
    timeout_s: tuple[float, float, float, float] = TIMEOUT_S,
    place: Place = _HERE,
) -> HttpRequest:
    """Return a request to a daemon.

    Args:
        method: HTTP method.
        path: Path below `/v1/`, with the query.
        client: Name of the client.
        body: Document to send; None for none.
        lines: Lines to send in place of a document, as an iterable of bytes.
        timeout_s: Time-outs, in the order of `TIMEOUT_S`.
        place: Where the daemon is reached; which socket does not matter.
    """
    # As bytes: the daemon refuses characters that are not allowed, with the reason.
    headers: list[tuple[bytes | str, bytes | str]] = [
        ("X-Piezod-Client", client.encode()),
        *place.headers,
    ]
    content: object = lines
    if body is not None:
        content = json.dumps(body, ensure_ascii=False, allow_nan=False).encode(
            errors="backslashreplace"
        )
    if content is not None:
        headers.append(("Content-Type", _JSON if lines is None else _NDJSON))
    timeouts = zip(("connect", "read", "write", "pool"), timeout_s, strict=True)
    return {
        "method": method,
        "url": f"{place.url}/v1/{path}",
        "headers": headers,
        "content": content,
        "extensions": {"timeout": dict(timeouts)},
    }


def request_of(call: Call[Any], client: str, place: Place = _HERE) -> HttpRequest:
    """Return the request of a call."""
    connect_s, _, write_s, pool_s = TIMEOUT_S
    read_s = call.answer_within_s or call.endpoint.answer_within_s
    timeout_s = connect_s, read_s, write_s, pool_s
    request = http_request(
        call.method, call.path, client, body=call.body, timeout_s=timeout_s, place=place
    )
    if call.endpoint.answer == "str":
        request["headers"].append(("Accept", "text/plain"))
    return request


def telemetry_path(rate_hz: float, axes: Sequence[str]) -> str:
    """Return the path of a telemetry stream, with its query."""
    query = {"rate_hz": f"{rate_hz:g}"} | ({"axes": ",".join(axes)} if axes else {})
    return f"{_TELEMETRY}?{urlencode(query)}"


def recording_path(name: str) -> str:
    """Return the path of a recording."""
    return ENDPOINTS["fetch_recording"].path.format(name=quote(name, safe=""))


def setpoint_line(setpoints_um: Mapping[str, float]) -> bytes:
    """Return one line of a setpoint stream.

    Raises:
        RefusedError: If a setpoint is not finite.
    """
    try:
        return (
            json.dumps(dict(setpoints_um), allow_nan=False).encode(errors="backslashreplace")
            + b"\n"
        )
    except ValueError as error:
        what = f"setpoints must be finite (got {dict(setpoints_um)})"
        raise RefusedError(what, code="value") from error


@contextmanager
def whole_file(file: Path) -> Iterator[BinaryIO]:
    """Open a file that replaces the one of its name when it is complete.

    Raises:
        OSError: If the file cannot be written.
    """
    partial = file.with_name(f".{file.name}.part")
    try:
        with partial.open("wb") as opened:
            yield opened
        partial.replace(file)
    finally:
        partial.unlink(missing_ok=True)


def read_answer(call: Call[ResultT], response: "httpcore.Response") -> ResultT:
    """Return the result of a complete answer.

    Raises:
        ClientError: If the answer is an error, or has an unexpected form.
    """
    if call.endpoint.answer == "str":
        check(response)
        return call.read(response.content.decode(errors="replace"))
    return call.read(read_document(response, call.endpoint.also_fine))


def read_document(response: "httpcore.Response", also_fine: int = 200) -> Document:
    """Return the JSON object of a complete answer.

    Raises:
        ClientError: If the answer is an error, or not an object.
    """
    if response.status != also_fine:
        check(response)
    try:
        document = json.loads(response.content)
    except ValueError as error:
        raise unexpected(response.content, str(error)) from error
    if not isinstance(document, dict):
        raise unexpected(document, "must be an object")
    return document


def check(response: "httpcore.Response") -> None:
    """Raise the error of a complete answer, if it is one.

    Raises:
        ClientError: If the HTTP status is an error.
    """
    if is_error(response):
        raise error_of(response.status, response.content)


def is_error(response: "httpcore.Response") -> bool:
    """Return whether an answer, which need not be complete, is an error."""
    return response.status >= 400
