"""The connection of this process to one stage, which the devices of the stage share."""

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Final

from piezod.client import AsyncStageClient, find_socket
from piezod.client.daemon_link import DaemonLink
from piezod.client.facts import AxisFacts
from piezod.client.mirror import StageMirror
from piezod.client.mover import StageMover
from piezod.errors import ClientError, NotRunningError, RefusedError

_RATE_HZ: Final = 20.0
"""Rate of the telemetry, in Hz."""
_SOON_S: Final = 0.2
"""Longest time by which a hold may come later, in s."""


class ConnectedStage:
    """A connection, the lease, and what this process knows about the stage.

    The lease belongs to this process: no other client moves the stage within `commanding`.

    Args:
        stage: Name of the stage; None for the only one that runs.
        socket: Socket of the daemon, in place of a name.

    Attributes:
        facts: What the configuration in force says about each axis.
        moving: Axes that this process moves.
        commanded: Whether this process has had the lease; plans reset it.
    """

    def __init__(self, stage: str | None, socket: Path | None) -> None:
        self._stage, self._given = stage, socket
        self._connected: tuple[StageMirror, StageMover] | None = None
        self.facts: dict[str, AxisFacts] = {}
        self.moving: set[str] = set()
        self.commanded = False

    @property
    def title(self) -> str:
        """The name of the stage, for people and for sources of data."""
        return self._stage or (self._given.parent.name if self._given else "stage")

    @property
    def mirror(self) -> StageMirror:
        """The stage as it is seen.

        Raises:
            NotRunningError: If `connect` was not called.
        """
        return self._parts()[0]

    @property
    def mover(self) -> StageMover:
        """Moves and stops the stage; raises as `mirror`."""
        return self._parts()[1]

    @property
    def daemon(self) -> DaemonLink:
        """The client with which the stage is commanded; raises as `mirror`."""
        return self.mover.link

    async def connect(self, axes: tuple[str, ...]) -> None:
        """Find the stage, and read its limits.

        Raises:
            ClientError: If no daemon answers, or it has no such axis.
        """
        await self.close()
        socket = self._given
        if socket is None:
            socket = await asyncio.to_thread(find_socket, self._stage)
        link = DaemonLink(socket, f"bluesky-{os.getpid()}")
        self._connected = StageMirror(link, _RATE_HZ), StageMover(link)
        await self.read_facts()
        if missing := [axis for axis in axes if axis not in self.facts]:
            what = f"{self.title} has no axis {', '.join(missing)}"
            raise RefusedError(what, f"its axes are {', '.join(self.facts)}", "not_found")

    async def close(self) -> None:
        """Release the lease and close the connection; the stage continues."""
        connected, self._connected = self._connected, None
        if connected is not None:
            for each in connected:
                await each.close()

    async def read_facts(self) -> None:
        """Read the configuration in force, which a reload may have changed."""
        self.facts = await self.mirror.facts()

    @asynccontextmanager
    async def commanding(self) -> AsyncIterator[None]:
        """Return a context manager in which this process has the lease.

        Raises:
            RefusedError: If another client has it.
            ClientError: If the daemon does not answer.
        """
        async with self.mover.commanding():
            self.commanded = True
            yield

    async def fetch_recording(self, name: str, file: Path) -> None:
        """Copy a recording.

        Raises:
            OSError: If the file cannot be written.
            ClientError: If the daemon does not answer, or has no such recording.
        """
        async with AsyncStageClient(socket=self.daemon.socket) as client:
            await client.fetch_recording(name, file)

    async def hold(self) -> None:
        """Hold the voltage of all axes; nothing if nothing is driven.

        The next movement resumes, unless somebody else has held the stage before.

        Raises:
            ClientError: If the daemon does not answer, or does not allow it.
        """
        await self.mover.stop("" if self.moving else await self._state_soon(), resume=False)
        self.moving.clear()

    async def _state_soon(self) -> str:
        """Return the state; empty if the daemon does not report it soon."""
        with suppress(ClientError, TimeoutError):
            async with asyncio.timeout(_SOON_S):
                return (await self.mirror.status()).state
        return ""

    def _parts(self) -> tuple[StageMirror, StageMover]:
        if self._connected is None:
            raise NotRunningError(f"{self.title}: not connected", "connect the device first")
        return self._connected
