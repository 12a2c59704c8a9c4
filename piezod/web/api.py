"""The HTTP interface of the stages for other computers: each request goes on to its daemon.

The daemon sees the user of this server, and a client `NAME@ADDRESS`. It checks everything, as for
its other clients; the token of a viewer is limited here.
"""

import asyncio
import re
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from math import inf
from typing import Final

from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from piezod.client.wire import HttpRequest, http_request, recording_path
from piezod.messages.endpoints import ENDPOINTS, Endpoint, Role
from piezod.messages.requests import TABLE
from piezod.web.access import role_of
from piezod.web.download import while_connected
from piezod.web.errors import (
    AMBIGUOUS,
    FORBIDDEN,
    NO_ANSWER,
    NOT_ALLOWED,
    NOT_FOUND,
    NOT_RUNNING,
    PageError,
    require,
)
from piezod.web.messages import QUERY
from piezod.web.stages import Stages

MOST: Final = 6
"""Requests in progress, among them streams and sessions. A daemon serves 16 connections of one
user, and the page needs up to 9."""
_TO_DAEMON: Final = ("accept", "content-type")
_FROM_DAEMON: Final = ("allow", "cache-control", "content-disposition", "content-length",
                       "content-type")  # fmt: skip
_TIMEOUT_S: Final = (2.0, inf, inf, inf)
"""The client has time-outs of its own, and a session has no answer to wait for."""
_STATUS: Final = {
    NOT_FOUND: 404,
    AMBIGUOUS: 409,
    FORBIDDEN: 403,
    NOT_ALLOWED: 403,
    NOT_RUNNING: 503,
    NO_ANSWER: 504,
}
_ROWS: Final = {(row.method, row.path): row for row in TABLE.values()}
_RECORDING: Final = re.compile(r"recordings/([^/]+)")


class Api:
    """Forwards requests to the daemons of this machine.

    Args:
        stages: All stages.
    """

    def __init__(self, stages: Stages) -> None:
        self._stages, self._running = stages, 0

    async def answer(self, request: Request) -> Response:
        """Return the answer to a request, or its refusal."""
        try:
            row, path = _endpoint(request)
            role = role_of(request.scope)
            require(role, row.access.role)
        except PageError as error:
            return _refused(error)
        if self._running >= MOST and not row.access.urgent:
            what = f"{self._running} requests of other computers are in progress, allowed: {MOST}"
            document = {"code": "too_many", "what": what, "remedy": "end some, or try again"}
            return JSONResponse({"error": document}, 429)
        if row.name == "status" and role < Role.ENGINEER:
            return await self._status(request.path_params.get("stage"), role)
        return _Forwarded(self, row, path)

    async def _status(self, stage: str | None, role: Role) -> Response:
        """Return the status with the role of the token: the daemon knows that of the user."""
        try:
            async with self._stages.visiting(stage) as connections:
                name = self._stages.client
                status = await connections.call(http_request("GET", TABLE["status"].path, name))
        except PageError as error:
            return _refused(error)
        return JSONResponse({**status, "role": role.name.lower()})

    async def forward(
        self, onwards: HttpRequest, stage: str | None, stack: AsyncExitStack
    ) -> Response:
        """Return the answer of a daemon.

        Args:
            onwards: The request to the daemon.
            stage: Name of the stage; None for the only one.
            stack: Closes the connection.
        """
        self._running += 1
        stack.callback(self._end)
        try:
            connections = await stack.enter_async_context(self._stages.visiting(stage))
            found = await stack.enter_async_context(connections.forwarded(onwards))
        except PageError as error:
            return _refused(error)
        names = {name.decode().lower(): value.decode("latin-1") for name, value in found.headers}
        headers: dict[str, str] = {name: names[name] for name in _FROM_DAEMON if name in names}
        return StreamingResponse(found.aiter_stream(), found.status, headers)

    def _end(self) -> None:
        self._running -= 1


class _Forwarded(Response):
    """The answer of a daemon, block by block. If the client disconnects, so does this server.

    Args:
        api: Forwards the request.
        row: Its endpoint.
        path: Its path below `/v1/`, with the query.
    """

    def __init__(self, api: Api, row: Endpoint, path: str) -> None:
        super().__init__()
        self._api, self._row, self._path = api, row, path

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the request to the daemon, and its answer to the client."""
        body = _Body(receive)
        if self._row.method != "POST":
            body.complete.set()
        onwards = _onwards(Request(scope), self._row, self._path, body)
        # After a part of the answer nothing can be said, but the connection closes.
        await while_connected(
            self._serve(onwards, body, scope, send),
            body.wait_for_end(),
            ClientDisconnect,
            PageError,
        )

    async def _serve(self, onwards: HttpRequest, body: "_Body", scope: Scope, send: Send) -> None:
        async with AsyncExitStack() as stack:
            stage = scope["path_params"].get("stage")
            answer = await self._api.forward(onwards, stage, stack)
            if not body.complete.is_set():  # a stream that the daemon refuses before its end
                answer.headers["connection"] = "close"
            await answer(scope, _never, send)


class _Body:
    """The body of a request, as it arrives.

    Args:
        receive: Of the request.

    Attributes:
        complete: Set when all has arrived.
    """

    def __init__(self, receive: Receive) -> None:
        self._receive = receive
        self.complete = asyncio.Event()

    async def __aiter__(self) -> AsyncIterator[bytes]:
        """Yield the body in pieces.

        Raises:
            ClientDisconnect: If the client disconnects before the end.
        """
        more = True
        while more:
            message = await self._receive()
            if message["type"] == "http.disconnect":
                raise ClientDisconnect
            more = message.get("more_body", False)
            yield message.get("body", b"")
        self.complete.set()

    async def wait_for_end(self) -> None:
        """Wait until the client disconnects, or has its answer."""
        await self.complete.wait()
        while (await self._receive())["type"] != "http.disconnect":
            pass


def _endpoint(request: Request) -> tuple[Endpoint, str]:
    """Return the row of a request, and its path below `/v1/` with the query.

    Raises:
        PageError: If there is no such endpoint.
    """
    path, query = request.path_params["path"], request.scope["query_string"].decode("latin-1")
    row = _ROWS.get((request.method, path))
    if row is None and request.method == "GET" and (found := _RECORDING.fullmatch(path)):
        row, path = ENDPOINTS["fetch_recording"], recording_path(found[1])
    if row is None or not QUERY.fullmatch(query):
        what = f"{request.method[:8]} /v1/{path[:64]} is no request of this interface"
        raise PageError(NOT_FOUND, what, "GET /v1/openapi lists all endpoints")
    return row, f"{path}?{query}" if query else path


def _onwards(request: Request, row: Endpoint, path: str, body: _Body) -> HttpRequest:
    address = request.client.host if request.client else ""
    name = f"{request.headers.get('x-piezod-client', '')}@{address}"
    onwards = http_request(row.method, path, name, timeout_s=_TIMEOUT_S)
    headers = request.headers
    onwards["headers"] += [(each, headers[each]) for each in _TO_DAEMON if each in headers]
    if row.method == "POST":
        onwards["content"] = body
    return onwards


def _refused(error: PageError) -> Response:
    status = _STATUS.get(error.document["code"], 502)
    return JSONResponse({"error": error.document}, status)


async def _never() -> dict[str, str]:
    """Wait for ever: `_Forwarded` itself notices that the client disconnects."""
    await asyncio.Event().wait()
    return {}
