"""Requests and replies over a line, one at a time; a late reply is never taken for the next one."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Final, TypeAlias

from piezod.devices.bus.byte_trace import shown
from piezod.devices.bus.line import Line, LineFault, NoticingLine
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError

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

BOOT_NS: Final = 3_000_000_000
"""Longest time after a request without a reply that a device may need to boot, in ns. A board whose
serial port resets it is silent for up to 2 s, in its boot loader."""
_QUIET_NS: Final = 100_000_000
"""After a silence of this length a device that boots has sent what it sends by itself."""
MOST_KEPT: Final = 200
"""Number of dropped bytes that are kept for a message."""


class _StillOwedError(LineFault):
    """Raised if no request may be sent, because a late reply may still come."""


class _OneThread:
    """Lets one thread at a time use a line; entered by a second one, it raises. Real-time safe."""

    def __init__(self, line: Line) -> None:
        self._line, self._free = line, threading.Lock()
        self._user = 0

    def __enter__(self) -> None:
        if not self._free.acquire(blocking=False):  # never waits
            names = {thread.ident: thread.name for thread in threading.enumerate()}
            raise DeviceError(
                f"{self._line.where}: thread {names.get(threading.get_ident())} uses the line "
                f"while thread {names.get(self._user)} waits for a reply, allowed: one thread at a "
                "time; this is a mistake of the program: report it, with the log"
            )
        self._user = threading.get_ident()

    def __exit__(self, *_: object) -> None:
        self._free.release()


class Conversation:
    """Sends requests and waits for replies, with a deadline.

    If replies carry a tag of their request, `is_reply` identifies them, and a late reply is dropped
    on arrival. If they do not, no request is sent after a time-out until the late reply has come,
    or can no longer come: `PATIENCE` time-outs later. A frame that cannot be that reply, for
    example an unsolicited warning of the device, does not end this waiting.

    One thread at a time has a conversation; a second one gets a `DeviceError`, and sends nothing.

    Some devices boot when their port is opened: they answer nothing meanwhile, and then send a
    banner. Therefore the first request of `with opening():` is repeated, with the port open,
    until it is answered or `BOOT_NS` have passed; what comes in between is dropped.

    Args:
        line: The line; its owner opens and closes it.
        timeout_s: Time-out of a reply, in s.
    """

    def __init__(self, line: Line, timeout_s: float) -> None:
        self._line, self._timeout_ns = line, round(timeout_s * 1e9)
        self._one_thread = _OneThread(line)
        self._notices = line if isinstance(line, NoticingLine) else None
        self._rest = b""  # received after the last frame
        # State after a time-out: how to recognise the owed reply, and when it counts as lost.
        self._owed: LengthOf | None = None
        self._owed_fits: Fits | None = None
        self._owed_until_ns = 0
        self._owed_why = ""
        self._noticed: set[DeviceFlag] = set()
        self._may_boot = False
        self.dropped = b""
        """Bytes that came during the last exchange, or before it, and were no reply."""

    def restart(self) -> None:
        """Start anew; call it whenever the line was opened.

        A late reply stays owed: a device on a serial port does not notice that the port was opened
        again, and may still answer.
        """
        self._rest = b""
        self._noticed.clear()

    @contextmanager
    def opening(self) -> Iterator[None]:
        """Repeat the first request of this block as long as the device may boot.

        Not for use in the loop: the request may take `BOOT_NS` and ten time-outs longer.
        """
        self._may_boot = True
        try:
            yield
        finally:
            self._may_boot = False

    def wait_out(self) -> None:
        """Wait until a late reply comes or can no longer come. Not for use in the loop.

        This is for opening: a device may leave a request unanswered that it does not know.

        Raises:
            LineFault: As raised by the line.
        """
        with self._one_thread:
            while self._owed is not None:
                left_ns = self._owed_until_ns - self._line.now_ns()
                if left_ns > 0:  # the wait also ends when bytes arrive
                    self._rest += self._line.receive(left_ns)
                with suppress(_StillOwedError):
                    self._drop_earlier()

    def give_up(self) -> None:
        """Take a late reply for lost: the caller has made sure that it can no longer come."""
        self._rest, self._owed = b"", None

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
        with self._one_thread:
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
        """Send a request and return the frame that answers it. Real-time safe after opening.

        Args:
            request: Bytes to send.
            length_of: Finds frames.
            is_reply: Returns whether a frame answers this very request; None without a tag.
            timeout_ns: Time-out in ns, if it differs from the default.
            fits: For frames without a tag: returns whether a frame has the type of this reply or is
                an error reply. Other frames are garbage, and the reply stays owed.

        Raises:
            LineFault: `LATE_REPLY` if no reply came in time, with the bytes that came instead; or
                as raised by the line.
            DeviceError: If another thread is waiting for a reply.
        """
        with self._one_thread:
            again = partial(self._ask, request, length_of, is_reply, timeout_ns, fits)
            if not self._may_boot:
                return again()
            self._may_boot = False
            return self._ask_booting(again, timeout_ns or self._timeout_ns)

    def _ask(
        self,
        request: bytes,
        length_of: LengthOf,
        is_reply: Fits | None,
        timeout_ns: int | None,
        fits: Fits | None,
    ) -> bytes:
        self.dropped = b""
        if self._owed is not None or self._rest:
            self._drop_earlier()
        # Bytes that came before the request cannot be its reply.
        if stale := self._line.receive(0):
            self._note_dropped(stale)
        self._line.send(request)
        wait_ns = self._timeout_ns if timeout_ns is None else timeout_ns
        end_ns = self._line.now_ns() + wait_ns
        # With a tag a frame that does not fit is the reply to an earlier request; without one it is
        # unsolicited.
        stray = DeviceFlag.OUT_OF_ORDER if is_reply else DeviceFlag.GARBAGE
        frame = self._wait_for(length_of, is_reply or fits, stray, wait_ns)
        if frame is not None:
            return frame
        if self._rest:
            self._note_garbage(self._rest)
        # A late reply without a tag could be taken for the next one, so it has to be waited for.
        if is_reply is None:
            self._owed, self._owed_fits = length_of, fits
            self._owed_until_ns = end_ns + PATIENCE * wait_ns
        what = f"no reply within {wait_ns / 1e6:g} ms"
        if self.dropped:
            what += f": what came does not fit: {shown(self.dropped)}"
        self._owed_why = what
        raise LineFault(DeviceFlag.LATE_REPLY, what)

    def _ask_booting(self, again: Callable[[], bytes], wait_ns: int) -> bytes:
        """Repeat a request while it is not answered and the device may still boot.

        Args:
            again: Sends the request and returns its reply.
            wait_ns: Time-out of the reply, in ns.
        """
        repeated, end_ns = False, self._line.now_ns() + wait_ns + BOOT_NS
        while True:
            try:
                frame = again()
                break
            except LineFault as fault:
                if fault.flag is not DeviceFlag.LATE_REPLY or self._line.now_ns() >= end_ns:
                    raise
            repeated = True
            # A tag need not differ between repetitions, so a late reply is waited for in any case.
            late_ns = self._line.now_ns() + PATIENCE * wait_ns
            self._drop_until_quiet(late_ns, max(late_ns, end_ns))
        if repeated:
            # The device may have kept the earlier requests, and answers them now.
            now_ns = self._line.now_ns()
            self._drop_until_quiet(now_ns, now_ns + BOOT_NS, spoke=True)
            self._noticed.clear()
        return frame

    def _drop_until_quiet(self, from_ns: int, end_ns: int, *, spoke: bool = False) -> None:
        """Drop what comes, until the device has sent something and fallen silent.

        Args:
            from_ns: Earliest end.
            end_ns: Latest end, also if the device sends nothing or never falls silent.
            spoke: Whether it has sent something already.
        """
        while (now_ns := self._line.now_ns()) < end_ns:
            until_ns = max(from_ns, now_ns + _QUIET_NS) if spoke else end_ns
            if not self._line.receive(until_ns - now_ns):
                break
            spoke = True
        self.give_up()

    def _wait_for(
        self, length_of: LengthOf, belongs: Fits | None, stray: DeviceFlag, wait_ns: int
    ) -> bytes | None:
        """Return the first frame that belongs to the request, None if none comes in time.

        Args:
            length_of: Finds frames.
            belongs: Returns whether a frame is the reply; None if every frame is.
            stray: Flag of any other frame.
            wait_ns: Longest wait, in ns.
        """
        line = self._line
        begin_ns = line.now_ns()
        got, left_ns = b"", wait_ns
        while left_ns > 0:
            got += line.receive(left_ns)
            # One delivery may hold a part of a frame, or several frames with garbage in between.
            while length := length_of(got):
                piece, got = got[: abs(length)], got[abs(length) :]
                if length < 0:
                    self._note_garbage(piece)
                elif belongs is None or belongs(piece):
                    self._rest = got
                    if line.now_ns() - begin_ns > SLOW * wait_ns:
                        self._noticed.add(DeviceFlag.SLOW_REPLY)
                    return piece
                else:
                    self._noticed.add(stray)
                    self._keep_dropped(piece)
            if len(got) > MOST_BYTES:
                self._note_garbage(got)
                got = b""
            left_ns = begin_ns + wait_ns - line.now_ns()
        self._rest = got
        return None

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
            what = f"{self._owed_why}; a late reply may still come"
            raise _StillOwedError(DeviceFlag.LATE_REPLY, what)
        self._noticed.add(DeviceFlag.LATE_REPLY)
        self.give_up()

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
            self._keep_dropped(stale)

    def _note_garbage(self, garbage: bytes) -> None:
        self._noticed.add(DeviceFlag.GARBAGE)
        self._keep_dropped(garbage)

    def _keep_dropped(self, piece: bytes) -> None:
        if len(self.dropped) < MOST_KEPT:
            self.dropped = (self.dropped + piece)[:MOST_KEPT]
