"""HTTP details that both clients share: addresses, headers, bodies and answers."""

import json
import ssl
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final, TypeVar
from urllib.parse import quote

from piezod.client.calls import ANSWER_WITHIN_S, Call
from piezod.client.errors import error_of, unexpected
from piezod.client.results import Document
from piezod.config.endpoints import ENDPOINTS
from piezod.errors import RefusedError

if TYPE_CHECKING:
    import httpx

BASE_URL: Final = "http://piezod/v1/"
"""On a unix socket the host name has no meaning."""
TIMEOUT_S: Final = (2.0, ANSWER_WITHIN_S, 10.0, 10.0)
"""To connect, read, write, and get a connection of the pool, in s."""
TELEMETRY: Final = ENDPOINTS["telemetry"].path
STREAM: Final = ENDPOINTS["stream"].path
SESSION: Final = ENDPOINTS["session"].path
NDJSON: Final = {"Content-Type": "application/x-ndjson"}
WAITING_RATE_HZ: Final = 20.0
"""Rate of telemetry while a method waits for a movement, in Hz."""

ResultT = TypeVar("ResultT")


def no_tls() -> ssl.SSLContext:
    """Return an empty context, so that httpx loads no certificates: a unix socket needs none."""
    return ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)


def headers(name: str) -> dict[str, str]:
    """Return the headers of every request of a client."""
    return {"X-Piezod-Client": name}


def timeout_s(call: Call[Any]) -> tuple[float, float, float, float]:
    """Return the time-outs of a call, in the order of `TIMEOUT_S`."""
    connect_s, _, write_s, pool_s = TIMEOUT_S
    return connect_s, call.answer_within_s, write_s, pool_s


def telemetry_query(rate_hz: float, axes: Sequence[str]) -> dict[str, str]:
    """Return the query of a telemetry stream."""
    query = {"rate_hz": f"{rate_hz:g}"}
    return {**query, "axes": ",".join(axes)} if axes else query


def recording_path(name: str) -> str:
    """Return the path of a recording."""
    return ENDPOINTS["fetch_recording"].path.format(name=quote(name, safe=""))


def setpoint_line(setpoints_um: Mapping[str, float]) -> bytes:
    """Return one line of a setpoint stream.

    Raises:
        RefusedError: If a setpoint is not finite.
    """
    try:
        return json.dumps(dict(setpoints_um), allow_nan=False).encode() + b"\n"
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


def read_answer(call: Call[ResultT], response: "httpx.Response") -> ResultT:
    """Return the result of a complete answer.

    Raises:
        ClientError: If the answer is an error, or has an unexpected form.
    """
    return call.read(read_document(response, call.also_fine))


def read_document(response: "httpx.Response", also_fine: int = 200) -> Document:
    """Return the JSON object of a complete answer.

    Raises:
        ClientError: If the answer is an error, or not an object.
    """
    if response.status_code != also_fine:
        check(response)
    try:
        document = response.json()
    except ValueError as error:
        raise unexpected(response.content, str(error)) from error
    if not isinstance(document, dict):
        raise unexpected(document, "must be an object")
    return document


def check(response: "httpx.Response") -> None:
    """Raise the error of a complete answer, if it is one.

    Raises:
        ClientError: If the HTTP status is an error.
    """
    if response.is_error:
        raise error_of(response.status_code, response.content)
