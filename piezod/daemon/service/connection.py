"""A connection to the service: user and process at the other end, limits of time and number.

The rights of a request depend on the user who sends it, which the kernel tells of a unix socket;
and no client that is slow, silent or broken may keep another one from an emergency stop. uvicorn
does neither, so its HTTP protocol is extended here. That needs parts of it which are not
documented: the class itself, its parser `conn`, its task for idle connections.
"""

import asyncio
import json
import os
import socket
import struct
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, NamedTuple, cast

import h11
from starlette.types import Receive, Scope, Send
from uvicorn.config import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from piezod.daemon.service.answers import UnknownPeerError

_EXTENSION: Final = "piezod.connection"
_BAD_WINDOW_S: Final = 10.0
_BAD_COUNT: Final = 10


class ConnectionLimits(NamedTuple):
    """Limits of a connection."""

    message_s: float = 5.0  #: Longest time for a request to arrive, header and body, in s.
    idle_s: int = 60  #: Longest pause between requests, in s.
    blocked_s: float = 5.0  #: Longest time that an answer waits for its reader, in s.
    #: Connections of one user that are served; as many more can only stop the stage.
    per_user: int = 16
    #: Time after which a connection without a request makes room for another one, in s.
    fresh_s: float = 1.0


class Credentials(NamedTuple):
    """Process, user and group that opened a connection, as the kernel reports them."""

    pid: int
    uid: int
    gid: int


