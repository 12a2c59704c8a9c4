"""A connection to the service: who is at the other end, and what he may keep it busy with."""

import asyncio
import json
import socket
import struct
from collections import deque
from typing import Any, Final, NamedTuple, cast

import h11
from starlette.types import Receive, Scope, Send
from uvicorn.config import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from piezod.daemon.service.refusals import UnknownPeerError

_EXTENSION: Final = "piezod.connection"
_BAD_WINDOW_S: Final = 10.0
_BAD_COUNT: Final = 10


class ConnectionLimits(NamedTuple):
    """What a connection may do.

    Attributes:
        message_s: How long a request may take to arrive, header and body.
        idle_s: How long nothing need arrive between requests.
        blocked_s: How long an answer may wait for its reader.
        per_user: Connections of one user that are served; as many more can only stop the stage.
    """

    message_s: float = 5.0
    idle_s: int = 60
    blocked_s: float = 5.0
    per_user: int = 16


class Credentials(NamedTuple):
    """Who opened a connection, as the kernel tells it."""

    pid: int
    uid: int
    gid: int


class PeerProtocol(H11Protocol):
    """HTTP on a unix socket; an application finds it in the extensions of its scope.

    Attributes:
        limits: What it may do.
        crowded: Whether its user has too many connections.
        closing: Set when the connection is gone or the server ends.
    """

    def __init__(
        self,
        config: Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
        limits: ConnectionLimits | None = None,
    ) -> None:
        super().__init__(config, server_state, app_state, _loop)
        self.limits = limits or ConnectionLimits()
        self._credentials: Credentials | None = None
        self.crowded = False
        self.closing = asyncio.Event()
        self._deadline: asyncio.TimerHandle | None = None
        self._blocked: asyncio.TimerHandle | None = None
        self._body_may_last = False
        self._bad_requests_s: deque[float] = deque(maxlen=_BAD_COUNT)
        self._inner_app = self.app
        self.app = self._with_connection

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override] # as the base
        """Note who it is, and close it at once if he has far too many already."""
        super().connection_made(transport)
        self._credentials = _credentials(transport.get_extra_info("socket"))
        mine = sum(
            isinstance(other, PeerProtocol) and other.is_of(self._credentials)
            for other in self.connections
        )
        self.crowded = mine > self.limits.per_user
        if mine > 2 * self.limits.per_user:
            transport.write(_response("429 Too Many Requests", "too_many", "too many connections"))
            transport.close()
            return
        self.timeout_keep_alive_task = self.loop.call_later(
            self.limits.idle_s, self.timeout_keep_alive_handler
        )

    def connection_lost(self, exc: Exception | None) -> None:
        """Tell whoever is still answering."""
        super().connection_lost(exc)
        self._unset_keepalive_if_required()
        self._disarm()
        self.resume_writing()
        self.closing.set()

    def data_received(self, data: bytes) -> None:
        """Take what has arrived; what began must be complete in time."""
        super().data_received(data)
        self._watch()

    def on_response_complete(self) -> None:
        """Go on with the next request."""
        self._body_may_last = False
        super().on_response_complete()
        self._watch()

    def pause_writing(self) -> None:
        """Wait for a reader who is slow, but not for ever: what was made for him is dropped."""
        super().pause_writing()
        self._give_time_to_read()

    def resume_writing(self) -> None:
        """Go on, he has read."""
        super().resume_writing()
        if self._blocked is not None:
            self._blocked.cancel()
            self._blocked = None

    def timeout_keep_alive_handler(self) -> None:
        """Close what is idle; whoever has not read his answer by now does not get it."""
        super().timeout_keep_alive_handler()
        self._give_time_to_read()

    def shutdown(self) -> None:
        """Have long answers end, and drop who sends a long body; called when the server ends."""
        super().shutdown()
        self.closing.set()
        if self._body_may_last:
            self.abort()
        self._give_time_to_read()

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP, in the form of all errors."""
        self.transport.write(_response("400 Bad Request", "bad_request", msg))
        self.transport.close()

    @property
    def credentials(self) -> Credentials:
        """Who is at the other end.

        Raises:
            UnknownPeerError: If the kernel does not tell, because it is no unix socket.
        """
        if self._credentials is None:
            raise UnknownPeerError("only connections to the unix socket tell who asks")
        return self._credentials

    def is_of(self, other: Credentials | None) -> bool:
        """Tell whether it has the same user."""
        mine = self._credentials
        return mine == other or (mine is not None and other is not None and mine.uid == other.uid)

    @property
    def receiving(self) -> bool:
        """Whether the body of the request has not arrived completely."""
        return self.conn.their_state is h11.SEND_BODY

    def let_body_last(self) -> None:
        """Allow the body of this request any time; its reader watches over it from now on."""
        self._body_may_last = True
        self._disarm()

    def note_bad_request(self) -> bool:
        """Count a request that was malformed; tells whether there were ten within 10 s."""
        now_s = self.loop.time()
        self._bad_requests_s.append(now_s)
        full = len(self._bad_requests_s) == _BAD_COUNT
        return full and now_s - self._bad_requests_s[0] <= _BAD_WINDOW_S

    def abort(self) -> None:
        """Close at once, whatever has not been sent."""
        self.transport.abort()

    async def _with_connection(self, scope: Scope, receive: Receive, send: Send) -> None:
        scope["extensions"] = {_EXTENSION: self}
        await self._inner_app(scope, receive, send)

    def _give_time_to_read(self) -> None:
        if self._blocked is None:
            self._blocked = self.loop.call_later(self.limits.blocked_s, self.abort)

    def _watch(self) -> None:
        waiting_for_header = self.conn.their_state is h11.IDLE and bool(self.conn.trailing_data[0])
        if not waiting_for_header and (not self.receiving or self._body_may_last):
            self._disarm()
        elif self._deadline is None:
            self._deadline = self.loop.call_later(self.limits.message_s, self.abort)

    def _disarm(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None


def connection_of(scope: Scope) -> PeerProtocol:
    """Return the connection that a request came by."""
    return cast("PeerProtocol", scope["extensions"][_EXTENSION])


def _credentials(endpoint: socket.socket) -> Credentials | None:
    if endpoint.family != socket.AF_UNIX:
        return None
    layout = struct.Struct("iII")
    packed = endpoint.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, layout.size)
    return Credentials(*layout.unpack(packed))


def _response(status: str, code: str, what: str) -> bytes:
    body = json.dumps({"error": {"code": code, "what": what, "remedy": ""}})
    header = f"HTTP/1.1 {status}\r\ncontent-type: application/json\r\nconnection: close"
    return f"{header}\r\ncontent-length: {len(body)}\r\n\r\n{body}".encode()
