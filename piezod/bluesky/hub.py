"""One stream of telemetry for all listeners of this process."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import aclosing, asynccontextmanager
from pathlib import Path
from typing import Final, TypeAlias

from piezod.client import AsyncStageClient
from piezod.messages.telemetry import Telemetry

RATE_HZ: Final = 20.0
_Queue: TypeAlias = "asyncio.Queue[Telemetry | Exception]"


class TelemetryHub:
    """A stream of telemetry that is open while somebody listens.

    Args:
        socket: Socket of the daemon.
    """

    def __init__(self, socket: Path) -> None:
        self._socket = socket
        self._queues: set[_Queue] = set()
        self._reading: asyncio.Task[None] | None = None

    @asynccontextmanager
    async def listening(self) -> AsyncIterator[AsyncIterator[Telemetry]]:
        """Return a context manager that gives the intervals from now on.

        The iterator raises ClientError if the daemon ends.
        """
        queue: _Queue = asyncio.Queue()
        self._queues.add(queue)
        if self._reading is None:
            self._reading = asyncio.create_task(self._read())
        try:
            yield _intervals(queue)
        finally:
            self._queues.discard(queue)
            if not self._queues and self._reading is not None:
                reading, self._reading = self._reading, None
                reading.cancel()
                await asyncio.wait({reading})

    async def _read(self) -> None:
        this = asyncio.current_task()
        try:
            async with (
                AsyncStageClient(socket=self._socket) as client,
                aclosing(client.telemetry(RATE_HZ)) as intervals,
            ):
                async for interval in intervals:
                    self._hand_out(interval)
        except Exception as error:  # noqa: BLE001 - each listener raises it
            self._hand_out(error)
        finally:
            if self._reading is this:
                self._reading = None

    def _hand_out(self, item: Telemetry | Exception) -> None:
        for queue in self._queues:
            queue.put_nowait(item)


async def _intervals(queue: _Queue) -> AsyncIterator[Telemetry]:
    while True:
        item = await queue.get()
        if isinstance(item, Exception):
            raise item
        yield item
