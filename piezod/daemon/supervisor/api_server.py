"""Runs the HTTP service inside the supervisor."""

import asyncio
import socket
from pathlib import Path
from typing import Final

from fastapi import FastAPI

from piezod.daemon.logging import logger
from piezod.daemon.paths import StagePaths, make_private_folder
from piezod.daemon.service.app import bind, make_server
from piezod.daemon.service.connection import ConnectionLimits
from piezod.daemon.supervisor.kept_files import KeptFiles
from piezod.daemon.supervisor.quiet_loop import QuietLoop

LOOK_EACH_S: Final = 1.0
"""How often the sockets are looked at, in s."""
_POLL_S: Final = 0.005

_log = logger("service")


class ApiServer:
    """Serves an application on the sockets of a stage, from `start` to `stop`.

    A socket that is removed, as with its folder at the last logout of a user, is made again. If
    that is impossible, the other one stays: one is in the runtime folder, one beside the lock.

    Args:
        app: The application.
        paths: The files of the stage; the caller holds its lock.
    """

    def __init__(self, app: FastAPI, paths: StagePaths) -> None:
        self._server = make_server(app, ConnectionLimits())
        self._path = paths.api_socket
        self._inodes = dict.fromkeys((paths.api_socket, paths.spare_socket), 0)
        self._missing: set[Path] = set()
        self._files = KeptFiles(paths.runtime)
        self._serving: asyncio.Task[None] | None = None
        self._keeping: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Bind the sockets, and return when the server accepts connections.

        Raises:
            OSError: If the one in the runtime folder cannot be bound.
        """
        endpoint = self._bound(self._path)
        asyncio.get_running_loop().set_exception_handler(QuietLoop())
        self._serving = asyncio.create_task(self._server.serve([endpoint]))
        # The server has no event for this; a task that has ended raises in `stop`.
        while not self._server.started and not self._serving.done():
            await asyncio.sleep(_POLL_S)
        await self._look()
        self._keeping = asyncio.create_task(self._keep())

    async def stop(self) -> None:
        """Finish pending answers, close the server, and remove the sockets."""
        if self._serving is None:
            return
        if self._keeping is not None:
            self._keeping.cancel()
        self._server.should_exit = True
        await self._serving
        for path in self._inodes:
            if self._is_ours(path):
                path.unlink()

    async def _keep(self) -> None:
        while True:
            await asyncio.sleep(LOOK_EACH_S)
            await self._look()

    async def _look(self) -> None:
        """Make each socket again that is not there, and what clients need beside it."""
        for path in self._inodes:
            # In a thread: the folder of the state may be on a network that hangs.
            if await asyncio.to_thread(self._is_ours, path):
                if path == self._path:
                    await asyncio.to_thread(self._files.read)
                continue
            try:
                endpoint = await asyncio.to_thread(self._bound, path)
            except OSError as error:
                if path not in self._missing:  # told once for each loss
                    self._missing.add(path)
                    _log.warning("no socket", socket=str(path), why=str(error))
                continue
            self._missing.discard(path)
            await self._server.listen(endpoint)
            if path == self._path:
                _log.warning("socket made again", socket=str(path))
                await asyncio.to_thread(self._files.restore)

    def _bound(self, path: Path) -> socket.socket:
        make_private_folder(path.parent)
        endpoint = bind(path)
        self._inodes[path] = path.stat().st_ino
        return endpoint

    def _is_ours(self, path: Path) -> bool:
        try:
            return path.stat().st_ino == self._inodes[path]
        except OSError:
            return False
