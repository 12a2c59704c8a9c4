"""The connection of this process to one stage, which the devices of the stage share."""

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any, Final

from piezod.bluesky.facts import AxisFacts
from piezod.bluesky.hub import TelemetryHub
from piezod.client import AsyncStageClient, find_socket
from piezod.client.daemon_link import DaemonLink
from piezod.config.states import State
from piezod.errors import ClientError, NotRunningError, RefusedError
from piezod.messages.answers import Status

_RENEW_EACH_S: Final = 10.0
"""Time between two renewals of the lease, which lasts 30 s."""
_SOON_S: Final = 0.2
"""Longest time by which a hold may come later, in s."""
_GATHER_S: Final = 0.001
"""Requests for the status within this time share one."""


class StageLink:
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
        self._daemon: DaemonLink | None = None
        self._hub: TelemetryHub | None = None
        self._batch: asyncio.Future[Status] | None = None
        self._commanders = 0
        self._renewing, self._resuming = asyncio.Lock(), asyncio.Lock()
        self._renewal: asyncio.Task[None] | None = None
        self._held_here = False
        self.facts: dict[str, AxisFacts] = {}
        self.moving: set[str] = set()
        self.commanded = False

    @property
    def title(self) -> str:
        """The name of the stage, for people and for sources of data."""
        return self._stage or (self._given.parent.name if self._given else "stage")

    @property
    def daemon(self) -> DaemonLink:
        """The client with which the stage is commanded.

        Raises:
            NotRunningError: If `connect` was not called.
        """
        if self._daemon is None:
            raise NotRunningError(f"{self.title}: not connected", "connect the device first")
        return self._daemon

    @property
    def hub(self) -> TelemetryHub:
        """The telemetry of the stage."""
        if self._hub is None:
            raise NotRunningError(f"{self.title}: not connected", "connect the device first")
        return self._hub

    async def connect(self, axes: tuple[str, ...]) -> None:
        """Find the stage, and read its limits.

        Args:
            axes: Names that its axes must have.

        Raises:
            ClientError: If no daemon answers, or it has no such axis.
        """
        await self.close()
        socket = self._given
        if socket is None:
            socket = await asyncio.to_thread(find_socket, self._stage)
        self._daemon = DaemonLink(socket, f"bluesky-{os.getpid()}")
        self._hub = TelemetryHub(socket)
        await self.read_facts()
        if missing := [axis for axis in axes if axis not in self.facts]:
            what = f"{self.title} has no axis {', '.join(missing)}"
            raise RefusedError(what, f"its axes are {', '.join(self.facts)}", "not_found")

    async def close(self) -> None:
        """Release the lease and close the connection; the stage continues."""
        if self._renewal is not None:
            self._renewal.cancel()
        self._commanders, self._renewal = 0, None
        daemon, self._daemon, self._hub = self._daemon, None, None
        if daemon is not None:
            await daemon.close()

    async def read_facts(self) -> None:
        """Read the configuration in force, which a reload may have changed."""
        axes = (await self.daemon.config())["axes"]
        self.facts = {name: AxisFacts.of(axis) for name, axis in axes.items()}

    async def status(self) -> Status:
        """Return a status that is requested from now on.

        Signals that are read together share it, so that their values are of one cycle.

        Raises:
            ClientError: If the daemon does not answer.
        """
        if self._batch is None:
            self._batch = asyncio.ensure_future(self._status_soon())
            self._batch.add_done_callback(take_exception)
        return await asyncio.shield(self._batch)

    @asynccontextmanager
    async def commanding(self) -> AsyncIterator[None]:
        """Return a context manager in which this process has the lease.

        Raises:
            RefusedError: If another client has it.
            ClientError: If the daemon does not answer.
        """
        await self.take_lease()
        try:
            yield
        finally:
            await self.return_lease()

    async def fetch_recording(self, name: str, file: Path) -> None:
        """Copy a recording.

        Raises:
            OSError: If the file cannot be written.
            ClientError: If the daemon does not answer, or has no such recording.
        """
        async with AsyncStageClient(socket=self.daemon.socket) as client:
            await client.fetch_recording(name, file)

    async def take_lease(self) -> None:
        """Take the lease, and renew it until `return_lease` was called as often as this.

        Raises:
            RefusedError: If another client has it.
            ClientError: If the daemon does not answer.
        """
        async with self._renewing:
            if not self._commanders:
                await self.daemon.renew_lease()
                self._renewal = asyncio.create_task(self._renew())
            self._commanders, self.commanded = self._commanders + 1, True

    async def return_lease(self) -> None:
        """Release the lease if no other device of this process needs it. Never raises."""
        async with self._renewing:
            self._commanders = max(self._commanders - 1, 0)
            if self._commanders or self._renewal is None:
                return
            self._renewal.cancel()
            self._renewal = None
            with suppress(ClientError):  # then the daemon has ended, or it ends within 30 s
                await self.daemon.release_lease()

    async def hold(self) -> None:
        """Hold the voltage of all axes; nothing if nothing is driven.

        Raises:
            ClientError: If the daemon does not answer, or does not allow it.
        """
        held_already = not self.moving and await self._is_held()
        try:
            await self.daemon.hold()
        except RefusedError as error:
            if error.code != "refused":
                raise
        else:
            self._held_here = self._held_here or not held_already
        self.moving.clear()

    async def go_on(self) -> str:
        """Resume if this process has held the stage; return the state.

        Another client's hold stays: whoever has held the stage resumes it.

        Raises:
            ClientError: If the daemon does not answer, or refuses to resume.
        """
        async with self._resuming:
            if not self._held_here:
                return (await self.status()).state
            state = (await self.daemon.status()).state
            if state == State.HOLD:
                state = (await self.daemon.resume()).state
            self._held_here = False
        return state

    async def _is_held(self) -> bool:
        """Return whether the stage is held; False if the daemon does not report it soon."""
        with suppress(ClientError, TimeoutError):
            async with asyncio.timeout(_SOON_S):
                return (await self.status()).state == State.HOLD
        return False

    async def _status_soon(self) -> Status:
        await asyncio.sleep(_GATHER_S)
        self._batch = None
        return await self.daemon.status()

    async def _renew(self) -> None:
        while True:
            await asyncio.sleep(_RENEW_EACH_S)
            with suppress(ClientError):  # the next command reports it
                await self.daemon.renew_lease()


def take_exception(future: "asyncio.Future[Any]") -> None:
    """Take the exception of a request that nobody waits for any more."""
    if not future.cancelled():
        future.exception()
