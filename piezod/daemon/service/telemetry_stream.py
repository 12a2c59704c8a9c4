"""Telemetry as server-sent events, one for each interval."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Final

from starlette.responses import Response
from starlette.types import Message, Receive, Scope, Send

from piezod.daemon.service.peer_protocol import PeerProtocol
from piezod.daemon.service.summary import summarise
from piezod.daemon.stage.following_reader import FollowingReader
from piezod.messages.documents import dump

_MOST_RECORDS: Final = 40_000
"""Most records in one event, 2 s of the fastest loop; further records go to the next event."""
_NOTHING_NEW: Final = b": nothing new\n\n"


class TelemetryAnswer(Response):
    """Events until the client disconnects or the server ends.

    While a client does not read, no event is made; its next event covers more cycles.

    Args:
        records: Reader of the ring.
        fault_ids: Returns the ids of the faults in a mask.
        axes: Names of the axes to report, and their places in a record.
        rate_hz: Events per second.
        connection: Connection of the client.
    """

    media_type = "text/event-stream"

    def __init__(
        self,
        records: FollowingReader,
        fault_ids: Callable[[int], Sequence[str]],
        axes: Mapping[str, int],
        rate_hz: float,
        connection: PeerProtocol,
    ) -> None:
        super().__init__(headers={"cache-control": "no-store"})
        del self.headers["content-length"]
        self._records, self._fault_ids = records, fault_ids
        self._axes, self._connection = axes, connection
        self._interval_s = 1.0 / rate_hz

    async def __call__(self, _scope: Scope, _receive: Receive, send: Send) -> None:
        """Send the events."""
        loop, closing = asyncio.get_running_loop(), self._connection.closing
        await send(
            {"type": "http.response.start", "status": 200, "headers": self.raw_headers},
        )
        due_s = loop.time()
        while not closing.is_set():
            await send(self._event())
            due_s = max(due_s + self._interval_s, loop.time())
            with suppress(TimeoutError):
                async with asyncio.timeout_at(due_s):
                    await closing.wait()
        await send({"type": "http.response.body", "body": b""})

    def _event(self) -> Message:
        records, lost = self._records.read(_MOST_RECORDS)
        body = _NOTHING_NEW
        if len(records):
            document = summarise(records, lost, self._axes, self._fault_ids)
            body = b"event: telemetry\ndata: " + dump(document) + b"\n\n"
        return {"type": "http.response.body", "body": body, "more_body": True}
