"""One stage as all tabs see it: one stream of telemetry for all of them, its status, up or down."""

import asyncio
import time
from collections.abc import Callable, Coroutine
from contextlib import aclosing, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from piezod.client.errors import OTHER_VERSION
from piezod.messages.documents import Document
from piezod.web.connections import Connections
from piezod.web.errors import GONE, PageError
from piezod.web.rows import Pacer, Row, encoded, with_time

STATUS_EACH_S: Final = 1.0
"""Time between two requests of the status of a stage that is watched, in s."""
UNWATCHED_EACH_S: Final = 3.0
AT_MOST_EACH_S: Final = 0.2
"""Shortest time between two of them: near its tolerance a stage changes in every interval."""
_AGAIN_S: Final = 0.3
"""Time until the next attempt to open the telemetry, in s."""
_LAST_INTERVAL_S: Final = 0.2
"""Time for a stream to end by itself, in s."""
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
        self.connections = Connections(socket, client)
        self.up, self.since_s = True, time.time()
        self.status: Document | None = None
        self._seen_s = self.since_s
        self._watchers: dict[object, Pacer] = {}
        self._changed = asyncio.Event()
        self._asking = _task(self._ask_status())
        self._streaming: asyncio.Task[None] | None = None

    async def close(self) -> None:
        """End all tasks and connections."""
        self._watchers.clear()
        if self._streaming is not None:
            await asyncio.wait((self._streaming,), timeout=_LAST_INTERVAL_S)
        for task in (self._asking, self._streaming):
            await _ended(task)
        await self.connections.aclose()

    async def relocate(self, socket: Path) -> None:
        """Use another socket: the daemon has started again with another runtime folder."""
        before, self.connections = self.connections, Connections(socket, self._client)
        await before.aclose()

    def document(self) -> Document:
        """Return the entry of the stage in the list of all stages."""
        status = self.status if self.up else None
        return {"stage": self.name, "up": self.up, "since": iso(self.since_s), "status": status}

    def watch(self, tab: object, pacer: Pacer) -> None:
        """Send rows to a tab; the first watcher opens the stream."""
        self._watchers[tab] = pacer
        if self._streaming is None or self._streaming.done():
            self._streaming = _task(self._stream())
        self._changed.set()

    def unwatch(self, tab: object) -> None:
        """Send no more rows to a tab; without watchers the stream ends with its next interval."""
        self._watchers.pop(tab, None)

    async def refresh(self) -> None:
        """Ask for the status; publish it if more than measured values has changed.

        Raises:
            PageError: If the daemon does not answer.
        """
        status = await self.connections.status()
        before, self.status = self.status, status
        if not self._watchers:  # else the stream reports it, with the time that is missing
            self._seen_s = time.time()
            self._set_up()
        if before is None or _steady(before) != _steady(status):
            self._publish(encoded({"event": "status", "stage": self.name, "status": status}))

    async def _ask_status(self) -> None:
        while True:
            try:
                await self.refresh()
            except PageError as error:
                if error.document["code"] in GONE and not self._watchers:
                    self._set_down(error)
            await asyncio.sleep(AT_MOST_EACH_S)
            each_s = STATUS_EACH_S if self._watchers else UNWATCHED_EACH_S
            with suppress(TimeoutError):
                async with asyncio.timeout(each_s):
                    await self._changed.wait()
            self._changed.clear()

    async def _stream(self) -> None:
        state: object = None
        while self._watchers:
            try:
                async with aclosing(self.connections.telemetry()) as intervals:
                    async for interval in intervals:
                        if not self._watchers:
                            break
                        state = self._take(interval, state)
                continue  # somebody may watch again since then
            except PageError as error:
                # A daemon that refuses runs, but its loop has not started.
                if error.document["code"] in GONE:
                    self._set_down(error)
            except (LookupError, TypeError, ValueError) as error:  # a daemon of another version
                self._set_down(PageError("unexpected", f"telemetry: {error!r}", OTHER_VERSION))
            await asyncio.sleep(_AGAIN_S)

    def _take(self, interval: Document, before: object) -> object:
        """Hand an interval to all tabs; return what a change of the status shows in."""
        self._set_up()
        row = Row(self.name, with_time(interval))
        self._seen_s = row.document["unix_s"]
        for pacer in tuple(self._watchers.values()):
            pacer.feed(row)
        axes = [(each["mode"], each["motion"], each["on_target"]) for each in _axes(interval)]
        state = interval["state"], interval["shadow"], interval["faults"], axes
        if state != before:
            self._changed.set()
        return state

    def _set_up(self) -> None:
        if self.up:
            return
        self.up, self.since_s = True, time.time()
        missing = {"from": iso(self._seen_s), "to": iso(self.since_s)}
        self._publish_up(missing=missing)

    def _set_down(self, error: PageError) -> None:
        if not self.up:
            return
        self.up, self.since_s = False, self._seen_s
        self._publish_up(error=error.document)

    def _publish_up(self, **more: Document) -> None:
        since = iso(self.since_s)
        event = {"event": "stage", "stage": self.name, "up": self.up, "since": since, **more}
        self._publish(encoded(event))


def iso(time_s: float) -> str:
    """Return a time in s since 1970 as ISO 8601, in UTC."""
    return datetime.fromtimestamp(time_s, UTC).isoformat(timespec="milliseconds")


def _axes(interval: Document) -> list[Document]:
    return list(interval["axes"].values())


def _steady(value: Any) -> Any:
    """Return a status without its measured values."""
    if isinstance(value, dict):
        return {key: _steady(each) for key, each in value.items() if key not in _MEASURED}
    if isinstance(value, list):
        return [_steady(each) for each in value]
    return None if isinstance(value, float) else value


def _task(work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
    return asyncio.get_running_loop().create_task(work)


async def _ended(task: asyncio.Task[None] | None) -> None:
    if task is not None:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