class PeerProtocol(H11Protocol):
    """HTTP on a unix socket; `connection_of` finds it in the scope of a request.

    Attributes:
        limits: Limits of time and number.
        crowded: Whether its user has too many connections.
        since_s: Begin of the connection or end of its last request, on the clock of asyncio, in s.
        closing: Set when the connection is closed or the server ends.
        lost: Whether the connection is closed.
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
        self.closing, self.lost = asyncio.Event(), False
        self._deadline: asyncio.TimerHandle | None = None
        self._blocked: asyncio.TimerHandle | None = None
        self._body_may_last = False
        self.since_s = 0.0
        self._bad_requests_s: deque[float] = deque(maxlen=_BAD_COUNT)
        self._inner_app = self.app
        self.app = self._with_connection

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override] # as the base
        """Note the user, and close another connection of a user that has too many."""
        super().connection_made(transport)
        self._credentials = _credentials(transport.get_extra_info("socket"))
        self.since_s = self.loop.time()
        self.crowded = self._make_room()
        self.timeout_keep_alive_task = self.loop.call_later(
            self.limits.idle_s, self.timeout_keep_alive_handler
        )

    def connection_lost(self, exc: Exception | None) -> None:
        """Set `closing`, for answers that are still being sent."""
        super().connection_lost(exc)
        self._unset_keepalive_if_required()
        self._cancel_deadline()
        self.resume_writing()
        self.lost = True
        self.closing.set()

    def data_received(self, data: bytes) -> None:
        """Process received data, and start the time-out of an incomplete request."""
        super().data_received(data)
        self._update_deadline()

    def on_response_complete(self) -> None:
        """Continue with the next request."""
        self._body_may_last, self.since_s = False, self.loop.time()
        super().on_response_complete()
        self._update_deadline()

    def pause_writing(self) -> None:
        """Wait for a slow reader, up to the time-out; then close the connection."""
        super().pause_writing()
        self._start_reader_timeout()

    def resume_writing(self) -> None:
        """Continue after the reader has read."""
        super().resume_writing()
        if self._blocked is not None:
            self._blocked.cancel()
            self._blocked = None

    def timeout_keep_alive_handler(self) -> None:
        """Close an idle connection; an unread answer is dropped after the time-out."""
        super().timeout_keep_alive_handler()
        self._start_reader_timeout()

    def shutdown(self) -> None:
        """End long answers and abort long bodies; called when the server ends."""
        super().shutdown()
        self.closing.set()
        if self._body_may_last:
            self.abort()
        self._start_reader_timeout()

    def send_400_response(self, msg: str) -> None:
        """Answer data that is not HTTP with an error document."""
        self.transport.write(_response("400 Bad Request", "bad_request", msg))
        self.transport.close()

    @property
    def credentials(self) -> Credentials:
        """The user at the other end.

        Raises:
            UnknownPeerError: If the connection is not on a unix socket, so that the kernel does
                not report the user.
        """
        if self._credentials is None:
            raise UnknownPeerError("the user is known on connections to the unix socket only")
        return self._credentials

    def is_of(self, other: Credentials | None) -> bool:
        """Return whether the connection is of the same user."""
        mine = self._credentials
        return mine == other or (mine is not None and other is not None and mine.uid == other.uid)

    @property
    def receiving(self) -> bool:
        """Whether the body of the request is incomplete."""
        return self.conn.their_state is h11.SEND_BODY

    def let_body_last(self) -> None:
        """Allow the body of this request any time; from now on its reader has the time-out."""
        self._body_may_last = True
        self._cancel_deadline()

    def note_bad_request(self) -> bool:
        """Count a bad request; return whether there were ten within 10 s."""
        now_s = self.loop.time()
        self._bad_requests_s.append(now_s)
        full = len(self._bad_requests_s) == _BAD_COUNT
        return full and now_s - self._bad_requests_s[0] <= _BAD_WINDOW_S

    def abort(self) -> None:
        """Close at once and drop unsent data."""
        self.transport.abort()

    async def _with_connection(self, scope: Scope, receive: Receive, send: Send) -> None:
        scope["extensions"] = {_EXTENSION: self}
        await self._inner_app(scope, receive, send)

    def _make_room(self) -> bool:
        """Return whether the user has too many other connections; close one of them if necessary.

        A new connection is never refused: it may be for an emergency stop. Idle connections are
        closed first, then those that were too many themselves, the oldest first.
        """
        others = [
            other
            for other in self.connections
            if isinstance(other, PeerProtocol)
            and other is not self
            and other.is_of(self._credentials)
            and not other.transport.is_closing()
        ]
        if len(others) < self.limits.per_user:
            return False
        before_s = self.loop.time() - self.limits.fresh_s
        idle = [other for other in others if other.is_idle and other.since_s <= before_s]
        crowded = [other for other in others if other.crowded]
        if idle:
            min(idle, key=lambda other: other.since_s).transport.close()
            others.pop()
        elif len(others) >= 2 * self.limits.per_user:
            min(crowded, key=lambda other: other.since_s).abort()
        return len(others) >= self.limits.per_user

    @property
    def is_idle(self) -> bool:
        """Whether no request has arrived in part, and none is being answered."""
        conn = self.conn
        return conn.our_state is conn.their_state is h11.IDLE and not conn.trailing_data[0]

    def _start_reader_timeout(self) -> None:
        if self._blocked is None:
            self._blocked = self.loop.call_later(self.limits.blocked_s, self.abort)

    def _update_deadline(self) -> None:
        waiting_for_header = self.conn.their_state is h11.IDLE and bool(self.conn.trailing_data[0])
        if not waiting_for_header and (not self.receiving or self._body_may_last):
            self._cancel_deadline()
        elif self._deadline is None:
            self._deadline = self.loop.call_later(self.limits.message_s, self.abort)

    def _cancel_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None


def connection_of(scope: Scope) -> PeerProtocol:
    """Return the connection of a request."""
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


@contextmanager
def closed_with_its_process(connection: PeerProtocol) -> Iterator[None]:
    """Close a connection when the process that opened it ends.

    The kernel alone closes it later, if a child of that process has inherited the socket.

    Args:
        connection: Connection to a unix socket. Where the kernel gives no handle of its process,
            as for one of another container, nothing is watched.
    """
    try:
        handle = os.pidfd_open(connection.credentials.pid)
    except ProcessLookupError:  # it has ended already
        connection.abort()
        yield
        return
    except OSError:
        yield
        return
    loop = asyncio.get_running_loop()
    loop.add_reader(handle, connection.abort)
    try:
        yield
    finally:
        loop.remove_reader(handle)
        os.close(handle)
