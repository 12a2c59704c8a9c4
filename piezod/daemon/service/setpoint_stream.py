"""A stream of setpoints from another program: each line of JSON takes effect on arrival."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any, Final

from starlette.requests import ClientDisconnect, Request

from piezod.config.states import State
from piezod.daemon.service.answers import SilentError, TooLargeError
from piezod.daemon.service.connection import PeerProtocol
from piezod.daemon.service.request import OpenStream, RequestContext
from piezod.daemon.service.route import loads
from piezod.daemon.stage.errors import BadValueError, StageError
from piezod.messages.answers import StreamEnd
from piezod.messages.requests import Stream

MAX_LINE: Final = 1024
_REMEDY: Final = 'each line must be like {"x": 12.5}, in µm, with the axes of the first line'
_GONE_LEASE_S: Final = 2.0
_LINES_AT_ONCE: Final = 100
_QUIET_S: Final = 0.2
_QUIET_CYCLES: Final = 7
_POLL_S: Final = 0.01
"""A stage holds 0.1 s or 5 cycles after the last setpoint; the wait for it is a little longer."""


class SetpointStream:
    """Follows one stream to its end."""

    def __init__(self, context: RequestContext, connection: PeerProtocol) -> None:
        self._context, self._connection = context, connection
        self._stream = OpenStream(())
        self.count = 0

    async def run(self, request: Request) -> StreamEnd:
        """Take setpoints until the client ends the stream.

        Returns:
            The number of setpoints.

        Raises:
            StageError: If the stage does not follow, another request takes over an axis, a line is
                not valid, or no line arrives for 5 s.
        """
        self._context.state.lease.check(self._context.peer)
        self._connection.let_body_last()
        why = ""
        try:
            async for line in _lines(request, self._connection.limits.message_s):
                await self._take(loads(line))
        except StageError as error:
            why = error.what
            raise
        except ClientDisconnect:
            why = "the client disconnected"
            self._context.state.lease.shorten(self._context.peer, _GONE_LEASE_S)
            raise
        else:
            await self._wait_for_hold()
        finally:
            self._context.state.streams.close(self._stream)
            self._context.note(f"stream ended after {self.count} setpoints", why)
        return StreamEnd(setpoints=self.count)

    async def _wait_for_hold(self) -> None:
        """Wait until the stage holds after the last setpoint, if nothing else moves it."""
        stage = self._context.stage
        period_s = 1.0 / stage.config()["rate_hz"]
        waits = round((_QUIET_S + _QUIET_CYCLES * period_s) / _POLL_S)
        for _ in range(waits if self.count else 0):
            if stage.state != State.RUN:
                return
            await asyncio.sleep(_POLL_S)

    async def _take(self, document: Any) -> None:
        setpoints_um = _setpoints(document)
        if not self._stream.axes:
            await self._context.ask(Stream(axes=tuple(setpoints_um)))
            self._stream = self._context.state.streams.open(setpoints_um)
        if not setpoints_um.keys() <= self._stream.axes:
            raise BadValueError("a line names an axis that the first line does not name", _REMEDY)
        self._context.claim()
        self._stream.check()
        self._context.stage.stream_setpoint(setpoints_um)
        self.count += 1
        if self.count % _LINES_AT_ONCE == 0:
            await asyncio.sleep(0)  # serve other requests


def _setpoints(document: Any) -> dict[str, float]:
    if not isinstance(document, dict) or not document:
        raise BadValueError("a line is not an object with setpoints", _REMEDY)
    for axis, value in document.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BadValueError(f"{axis[:32]}: must be a number", _REMEDY)
    return {axis: float(value) for axis, value in document.items()}


async def _lines(request: Request, silence_s: float) -> AsyncIterator[bytes]:
    rest = b""
    chunks = request.stream()
    while True:
        try:
            async with asyncio.timeout(silence_s):
                chunk = await anext(chunks, None)
        except TimeoutError:
            what = f"no setpoint arrived for {silence_s:g} s"
            raise SilentError(what, "start a new stream for further setpoints") from None
        *complete, rest = (rest + (b"\n" if chunk is None else chunk)).split(b"\n")
        for line in complete:
            _check_length(line)
            if line.strip():
                yield line
        _check_length(rest)
        if chunk is None:
            return


def _check_length(line: bytes) -> None:
    if len(line) > MAX_LINE:
        raise TooLargeError(f"a line is too long, allowed: at most {MAX_LINE} bytes")
