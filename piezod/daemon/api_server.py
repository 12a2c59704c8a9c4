"""The HTTP server on its unix socket, in the supervisor's event loop."""

import asyncio
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import uvicorn

from piezod.daemon.service.peer_protocol import PeerProtocol

GROUP_MAY_CONNECT: Final = 0o117
CLOSED_WITHIN_S: Final = 1
"""So long the answers that are on their way may take when the server ends."""


class _Server(uvicorn.Server):
    """A server that leaves signals to the supervisor."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Capture none."""
        yield


class ApiServer:
    """Serves an application on a unix socket, from `start` to `stop`.

    Args:
        app: The application.
        path: The socket; the caller holds the lock of the stage, so one that is there is left over.
    """

    def __init__(self, app: Any, path: Path) -> None:
        config = uvicorn.Config(
            app,
            http=PeerProtocol,
            ws="none",
            lifespan="off",
            log_config=None,
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=CLOSED_WITHIN_S,
        )
        self._server = _Server(config)
        self._path = path
        self._serving: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Bind the socket and serve.

        Raises:
            OSError: If the socket cannot be bound.
        """
        self._path.unlink(missing_ok=True)
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            mask = os.umask(GROUP_MAY_CONNECT)
            try:
                listener.bind(str(self._path))
            finally:
                os.umask(mask)
            listener.listen(64)
        except OSError:
            listener.close()
            raise
        self._serving = asyncio.create_task(self._server.serve([listener]))

    async def stop(self) -> None:
        """Let answers that are on their way end, close, and remove the socket."""
        if self._serving is None:
            return
        self._server.should_exit = True
        await self._serving
        self._path.unlink(missing_ok=True)
