"""Answers that last: telemetry, a session, the file of a recording."""

import asyncio
import os
import re
import stat
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, get_type_hints

import numpy as np
from numpy.typing import NDArray
from starlette.responses import Response
from starlette.types import Message, Receive, Scope, Send

from piezod.config.states import State
from piezod.daemon.logging import logger
from piezod.daemon.service.connection import PeerProtocol, closed_with_its_process
from piezod.daemon.service.request import RequestContext
from piezod.daemon.stage.connection import FollowingReader
from piezod.daemon.stage.errors import StageError, UnknownNameError
from piezod.messages.documents import dump
from piezod.messages.requests import Stop
from piezod.messages.telemetry import AxisTelemetry, Range, Telemetry
from piezod.telemetry.layout import as_shown
from piezod.units import NS_PER_S

_BLIND: Final = tuple(State).index(State.BLIND)
_FIELDS: Final = get_type_hints(AxisTelemetry)


def summarise(
    records: NDArray[Any],
    lost: int,
    axes: Mapping[str, int],
    fault_ids: Callable[[int], Sequence[str]],
) -> Telemetry:
    """Summarise the records of an interval.

    Args:
        records: Of `telemetry.arrays.record_dtype`, shape (n,), n at least 1, oldest first.
        lost: Number of further records, which were lost.
        axes: Names of the axes to report, and their places in a record.
        fault_ids: Returns the ids of the faults in a mask.
    """
    last = records[-1]
    return Telemetry(
        t_s=int(last["t_ns"]) / NS_PER_S,
        cycles=len(records),
        lost=lost,
        state=as_shown("state", last["state"]),
        shadow=bool(last["shadow"]),
        faults=tuple(fault_ids(_mask(records, "present") | _mask(records[-1:], "latched"))),
        skipped_cycles=int(last["skipped"]),
        late_max_us=float(records["late_ns"].max()) / 1000,
        axes={
            name: _axis(records["axes"][:, place], records["state"] == _BLIND)
            for name, place in axes.items()
        },
    )


def _mask(records: NDArray[Any], name: str) -> int:
    low = np.bitwise_or.reduce(records[f"{name}_lo"])
    high = np.bitwise_or.reduce(records[f"{name}_hi"])
    return int(high) << 64 | int(low)


def _axis(records: NDArray[Any], blind: NDArray[np.bool_]) -> AxisTelemetry:
    # In BLIND the record has only the last written voltage, which need not be in force.
    values = {
        "drive_v": np.where(blind, records["read_back_v"], records["drive_v"]),
        "error_um": records["command_um"] - records["position_um"],
    }
    last = records[-1]
    shown: dict[str, Any] = {
        name: _range(values[name] if name in values else records[name])
        if kind is Range
        else as_shown(name, last[name].item())
        for name, kind in _FIELDS.items()
    }
    return AxisTelemetry(**shown)


def _range(values: NDArray[Any]) -> Range:
    """Return the range of all values that are numbers; None if there is none."""
    found = np.fmin.reduce(values), np.fmax.reduce(values), values[-1]
    low, high, last = (as_shown("", float(each)) for each in found)
    return Range(min=low, max=high, last=last)


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


RETRY_S: Final = 0.2
_TRIES: Final = 150
"""A loop that does not take a stop within half a minute has its own watchdog."""

_LOG: Final = logger("service")


