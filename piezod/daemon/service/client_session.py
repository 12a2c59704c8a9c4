"""A session: one client commands the stage, and the stage stops when its connection closes."""

import asyncio
from typing import Final

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from piezod.daemon.logging import logger
from piezod.daemon.service.peer_process import closed_with_its_process
from piezod.daemon.service.peer_protocol import PeerProtocol
from piezod.daemon.service.request_context import RequestContext
from piezod.daemon.stage.errors import StageError
from piezod.messages.documents import dump
from piezod.messages.requests import Stop

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
