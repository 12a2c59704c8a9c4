"""Requests and replies over a line, one at a time; a late reply is never taken for the next one."""

from collections.abc import Callable
from contextlib import suppress
from typing import Final, TypeAlias

from piezod.devices.bus.line import Line, LineFault, NoticingLine
from piezod.devices.status import DeviceFlag

LengthOf: TypeAlias = Callable[[bytes], int]
"""Returns the length of the frame at the start of the received bytes: 0 if more bytes are needed,
-n if the first n bytes are garbage."""
Fits: TypeAlias = Callable[[bytes], bool]
"""Returns whether a frame can be the reply."""

PATIENCE: Final = 10
"""Number of time-outs after which a late reply counts as lost."""
SLOW: Final = 0.8
"""Share of the time-out above which a reply counts as slow."""
MOST_BYTES: Final = 65_536
"""Number of bytes without a frame above which they count as garbage."""


class _StillOwedError(LineFault):
    """Raised if no request may be sent, because a late reply may still come."""


class Conversation:
    """Sends requests and waits for replies, with a deadline.

    If replies carry a tag of their request, `is_reply` identifies them, and a late reply is dropped
    on arrival. If they do not, no request is sent after a time-out until the late reply has come,
    or can no longer come: `PATIENCE` time-outs later. A frame that cannot be that reply, for
    example an unsolicited warning of the device, does not end this waiting.

    Args:
        line: The line; its owner opens and closes it.
        timeout_s: Time-out of a reply, in s.
    """

    def __init__(self, line: Line, timeout_s: float) -> None:
        self._line, self._timeout_ns = line, round(timeout_s * 1e9)
        self._notices = line if isinstance(line, NoticingLine) else None
        self._rest = b""  # received after the last frame
        # State after a time-out: how to recognise the owed reply, and when it counts as lost.
        self._owed: LengthOf | None = None
        self._owed_fits: Fits | None = None
        self._owed_until_ns = 0
        self._noticed: set[DeviceFlag] = set()

    def restart(self) -> None:
        """Start anew; call it whenever the line was opened.

        A late reply stays owed: a device on a serial port does not notice that the port was opened
        again, and may still answer.
        """
        self._rest = b""
        self._noticed.clear()

    def wait_out(self) -> None:
        """Wait until a late reply comes or can no longer come. Not for use in the loop.

        This is for opening: a device may leave a request unanswered that it does not know.

        Raises:
            LineFault: As raised by the line.
        """
        while self._owed is not None:
            left_ns = self._owed_until_ns - self._line.now_ns()
            if left_ns > 0:  # the wait also ends when bytes arrive
                self._rest += self._line.receive(left_ns)
            with suppress(_StillOwedError):
                self._drop_earlier()

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the faults that did not make an exchange fail."""
        noticed, self._noticed = self._noticed, set()
        if self._notices is not None:
            noticed |= self._notices.take_noticed()
        return noticed

    def forget_noticed(self) -> None:
        """Clear the faults noticed before the first request to the device; they do not count."""
        self._noticed.clear()

    def tell(self, message: bytes) -> None:
        """Send a message that has no reply. Real-time safe.

        Raises:
            LineFault: If it was not sent, or a reply is still owed.
        """
        self._drop_earlier()
        self._line.send(message)

    def ask(
        self,
        request: bytes,
        length_of: LengthOf,
        is_reply: Fits | None = None,
        timeout_ns: int | None = None,
        fits: Fits | None = None,
    ) -> bytes:
        """Send a request and return the frame that answers it. Real-time safe.

        Args:
            request: Bytes to send.
            length_of: Finds frames.
            is_reply: Returns whether a frame answers this very request; None without a tag.
            timeout_ns: Time-out in ns, if it differs from the default.
            fits: For frames without a tag: returns whether a frame has the type of this reply or is
                an error reply. Other frames are garbage, and the reply stays owed.

        Raises:
            LineFault: `LATE_REPLY` if no reply came in time, or as raised by the line.
        """
        if self._owed is not None or self._rest:
            self._drop_earlier()
        line = self._line
        # Bytes that came before the request cannot be its reply.
        if stale := line.receive(0):
            self._note_dropped(stale)
        line.send(request)
        belongs = is_reply or fits  # None: every frame is the reply
        begin_ns = line.now_ns()
        wait_ns = self._timeout_ns if timeout_ns is None else timeout_ns
        end_ns = begin_ns + wait_ns
        got, left_ns = b"", wait_ns
        while left_ns > 0:
            got += line.receive(left_ns)
            # One delivery may hold a part of a frame, or several frames with garbage in between.
            while length := length_of(got):
                if length < 0:
                    self._noticed.add(DeviceFlag.GARBAGE)
                    got = got[-length:]
                    continue
                frame, got = got[:length], got[length:]
                if belongs is None or belongs(frame):
                    self._rest = got
                    if line.now_ns() - begin_ns > SLOW * wait_ns:
                        self._noticed.add(DeviceFlag.SLOW_REPLY)
                    return frame
                # With a tag it is the reply to an earlier request; without one it is unsolicited.
                self._noticed.add(DeviceFlag.OUT_OF_ORDER if is_reply else DeviceFlag.GARBAGE)
            if len(got) > MOST_BYTES:
                got = b""
                self._noticed.add(DeviceFlag.GARBAGE)
            left_ns = end_ns - line.now_ns()
        self._keep_rest(got)
        # A late reply without a tag could be taken for the next one, so it has to be waited for.
        if is_reply is None:
            self._owed, self._owed_fits = length_of, fits
            self._owed_until_ns = end_ns + PATIENCE * wait_ns
        raise LineFault(DeviceFlag.LATE_REPLY, f"no reply within {wait_ns / 1e6:g} ms")

    def _keep_rest(self, got: bytes) -> None:
        """Keep the bytes of an incomplete frame: its end may still come."""
        self._rest = got
        if got:
            self._noticed.add(DeviceFlag.GARBAGE)

    def _drop_earlier(self) -> None:
        """Drop the bytes that belong to earlier requests.

        Raises:
            LineFault: If a reply may still come that would be taken for another.
        """
        if self._owed is None:
            self._note_dropped(self._rest)
            self._rest = b""
            return
        # Read the clock before the line: a reply that comes in between is then still received.
        now_ns = self._line.now_ns()
        got = self._rest + self._line.receive(0)
        self._rest = got[-MOST_BYTES:]
        while (length := self._owed(self._rest)) and not self._is_owed_reply(length):
            self._rest = self._rest[abs(length) :]
        if length == 0 and now_ns < self._owed_until_ns:
            raise _StillOwedError(DeviceFlag.LATE_REPLY, "a late reply may still come")
        self._noticed.add(DeviceFlag.LATE_REPLY)
        self._rest, self._owed = b"", None

    def _is_owed_reply(self, length: int) -> bool:
        """Return whether the first frame is the owed reply; note any other frame as garbage."""
        fits = self._owed_fits
        if length > 0 and (fits is None or fits(self._rest[:length])):
            return True
        self._noticed.add(DeviceFlag.GARBAGE)
        return False

    def _note_dropped(self, stale: bytes) -> None:
        if stale:
            self._noticed.add(DeviceFlag.OUT_OF_ORDER)