class SessionAnswer(Response):
    """An answer that lasts until the client disconnects, for any reason.

    The connection of a process that is killed is closed, also if a child has inherited it. Then the
    stage is stopped, a recording that this client has started is ended, and the lease is released,
    in this order.

    Args:
        context: The request; its client has the lease until the end.
        connection: Connection of the client.

    Raises:
        LeaseHeldError: If another client has the lease, or another process has a session.
    """

    media_type = "application/json"

    def __init__(self, context: RequestContext, connection: PeerProtocol) -> None:
        super().__init__(headers={"cache-control": "no-store"})
        del self.headers["content-length"]
        self._context, self._connection = context, connection
        self._lease = context.state.lease.bind(context.peer)
        context.note("session begun")

    async def __call__(self, _scope: Scope, _receive: Receive, send: Send) -> None:
        """Send the document of the lease, and wait for the end of the connection."""
        try:
            await send(
                {"type": "http.response.start", "status": 200, "headers": self.raw_headers},
            )
            body = dump(self._lease) + b"\n"
            await send({"type": "http.response.body", "body": body, "more_body": True})
            with closed_with_its_process(self._connection):
                await self._connection.closing.wait()
        finally:
            if self._connection.lost:
                await self._end()
            else:  # the daemon ends, and so does everything
                self._context.state.lease.unbind(self._context.peer)
        await send({"type": "http.response.body", "body": b""})

    async def _end(self) -> None:
        context = self._context
        why = await self._stop()
        try:
            await self._stop_recording()
        except StageError as error:  # it may have ended by itself meanwhile
            why = why or error.what
        finally:
            context.state.lease.unbind(context.peer)
        context.note("session ended: stop", why)

    async def _stop(self) -> str:
        """Stop the stage; return why that failed, empty if it was done."""
        why = ""
        for _ in range(_TRIES):
            try:
                return (await self._context.stage.request(Stop(), self._context.peer)).why
            except StageError as error:
                why = error.what
            await asyncio.sleep(RETRY_S)
        _LOG.error("stage not stopped after the end of its client", why=why)
        return why

    async def _stop_recording(self) -> None:
        context = self._context
        running = (await context.stage.recordings()).running
        started_by = context.state.recorders.get(running.name) if running else None
        if started_by == (context.peer.pid, context.peer.client):
            await context.stage.stop_recording(context.peer)


_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}")
_CHUNK: Final = 256 * 1024


def open_recording(folder: Path, name: str) -> int:
    """Open the file of a recording; return its descriptor.

    Raises:
        UnknownNameError: If the folder has no plain file of that name.
    """
    unknown = UnknownNameError(f"no recording {name[:100]!r}", "`piezod record list` shows them")
    if not _NAME.fullmatch(name):
        raise unknown
    try:
        inside = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
            descriptor = os.open(f"{name}.h5", flags, dir_fd=inside)
        finally:
            os.close(inside)
    except OSError as error:
        raise unknown from error
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise unknown
    return descriptor


class RecordingAnswer(Response):
    """The file of a recording, unchanged.

    Args:
        descriptor: The open file; closed at the end.
        name: Name of the recording.
        connection: Connection of the client.
        downloads: Users with a download in progress; includes this user until the end.
        uid: The user.
    """

    media_type = "application/x-hdf5"

    def __init__(
        self, descriptor: int, name: str, connection: PeerProtocol, downloads: set[int], uid: int
    ) -> None:
        self._descriptor, self._connection = descriptor, connection
        self._downloads, self._uid = downloads, uid
        downloads.add(uid)
        self._left = os.fstat(descriptor).st_size
        headers = {
            "content-length": str(self._left),
            "content-disposition": f'attachment; filename="{name}.h5"',
        }
        super().__init__(headers=headers)

    async def __call__(self, _scope: Scope, _receive: Receive, send: Send) -> None:
        """Send the file."""
        try:
            await send(
                {"type": "http.response.start", "status": 200, "headers": self.raw_headers},
            )
            while self._left and await self._send_chunk(send):
                pass
            await send({"type": "http.response.body", "body": b""})
        finally:
            self._downloads.discard(self._uid)
            os.close(self._descriptor)

    async def _send_chunk(self, send: Send) -> bool:
        # The file may grow, but the answer has its announced length. A thread, because a disk may
        # be slow.
        chunk = await asyncio.to_thread(os.read, self._descriptor, min(_CHUNK, self._left))
        self._left -= len(chunk)
        message = {"type": "http.response.body", "body": chunk, "more_body": True}
        await send(message)
        return bool(chunk) and not self._connection.closing.is_set()
