"""A request that is sent beside others, and whose reply is set aside when it comes."""

from typing import Final

from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.codec import Id
from piezod_drivers.serial_line.thorlabs_apt.filtered_line import FilteredLine

PERIOD_NS: Final = 100_000_000
"""Time between two requests."""
MAX_UNANSWERED: Final = 10
"""After this number of requests without a reply, the last reply is too old: one second."""
# A cube stops sending statuses after about 50 unless it gets this message at least once a second.
_ALIVE: Final = codec.short(Id.ACK_STATUS)


class SideRequest:
    """Requests a state of the cube ten times a second, without waiting for the reply.

    Args:
        line: The line to the cube; it sets the reply aside.
        request: The request.
        answer: Identifier of its reply.
    """

    def __init__(self, line: FilteredLine, request: bytes, answer: int) -> None:
        self._line, self._message, self._answer = line, _ALIVE + request, answer
        self._due_ns = 0
        self._unanswered = 0
        self._latest: bytes | None = None

    def restart(self) -> None:
        """Forget the last reply; the next request is due at once."""
        self._take()
        self._due_ns, self._unanswered, self._latest = 0, 0, None

    def due(self) -> bytes:
        """Return the bytes to send before the next request: none if it is too early."""
        now_ns = self._line.now_ns()
        if now_ns < self._due_ns:
            return b""
        self._take()
        self._due_ns = now_ns + PERIOD_NS
        self._unanswered += 1
        return self._message

    def latest(self) -> bytes | None:
        """Return the last reply, None before the first one."""
        self._take()
        return self._latest

    @property
    def overdue(self) -> bool:
        """Whether the last reply is too old to be relied on."""
        self._take()
        return self._unanswered > MAX_UNANSWERED

    def _take(self) -> None:
        frame = self._line.aside.pop(self._answer, None)
        if frame is not None:
            self._latest, self._unanswered = frame, 0
