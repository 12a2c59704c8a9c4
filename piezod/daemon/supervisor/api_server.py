"""Runs the HTTP service inside the supervisor."""

import asyncio
from pathlib import Path

from fastapi import FastAPI

from piezod.daemon.service.peer_protocol import ConnectionLimits
from piezod.daemon.service.server import bind, make_server
from piezod.daemon.supervisor.quiet_loop import QuietLoop

_POLL_S = 0.005


class ApiServer:
    """Serves an application on a unix socket, from `start` to `stop`.

    Args:
        app: The application.
        path: The socket; the caller holds the lock of the stage.
    """

    def __init__(self, app: FastAPI, path: Path) -> None:
        self._server = make_server(app, ConnectionLimits())
        self._path = path
        self._inode = 0
        self._serving: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Bind the socket, and return when the server accepts connections.

        Raises:
            OSError: If the socket cannot be bound.
        """
        endpoint = bind(self._path)
        asyncio.get_running_loop().set_exception_handler(QuietLoop())
        self._inode = self._path.stat().st_ino
        self._serving = asyncio.create_task(self._server.serve([endpoint]))
        # The server has no event for this; a task that has ended raises in `stop`.
        while not self._server.started and not self._serving.done():
            await asyncio.sleep(_POLL_S)

    async def stop(self) -> None:
        """Finish pending answers, close the server, and remove the socket."""
        if self._serving is None:
            return
        self._server.should_exit = True
        await self._serving
        # If the lock was released before, the socket may belong to another daemon by now.
        if self._path.exists() and self._path.stat().st_ino == self._inode:
            self._path.unlink()
