"""The connections to the daemon of one stage: for calls, for an emergency stop, for telemetry."""

import json
from collections.abc import AsyncGenerator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Final

import httpcore

from piezod.client.errors import translated
from piezod.client.place import Place
from piezod.client.places import check_socket
from piezod.client.telemetry import LineSplitter
from piezod.client.wire import (
    TIMEOUT_S,
    HttpRequest,
    http_request,
    is_error,
    recording_path,
    telemetry_path,
)
from piezod.errors import ClientError
from piezod.messages.documents import Document
from piezod.messages.requests import TABLE
from piezod.web.errors import NOT_RUNNING, PageError, document_of, of_answer, of_connection
from piezod.web.rows import RATE_HZ

_CALLS: Final = 6
"""Connections for calls. A daemon serves 16 of one user, who may have other programs."""
_URGENT: Final = 2
_SILENT_S: Final = 3.0
"""A daemon that sends no telemetry for this time does not answer, in s."""
_DATA: Final = "data: "
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

    async def call(self, request: HttpRequest) -> Document:
        """Send a request; return the document of the answer.

        Raises:
            PageError: If the daemon refuses it or does not answer.
        """
        response = await self._sent(self._calls, request)
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
        response = await self._sent(self._calls, request)
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

    async def status(self) -> Document:
        """Return the status, over a connection for emergency stops, which stays open by that.

        Raises:
            PageError: If the daemon does not answer.
        """
        return await self._urgently(http_request("GET", TABLE["status"].path, self._client))

    async def estop(self, client: str) -> Document:
        """Stop in an emergency, over a connection that is already open.

        Args:
            client: Name of the tab.

        Raises:
            PageError: If the daemon does not answer.
        """
        request = http_request("POST", TABLE["estop"].path, client, body={})
        try:
            return await self._urgently(request)
        except PageError as error:
            if error.document["code"] != NOT_RUNNING:
                raise
        # The daemon may have closed just this connection; a new one reaches it, or nothing does.
        return await self._urgently(request)

    async def telemetry(self) -> AsyncGenerator[Document, None]:
        """Yield the intervals of all axes until the daemon ends.

        Raises:
            PageError: If it refuses or ends, or does not answer.
        """
        lines = LineSplitter()
        connect_s, _, write_s, pool_s = TIMEOUT_S
        request = http_request(
            "GET",
            telemetry_path(RATE_HZ, ()),
            self._client,
            timeout_s=(connect_s, _SILENT_S, write_s, pool_s),
        )
        with self._explained():
            async with self._stream.stream(**request) as response:
                await _check(response)
                async for block in response.aiter_stream():
                    for line in lines.feed(block):
                        if line.startswith(_DATA):
                            yield json.loads(line.removeprefix(_DATA))
        raise of_connection(Place(self.socket).ended())

    async def _urgently(self, request: HttpRequest) -> Document:
        response = await self._sent(self._urgent, request)
        if is_error(response):
            raise of_answer(response)
        return document_of(response)

    async def _sent(
        self, pool: httpcore.AsyncConnectionPool, request: HttpRequest
    ) -> httpcore.Response:
        with self._explained():
            return await pool.request(**request)

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Raise errors of the connection with the reason: no daemon, no permission, no answer."""
        try:
            with translated(Place(self.socket)):
                try:
                    yield
                except httpcore.ConnectError:
                    check_socket(self.socket)  # it knows why
                    raise
        except ClientError as error:
            raise of_connection(error) from error


async def _check(response: httpcore.Response) -> None:
    """Raise the error of an answer, of which nothing was read yet, if it is one."""
    if is_error(response):
        await response.aread()
        raise of_answer(response)
