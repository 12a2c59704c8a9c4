"""The connections of browsers, with limits of time: for a request, and for a tab that reads."""

import asyncio
from typing import Final

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import CloseCode

BLOCKED_S: Final = 5.0
"""Longest time that a text waits for its reader, in s."""
REQUEST_S: Final = 10.0
"""Longest time until the first request of a connection, in s; browsers open some in advance."""


class PageProtocol(H11Protocol):
    """HTTP until a request becomes a WebSocket."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override] # as the base
        """Wait for the first request, up to the limit."""
        super().connection_made(transport)
        self._limit = self.loop.call_later(REQUEST_S, self._end_without_request)

    def connection_lost(self, exc: Exception | None) -> None:
        """End the connection."""
        self._limit.cancel()
        super().connection_lost(exc)

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Hand the connection over: a WebSocket lasts longer."""
        self._limit.cancel()
        super().handle_websocket_upgrade(event)

    def send_400_response(self, msg: str) -> None:
        """Refuse data that is not HTTP; a request that it follows gets no other answer."""
        super().send_400_response(msg)
        if self.cycle is not None:
            self.cycle.disconnected = True

    def _end_without_request(self) -> None:
        if self.cycle is None:
            self.transport.abort()


class TabProtocol(WebSocketsSansIOProtocol):
    """A WebSocket that is closed when its reader does not read, or sends what is no text."""

    _blocked: asyncio.TimerHandle | None = None

    def pause_writing(self) -> None:
        """Wait for a slow reader, up to the limit; then drop what was not sent."""
        super().pause_writing()
        if self._blocked is None:
            self._blocked = self.loop.call_later(BLOCKED_S, self.transport.abort)

    def resume_writing(self) -> None:
        """Continue after the reader has read."""
        super().resume_writing()
        self._forget_limit()

    def send_receive_event_to_app(self) -> None:
        """Hand a message on; uvicorn would log a traceback for a text that is not UTF-8."""
        if self.curr_msg_data_type == "text" and not self.close_sent:
            try:
                b"".join(self.frames).decode()
            except UnicodeDecodeError:
                self.conn.send_close(CloseCode.INVALID_DATA, "a text must be UTF-8")
                self.handle_parser_exception()
                return
        super().send_receive_event_to_app()

    def connection_lost(self, exc: Exception | None) -> None:
        """End the connection."""
        self._forget_limit()
        super().connection_lost(exc)

    def _forget_limit(self) -> None:
        if self._blocked is not None:
            self._blocked.cancel()
            self._blocked = None
