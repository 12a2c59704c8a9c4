"""A request that is sent beside others, and whose reply is set aside when it comes."""

from typing import Final

from piezod_drivers.serial_line.thorlabs_apt import codec
from piezod_drivers.serial_line.thorlabs_apt.codec import Id
from piezod_drivers.serial_line.thorlabs_apt.filtered_line import FilteredLine

PERIOD_NS: Final = 100_000_000
"""Time between two requests."""
MAX_AGE_NS: Final = 1_000_000_000
"""After this time without a reply to a request, the last reply is too old."""
# A cube stops sending statuses after about 50 unless it gets this message at least once a second.
_ALIVE: Final = codec.short(Id.ACK_STATUS)


class SideRequest:
    """Requests a state of the cube ten times a second, without waiting for the reply.

    Args:
        line: The line to the cube; it sets the reply aside.
        answer: Identifier of its reply.
    """

    def __init__(self, line: FilteredLine, request: bytes, answer: int) -> None:
        self._line, self._message, self._answer = line, _ALIVE + request, answer
        self._due_ns = 0
        self._unanswered_ns: int | None = None  # instant of the first request without a reply
        self._latest: bytes | None = None

    def restart(self) -> None:
        """Forget the last reply; the next request is due at once."""
        self._take()
        self._due_ns, self._unanswered_ns, self._latest = 0, None, None

    def due(self) -> bytes:
        """Return the bytes to send before the next request: none if it is too early."""
        now_ns = self._line.now_ns()
        if now_ns < self._due_ns:
            return b""
        self._take()
        self._due_ns = now_ns + PERIOD_NS
        if self._unanswered_ns is None:
            self._unanswered_ns = now_ns
        return self._message

    def latest(self) -> bytes | None:
        """Return the last reply, None before the first one."""
        self._take()
        return self._latest

    @property
    def overdue(self) -> bool:
        """Whether the last reply is too old to be relied on."""
        self._take()
        since_ns = self._unanswered_ns
        return since_ns is not None and self._line.now_ns() - since_ns >= MAX_AGE_NS

    def _take(self) -> None:
        frame = self._line.aside.pop(self._answer, None)
        if frame is not None:
            self._latest, self._unanswered_ns = frame, None
