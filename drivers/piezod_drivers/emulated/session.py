"""The driver's end of the socket."""

import socket
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final

from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.emulated.codec import (
    MAX_PACKET,
    Greeting,
    RigReply,
    RigRequest,
    Wire,
    unpack_greeting,
)

_GREETING_S: Final = 2.0  # the rig may be busy with its physics after a pause
_RETRY_NS: Final = 100_000_000  # an absence is long enough to be noticed by whoever drives


class Link:
    """A connection that reports a fault as a value, and comes back when the rig does.

    At most one request is unanswered: what a rig that has stalled finds when it goes on is one old
    request, not a queue of them.

    Args:
        path: The rig's socket.
        deadline_s: How long to wait for an answer, in s.

    Attributes:
        life: Of the rig that was connected last, as it said in its greeting.
    """

    def __init__(self, path: Path, deadline_s: float) -> None:
        self._path, self._deadline_s = path, deadline_s
        self._socket: socket.socket | None = None
        self._wire = Wire(0)
        self._unanswered = False
        self._retry_ns = 0
        self.life = ""

    def connect(self) -> Greeting:
        """Connect and wait for the greeting.

        Raises:
            DeviceUnavailableError: If nobody is there, or it is busy or silent.
            DeviceError: If what answers is no rig.
        """
        greeting = self._connect(_GREETING_S)
        self._wire = Wire(len(greeting.axes))
        return greeting

    def reconnect(self, expected: Greeting, now_ns: int) -> None:
        """Try now and then, if the rig was lost, to connect to it or to one like it.

        May be called in the loop.

        Args:
            expected: The greeting of the rig that was lost.
            now_ns: The caller's instant.
        """
        if self._socket is not None or now_ns < self._retry_ns:
            return
        self._retry_ns = now_ns + _RETRY_NS
        with suppress(DeviceError):
            greeting = self._connect(self._deadline_s)
            if greeting._replace(life=expected.life) != expected:
                self.close()

    def exchange(self, request: RigRequest) -> RigReply | None:
        """Ask, and wait for the answer until the deadline; may be called in the loop.

        Returns:
            The answer, None where there is none in time.
        """
        if self._socket is None:
            return None
        try:
            if self._unanswered:
                self._receive(self._socket)
            self._socket.send(self._wire.pack_request(request))
            self._unanswered = True
            reply = self._receive(self._socket)
        except TimeoutError:
            return None
        except OSError:
            self.close()
            self._retry_ns = request.now_ns + _RETRY_NS
            return None
        return reply if reply is not None and reply.number == request.number else None

    def close(self) -> None:
        """Let go of the rig. Never raises."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _receive(self, link: socket.socket) -> RigReply | None:
        packet = link.recv(MAX_PACKET)
        if not packet:
            raise ConnectionResetError
        self._unanswered = False
        return self._wire.unpack_reply(packet)

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
            self._socket, self._unanswered, self.life = link, False, greeting.life
            unless_connected.pop_all()
        return greeting
