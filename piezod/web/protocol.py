"""The WebSocket of a tab on its connection, with a limit of time for a tab that does not read."""

import asyncio
from typing import Final

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

BLOCKED_S: Final = 5.0
"""Longest time that a text waits for its reader, in s."""


class TabProtocol(WebSocketsSansIOProtocol):
    """A WebSocket that is closed when its reader does not read."""

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

    def connection_lost(self, exc: Exception | None) -> None:
        """End the connection."""
        self._forget_limit()
        super().connection_lost(exc)

    def _forget_limit(self) -> None:
        if self._blocked is not None:
            self._blocked.cancel()
            self._blocked = None
