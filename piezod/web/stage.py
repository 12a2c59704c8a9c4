"""One stage as all tabs see it: one stream of telemetry for all of them, its status, up or down."""

import asyncio
import time
from collections.abc import Callable, Coroutine
from contextlib import aclosing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from piezod.client.mirror import STATUS_EACH_S, StageMirror
from piezod.errors import ClientError
from piezod.messages.documents import Document
from piezod.messages.telemetry import Telemetry
from piezod.web.connections import Connections, StatusLink
from piezod.web.errors import GONE, of_connection
from piezod.web.rows import RATE_HZ, Decimator, Row, encoded, with_time

UNWATCHED_EACH_S: Final = 3.0
"""Time between two requests of the status of a stage that no tab watches, in s."""
_MEASURED: Final = ("skipped_cycles", "gate")
"""Values of a status that change by themselves; numbers with a fraction are others."""


class WebStage:
    """A stage for which this server works while a tab is open.

    Args:
        name: Name of the stage.
        socket: Socket of its daemon.
        client: Name of this server, for requests that are not of a tab.
        publish: Sends an event to all tabs.

    Attributes:
        connections: The connections to its daemon.
        up: Whether its daemon answers.
        since_s: Since when it does or does not, in s since 1970.
        status: The newest status; None before the first.
    """

    def __init__(
        self, name: str, socket: Path, client: str, publish: Callable[[str], None]
    ) -> None:
        self.name, self._client, self._publish = name, client, publish
        self.up, self.since_s = True, time.time()
        self.status: Document | None = None
        self._seen_s = self.since_s
        self._watchers: dict[object, Decimator] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._streaming: asyncio.Task[None] | None = None
        self._open(socket)

    async def close(self) -> None:
        """End all tasks and connections."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._mirror.close()
        await self.connections.aclose()

    async def relocate(self, socket: Path) -> None:
        """Use another socket: the daemon has started again with another runtime folder."""
        await self.close()
        self._open(socket)
        if self._watchers:
            self._streaming = self._start(self._stream())

    def _open(self, socket: Path) -> None:
        self.connections = Connections(socket, self._client)
        self._mirror = StageMirror(StatusLink(self.connections, self._client), RATE_HZ)
        self._start(self._ask_status())

    def _start(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def document(self) -> Document:
        """Return the entry of the stage in the list of all stages."""
        status = self.status if self.up else None
        return {"stage": self.name, "up": self.up, "since": iso(self.since_s), "status": status}

    def watch(self, tab: object, pacer: Decimator) -> None:
        """Send rows to a tab; the first watcher opens the stream."""
        self._watchers[tab] = pacer
        if self._streaming is None or self._streaming.done():
            self._streaming = self._start(self._stream())
        self._mirror.look_again()

    def unwatch(self, tab: object) -> None:
        """Send no more rows to a tab; without watchers the stream ends with its next interval."""
        self._watchers.pop(tab, None)

    async def _ask_status(self) -> None:
        """Ask for the status; publish it if more than measured values has changed."""
        while True:
            try:
                before, self.status = self.status, (await self._mirror.status()).document
                if not self._watchers:  # else the stream reports it, with the time that is missing
                    self._seen_s = time.time()
                    self._set_up()
                if before is None or _steady(before) != _steady(self.status):
                    event = {"event": "status", "stage": self.name, "status": self.status}
                    self._publish(encoded(event))
            except ClientError as error:
                if not self._watchers:
                    self._set_down(error)
            await self._mirror.until_changed(STATUS_EACH_S if self._watchers else UNWATCHED_EACH_S)

    async def _stream(self) -> None:
        while self._watchers:  # somebody may watch again while the stream ends
            async with aclosing(self._mirror.following()) as intervals:
                async for found in intervals:
                    if not self._watchers:
                        break
                    if isinstance(found, ClientError):
                        self._set_down(found)
                    else:
                        self._take(found)

    def _take(self, interval: Telemetry) -> None:
        """Hand an interval to all tabs."""
        self._set_up()
        row = Row(self.name, with_time(interval.document))
        self._seen_s = row.document["unix_s"]
        for pacer in tuple(self._watchers.values()):
            pacer.feed(row)

    def _set_up(self) -> None:
        if self.up:
            return
        self.up, self.since_s = True, time.time()
        missing = {"from": iso(self._seen_s), "to": iso(self.since_s)}
        self._publish_up(missing=missing)

    def _set_down(self, error: ClientError) -> None:
        document = of_connection(error).document
        # A daemon that refuses runs, but its loop has not started.
        if self.up and document["code"] in GONE:
            self.up, self.since_s = False, self._seen_s
            self._publish_up(error=document)

    def _publish_up(self, **more: Document) -> None:
        since = iso(self.since_s)
        event = {"event": "stage", "stage": self.name, "up": self.up, "since": since, **more}
        self._publish(encoded(event))


def iso(time_s: float) -> str:
    """Return a time in s since 1970 as ISO 8601, in UTC."""
    return datetime.fromtimestamp(time_s, UTC).isoformat(timespec="milliseconds")


def _steady(value: Any) -> Any:
    """Return a status without its measured values."""
    if isinstance(value, dict):
        return {key: _steady(each) for key, each in value.items() if key not in _MEASURED}
    if isinstance(value, list):
        return [_steady(each) for each in value]
    return None if isinstance(value, float) else value
