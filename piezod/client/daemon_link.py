"""The connection to the daemon: it outlives the daemon, and waits for its limit of requests."""

import asyncio
from contextlib import suppress
from pathlib import Path
from typing import Final, TypeVar

from piezod.client import AsyncStageClient
from piezod.client.calls import Call
from piezod.client.commands import StageCommands
from piezod.client.methods import AsyncCaller
from piezod.client.reports import StageReports
from piezod.errors import ClientError, NotRunningError, RefusedError

_TOO_MANY: Final = "too_many"
_RETRY_S: Final = 0.05
_MOST_RETRIES: Final = 40

ResultT = TypeVar("ResultT")


class DaemonLink(StageCommands, StageReports, AsyncCaller):
    """A client of the daemon with the methods of `AsyncStageClient`.

    If the daemon ends, calls fail until it runs again at the same socket. A request beyond the
    daemon's limit of rate is sent again, for up to 2 s.

    Args:
        socket: Socket of the daemon.
        name: Name of the client, for the lease.
    """

    def __init__(self, socket: Path, name: str) -> None:
        self.socket, self.name = socket, name
        self._client: AsyncStageClient | None = None
        self._commanded = False

    async def call(self, call: Call[ResultT]) -> ResultT:
        """Carry out one call.

        Raises:
            ClientError: As in `AsyncStageClient`.
        """
        for _ in range(_MOST_RETRIES):
            try:
                return await self._call(call)
            except RefusedError as error:
                if error.code != _TOO_MANY:
                    raise
            await asyncio.sleep(_RETRY_S)
        return await self._call(call)

    async def close(self, *, release: bool = True) -> None:
        """Close the connection, and release the lease before; the stage continues.

        Args:
            release: Whether to release the lease; otherwise it expires.
        """
        if self._commanded and release:
            with suppress(ClientError):
                await self.release_lease()
        await self._disconnect()

    async def _call(self, call: Call[ResultT]) -> ResultT:
        if self._client is None:
            self._client = AsyncStageClient(socket=self.socket, name=self.name)
        self._commanded = self._commanded or call.endpoint.access.lease
        try:
            return await self._client.call(call)
        except NotRunningError:
            await self._disconnect()
            raise

    async def _disconnect(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            await client.close()
