"""Requests and replies in CAN frames; a stale frame is never taken for a reply."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.frame_bus import FrameBus

MAX_FRAMES: Final = 64
"""Highest number of frames that one call reads."""
STALLED_AFTER: Final = 3
"""After this many frames in a row that could not be sent, the bus counts as stalled."""
LATE_TIMEOUTS: Final = 10
"""A reply counts as lost when it is late by this many time-outs."""
SLOW_FRACTION: Final = 0.8
"""A reply is reported as slow if it takes more than this fraction of the time-out."""


def _any_frame(_frame: Frame) -> bool:
    return True


class CanConversation:
    """Sends the frames of a cycle and waits for the replies.

    Before anything is sent, all pending frames are read: only the latest count, and a reply among
    them answers no request. Frames do not tell which request they answer. Therefore, after a
    time-out, no request is sent until the overdue replies have come or count as lost,
    `LATE_TIMEOUTS` time-outs later.

    Args:
        bus: The bus; its owner opens and closes it.
        timeout_ns: Longest wait for replies, in ns.
        own: Identifiers that only this end sends.
        take: Called with each frame that is not a reply.
    """

    def __init__(
        self,
        bus: FrameBus,
        timeout_ns: int,
        own: Iterable[int],
        take: Callable[[Frame], None],
    ) -> None:
        self._bus, self._timeout_ns, self._on_unrequested = bus, timeout_ns, take
        self._now_ns, self._slow_ns = bus.now_ns, round(SLOW_FRACTION * timeout_ns)
        self._own_ids = frozenset(own)
        self._refused = 0
        self._overdue: set[int] = set()
        self._overdue_until_ns = 0
        self._noticed: set[DeviceFlag] = set()

    def restart(self, own: Iterable[int]) -> None:
        """Forget all earlier exchanges; call it whenever the bus was opened.

        Args:
            own: Identifiers that only this end sends from now on.
        """
        self._own_ids = frozenset(own)
        self._refused = 0
        self._overdue.clear()
        self._noticed.clear()

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the flags of faults that no call has raised. Real-time safe."""
        noticed = self._bus.take_noticed()
        if self._noticed:
            noticed = noticed | self._noticed
            self._noticed.clear()
        return noticed

    def tell(self, frame: Frame) -> None:
        """Send a frame. Real-time safe.

        Raises:
            LineFault: `NOT_SENT` if the queue is full, `BUS_OFF` after `STALLED_AFTER` such frames
                in a row, or any fault of the bus.
        """
        try:
            self._bus.send(frame)
        except LineFault as fault:
            if fault.flag is not DeviceFlag.NOT_SENT:
                raise
            self._refused += 1
            if self._refused < STALLED_AFTER:
                raise
            # An old setpoint must not be sent later: the next `open` empties the queue.
            self._bus.mark_stalled()
            what = f"{self._bus.where}: {STALLED_AFTER} frames in a row could not be sent"
            raise LineFault(DeviceFlag.BUS_OFF, what) from fault
        self._refused = 0

    def read_pending(self, answers: Iterable[int] = ()) -> None:
        """Read all pending frames. Real-time safe.

        Args:
            answers: Identifiers of replies, which the device sends only on request.

        Raises:
            LineFault: `BUS_OVERLOADED` if there are more than `MAX_FRAMES`, or any fault of the
                bus.
        """
        bus = self._bus
        for _ in range(MAX_FRAMES):
            # The limit bounds the time that a flooded bus can take from a cycle.
            frame = bus.receive(0)
            if frame is None:
                return
            # A remote frame with this identifier is a request of another host, not the overdue
            # reply.
            if frame.id in self._overdue and not frame.remote:
                self._overdue.discard(frame.id)
                self._noticed.add(DeviceFlag.LATE_REPLY)
            elif frame.id in answers:
                self._noticed.add(DeviceFlag.OUT_OF_ORDER)
            else:
                self._deliver(frame)
        raise self._overloaded()

    def ask(
        self,
        frames: Sequence[Frame],
        answers: frozenset[int],
        check: Callable[[Frame], bool] = _any_frame,
        *,
        tagged: bool = False,
    ) -> Mapping[int, bytes]:
        """Send frames and wait for the replies. Real-time safe.

        Args:
            frames: The frames in the order in which they are sent; the last one is the request.
            answers: Identifiers of the replies, one frame of each.
            check: Returns whether a frame with such an identifier is a reply; may raise
                `LineFault`.
            tagged: Whether `check` distinguishes a reply to this request from replies to earlier
                ones.

        Returns:
            The data of each reply by its identifier.

        Raises:
            LineFault: `LATE_REPLY` if a reply is missing, `BUS_OVERLOADED`, or as `tell` and
                `check`.
        """
        self.read_pending(answers)
        # Pending frames first: a reply that is already there cannot be one to this request.
        begin_ns = self._now_ns()
        if self._overdue:
            if begin_ns < self._overdue_until_ns:
                raise LineFault(DeviceFlag.LATE_REPLY, "a late reply may still come")
            self._overdue.clear()
        for frame in frames:
            self.tell(frame)
        missing = set(answers)
        try:
            return self._wait_for_replies(begin_ns, answers, missing, check)
        except LineFault:
            # A tagged reply that comes late is recognized and dropped, so nothing has to be waited
            # for.
            if not tagged:
                self._overdue |= missing
                self._overdue_until_ns = self._now_ns() + LATE_TIMEOUTS * self._timeout_ns
            raise

    def _wait_for_replies(
        self,
        begin_ns: int,
        answers: frozenset[int],
        missing: set[int],
        check: Callable[[Frame], bool],
    ) -> Mapping[int, bytes]:
        bus, left_ns = self._bus, self._timeout_ns
        got: dict[int, bytes] = {}
        for _ in range(MAX_FRAMES):
            frame = bus.receive(left_ns)
            # Read after each frame, so that other traffic on the bus does not prolong the wait.
            took_ns = self._now_ns() - begin_ns
            if frame is not None:
                identifier = frame.id
                if identifier not in answers:
                    self._deliver(frame)
                # A second frame of this identifier, or one that `check` rejects, answers an earlier
                # request.
                elif identifier in missing and self._is_expected(frame, missing, check):
                    missing.discard(identifier)
                    got[identifier] = frame.data
                    if not missing:
                        if took_ns > self._slow_ns:
                            self._noticed.add(DeviceFlag.SLOW_REPLY)
                        return got
                else:
                    self._noticed.add(DeviceFlag.OUT_OF_ORDER)
            left_ns = self._timeout_ns - took_ns
            if left_ns <= 0:
                within = f"within {self._timeout_ns / 1e6:g} ms"
                what = f"no reply from {bus.where} {within}"
                raise LineFault(DeviceFlag.LATE_REPLY, what)
        raise self._overloaded()

    @staticmethod
    def _is_expected(frame: Frame, missing: set[int], check: Callable[[Frame], bool]) -> bool:
        try:
            return check(frame)
        except LineFault:
            missing.discard(frame.id)  # it has come, so it is not overdue
            raise

    def _overloaded(self) -> LineFault:
        what = f"{self._bus.where}: more than {MAX_FRAMES} frames in a cycle"
        return LineFault(DeviceFlag.BUS_OVERLOADED, what)

    def _deliver(self, frame: Frame) -> None:
        if frame.id in self._own_ids:
            # Another program commands the device.
            self._noticed.add(DeviceFlag.FOREIGN_FRAME)
        else:
            self._on_unrequested(frame)
