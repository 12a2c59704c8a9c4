"""The driver's end of the socket."""

import socket
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final

from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.emulated.codec import (
    MAX_PACKET,
    Greeting,
    RigCodec,
    RigReply,
    RigRequest,
    unpack_greeting,
)

_GREETING_S: Final = 2.0  # after a pause the rig may be busy with its physics
_RETRY_NS: Final = 100_000_000  # long enough that the caller notices the absence


class RigSession:
    """A connection that reports a fault as a value, and returns when the rig does.

    At most one request is without a reply. A stalled rig that continues finds one old request, not
    a queue of them.

    Args:
        path: Socket of the rig.
        deadline_s: Longest wait for a reply, in s.

    Attributes:
        run_id: Run of the last connected rig, from its greeting.
    """

    def __init__(self, path: Path, deadline_s: float) -> None:
        self._path, self._deadline_s = path, deadline_s
        self._socket: socket.socket | None = None
        self._codec = RigCodec(0)
        self._unanswered = False
        self._retry_ns = 0
        self.run_id = ""

    def connect(self) -> Greeting:
        """Connect and wait for the greeting.

        Raises:
            DeviceUnavailableError: If the rig is absent, busy or silent.
            DeviceError: If the reply is not a greeting.
        """
        greeting = self._connect(_GREETING_S)
        self._codec = RigCodec(len(greeting.axes))
        return greeting

    def reconnect(self, expected: Greeting, now_ns: int) -> None:
        """Try at intervals to connect again to a lost rig, or to an equal one. Real-time safe.

        Args:
            expected: Greeting of the lost rig.
            now_ns: The caller's instant.
        """
        if self._socket is not None or now_ns < self._retry_ns:
            return
        self._retry_ns = now_ns + _RETRY_NS
        with suppress(DeviceError):
            greeting = self._connect(self._deadline_s)
            # An equal rig may have restarted; any other difference makes it another rig.
            if greeting._replace(run_id=expected.run_id) != expected:
                self.close()

    def exchange(self, request: RigRequest) -> RigReply | None:
        """Send a request and wait for its reply until the deadline. Real-time safe.

        Returns:
            The reply, None if there is none in time.
        """
        if self._socket is None:
            return None
        try:
            # Drop the late reply to the last request first, or skip this exchange.
            if self._unanswered:
                self._receive(self._socket)
            self._socket.send(self._codec.pack_request(request))
            self._unanswered = True
            reply = self._receive(self._socket)
        # The late reply stays in the socket; the next exchange drops it first.
        except TimeoutError:
            return None
        except OSError:
            self.close()
            self._retry_ns = request.now_ns + _RETRY_NS
            return None
        return reply if reply is not None and reply.number == request.number else None

    def close(self) -> None:
        """Disconnect. Never raises."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _receive(self, link: socket.socket) -> RigReply | None:
        packet = link.recv(MAX_PACKET)
        # An empty packet means that the rig has closed the connection.
        if not packet:
            raise ConnectionResetError
        self._unanswered = False
        return self._codec.unpack_reply(packet)

    def _connect(self, deadline_s: float) -> Greeting:
        with ExitStack() as unless_connected:
            link = unless_connected.enter_context(
                socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            )
            link.settimeout(deadline_s)
            try:
                link.connect(str(self._path))
                greeting = unpack_greeting(link.recv(MAX_PACKET))
            except OSError as error:
                raise DeviceUnavailableError(f"no rig at {self._path}: {error}") from error
            if isinstance(greeting, str):
                raise DeviceUnavailableError(f"the rig at {self._path} refuses: {greeting}")
            link.settimeout(self._deadline_s)
            self._socket, self._unanswered, self.run_id = link, False, greeting.run_id
            # Connected: the socket stays open.
            unless_connected.pop_all()
        return greeting
