"""The connections to the daemon of one stage: for calls, for stops, for recordings."""

from collections.abc import AsyncGenerator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Final

import httpcore

from piezod.client.calls import Call
from piezod.client.daemon_link import DaemonLink, ResultT
from piezod.client.errors import translated
from piezod.client.place import Place
from piezod.client.places import check_socket
from piezod.client.wire import (
    HttpRequest,
    http_request,
    is_error,
    read_answer,
    recording_path,
    request_of,
)
from piezod.errors import ClientError
from piezod.messages.documents import Document
from piezod.messages.requests import TABLE
from piezod.web.errors import document_of, of_answer, of_connection

_CALLS: Final = 6
"""Connections for calls. A daemon serves 16 of one user, who may have other programs."""
_URGENT: Final = 2
_UNHEALTHY: Final = 503
"""The status with which a daemon answers `health` if its loop does not run on schedule."""


class Connections:
    """All connections to one daemon; they open at their first use.

    Args:
        socket: Socket of the daemon.
        client: Name of this server, for requests that are not of a tab.
    """

    def __init__(self, socket: Path, client: str) -> None:
        self.socket, self._client = socket, client
        uds = str(socket)
        self._calls = httpcore.AsyncConnectionPool(
            uds=uds, max_connections=_CALLS, keepalive_expiry=5.0
        )
        # They never expire here, and `status` uses them often enough that the daemon keeps them.
        self._urgent = httpcore.AsyncConnectionPool(uds=uds, max_connections=_URGENT)
        self._stream = httpcore.AsyncConnectionPool(uds=uds, max_connections=1)

    async def aclose(self) -> None:
        """Close them all."""
        for pool in (self._calls, self._urgent, self._stream):
            await pool.aclose()

    async def call(self, request: HttpRequest, *, urgent: bool = False) -> Document:
        """Send a request; return the document of the answer.

        Args:
            request: The request.
            urgent: Whether it is sent over a connection that no other request can occupy.

        Raises:
            PageError: If the daemon refuses it or does not answer.
        """
        with self._explained():
            response = await (self.urgently(request) if urgent else self._calls.request(**request))
        health = request["url"].endswith(f"/{TABLE['health'].path}")
        if is_error(response) and not (health and response.status == _UNHEALTHY):
            raise of_answer(response)
        return document_of(response)

    async def metrics(self) -> str:
        """Return the metrics in the text format of Prometheus.

        Raises:
            PageError: If the daemon does not answer.
        """
        request = http_request("GET", TABLE["metrics"].path, self._client)
        request["headers"].append(("Accept", "text/plain"))
        with self._explained():
            response = await self._calls.request(**request)
        if is_error(response):
            raise of_answer(response)
        return response.content.decode(errors="replace")

    @asynccontextmanager
    async def recording(self, name: str) -> AsyncGenerator[httpcore.Response, None]:
        """Yield the answer with the file of a recording, to be read block by block.

        Raises:
            PageError: If there is no such recording, or the daemon does not answer.
        """
        request = http_request("GET", recording_path(name), self._client)
        with self._explained():
            async with self._stream.stream(**request) as response:
                await _check(response)
                yield response

    @asynccontextmanager
    async def forwarded(self, request: HttpRequest) -> AsyncGenerator[httpcore.Response, None]:
        """Yield the answer to any request, also an error, to be read block by block.

        Raises:
            PageError: If the daemon does not answer.
        """
        with self._explained():
            async with self._calls.stream(**request) as response:
                yield response

    async def urgently(self, request: HttpRequest) -> httpcore.Response:
        """Send a request that may be sent twice, over a connection that is already open.

        Raises:
            ClientError: If the daemon does not answer.
        """
        with self._translated():
            try:
                return await self._urgent.request(**request)
            except (httpcore.NetworkError, httpcore.ProtocolError):
                # The daemon may have closed just this connection; a new one reaches it, or nothing.
                return await self._urgent.request(**request)

    @contextmanager
    def _translated(self) -> Iterator[None]:
        """Raise errors of the connection with the reason: no daemon, no permission, no answer."""
        with translated(Place(self.socket)):
            try:
                yield
            except httpcore.ConnectError:
                check_socket(self.socket)  # it knows why
                raise

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Raise errors of the connection as errors of a page."""
        try:
            with self._translated():
                yield
        except ClientError as error:
            raise of_connection(error) from error


class StatusLink(DaemonLink):
    """Sends its calls over the connections for emergency stops, which stay open by that."""

    def __init__(self, connections: Connections, name: str) -> None:
        super().__init__(connections.socket, name)
        self._connections = connections

    async def _call(self, call: Call[ResultT]) -> ResultT:
        response = await self._connections.urgently(request_of(call, self.name))
        return read_answer(call, response)


async def _check(response: httpcore.Response) -> None:
    """Raise the error of an answer, of which nothing was read yet, if it is one."""
    if is_error(response):
        await response.aread()
        raise of_answer(response)
