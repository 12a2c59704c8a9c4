"""Requests and replies over a line, one at a time; a late reply is never taken for the next one."""

from collections.abc import Callable
from contextlib import suppress
from typing import Final, TypeAlias

from piezod.devices.bus.line import Line, LineFault, NoticingLine
from piezod.devices.status import DeviceFlag

LengthOf: TypeAlias = Callable[[bytes], int]
"""Tells how many of the bytes that have come, from the first on, make a frame; 0 as long as more
has to come; -n where the first n are garbage."""
Fits: TypeAlias = Callable[[bytes], bool]
"""Tells of a frame whether it can be the reply."""

PATIENCE: Final = 10
"""A reply is taken for lost when it has been late for so many time-outs."""
SLOW: Final = 0.8
"""A reply that takes more than this part of its time is slow."""
MOST_BYTES: Final = 65_536
"""More than this without a frame is garbage, however it goes on."""


class _StillOwedError(LineFault):
    """Raised where nothing may be asked, because a late reply may still come."""


class Conversation:
    """Asks and waits, with a deadline.

    Where replies carry a tag of their request, `is_reply` tells them apart, and a reply that comes
    too late is dropped when it comes. Where they do not, nothing is asked after a time-out until
    the late reply has come, or can no longer come: `PATIENCE` time-outs later. A frame that cannot
    be that reply, as a warning that the device sends by itself, ends no waiting.

    Args:
        line: The line, opened and closed by whoever owns it.
        timeout_s: How long to wait for a reply, in s.
    """

    def __init__(self, line: Line, timeout_s: float) -> None:
        self._line, self._timeout_ns = line, round(timeout_s * 1e9)
        self._notices = line if isinstance(line, NoticingLine) else None
        self._rest = b""
        self._owed: LengthOf | None = None
        self._owed_fits: Fits | None = None
        self._owed_until_ns = 0
        self._noticed: set[DeviceFlag] = set()

    def restart(self) -> None:
        """Begin anew; to be called whenever the line was opened.

        A late reply that may still come is not forgotten: a device on a serial port does not know
        that the port was opened again.
        """
        self._rest = b""
        self._noticed.clear()

    def wait_out(self) -> None:
        """Wait for a late reply until it comes or can no longer come; not to be called in the loop.

        For opening: a device that does not know a request may leave it unanswered.

        Raises:
            LineFault: Whatever the line raises.
        """
        while self._owed is not None:
            left_ns = self._owed_until_ns - self._line.now_ns()
            if left_ns > 0:
                self._rest += self._line.receive(left_ns)
            with suppress(_StillOwedError):
                self._settle()

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making an exchange fail, since the last call."""
        noticed, self._noticed = self._noticed, set()
        if self._notices is not None:
            noticed |= self._notices.take_noticed()
        return noticed

    def forget_noticed(self) -> None:
        """Forget what came before the device was asked for the first time; that is no fault."""
        self._noticed.clear()

    def tell(self, message: bytes) -> None:
        """Send what has no reply; may be called in the loop.

        Raises:
            LineFault: If it did not go out, or a reply is still owed.
        """
        self._settle()
        self._line.send(message)

    def ask(
        self,
        request: bytes,
        length_of: LengthOf,
        is_reply: Fits | None = None,
        timeout_ns: int | None = None,
        fits: Fits | None = None,
    ) -> bytes:
        """Send a request and return the frame that answers it; may be called in the loop.

        Args:
            request: What is sent.
            length_of: Finds frames.
            is_reply: Tells whether a frame answers this very request, and no earlier one; None
                where frames do not tell.
            timeout_ns: How long to wait, if not as long as usual.
            fits: Where frames carry no tag, and `length_of` finds those of other kinds too: tells
                whether a frame is of the kind of this reply, an error among them. Others are
                garbage, and the reply is still owed.

        Raises:
            LineFault: `LATE_REPLY` if none came in time, or whatever the line raises.
        """
        if self._owed is not None or self._rest:
            self._settle()
        line = self._line
        if stale := line.receive(0):
            self._drop(stale)
        line.send(request)
        belongs = is_reply or fits
        begin_ns = line.now_ns()
        wait_ns = self._timeout_ns if timeout_ns is None else timeout_ns
        end_ns = begin_ns + wait_ns
        got, left_ns = b"", wait_ns
        while left_ns > 0:
            got += line.receive(left_ns)
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
                self._noticed.add(DeviceFlag.OUT_OF_ORDER if is_reply else DeviceFlag.GARBAGE)
            if len(got) > MOST_BYTES:
                got = b""
                self._noticed.add(DeviceFlag.GARBAGE)
            left_ns = end_ns - line.now_ns()
        if got:
            self._noticed.add(DeviceFlag.GARBAGE)
        self._rest = got
        if is_reply is None:
            self._owed, self._owed_fits = length_of, fits
            self._owed_until_ns = end_ns + PATIENCE * wait_ns
        raise LineFault(DeviceFlag.LATE_REPLY, f"no reply within {wait_ns / 1e6:g} ms")

    def _settle(self) -> None:
        """Get rid of what belongs to earlier requests.

        Raises:
            LineFault: If a reply may still come that would be taken for another.
        """
        if self._owed is None:
            self._drop(self._rest)
            self._rest = b""
            return
        now_ns = self._line.now_ns()  # before what it is compared with: a reply may come any time
        got = self._rest + self._line.receive(0)
        self._rest = got[-MOST_BYTES:]
        while (length := self._owed(self._rest)) and not self._pays(length):
            self._rest = self._rest[abs(length) :]
        if length == 0 and now_ns < self._owed_until_ns:
            raise _StillOwedError(DeviceFlag.LATE_REPLY, "a late reply may still come")
        self._noticed.add(DeviceFlag.LATE_REPLY)
        self._rest, self._owed = b"", None

    def _pays(self, length: int) -> bool:
        fits = self._owed_fits
        if length > 0 and (fits is None or fits(self._rest[:length])):
            return True
        self._noticed.add(DeviceFlag.GARBAGE)
        return False

    def _drop(self, stale: bytes) -> None:
        if stale:
            self._noticed.add(DeviceFlag.OUT_OF_ORDER)
