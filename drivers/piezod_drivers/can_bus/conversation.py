"""One exchange of frames in a cycle of the loop; nothing stale is ever taken for an answer."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.frame_bus import FrameBus

MOST_FRAMES: Final = 64
"""More frames than these are not read in one go."""
STALLED_AFTER: Final = 3
"""So many frames in a row that cannot be sent: the bus does not take any."""
PATIENCE: Final = 10
"""An answer is taken for lost when it has been late for so many time-outs."""
SLOW: Final = 0.8
"""An answer that takes more than this part of its time is slow."""


def _is_answer(_frame: Frame) -> bool:
    return True


class CanCycle:
    """Sends what a cycle sends, and waits for the frames that answer it.

    Before anything is sent, all that has come is read: the latest counts, and an answer among it
    was asked for by nobody. Frames do not tell which request they answer. So after a time-out
    nothing is asked until the answers that are owed have come, or can no longer come: `PATIENCE`
    time-outs later.

    Args:
        bus: The bus, opened and closed by whoever owns the cycle.
        timeout_ns: How long to wait for answers.
        own: Identifiers that nobody but this end sends.
        take: Told each other frame that is no answer.
    """

    def __init__(
        self,
        bus: FrameBus,
        timeout_ns: int,
        own: Iterable[int],
        take: Callable[[Frame], None],
    ) -> None:
        self._bus, self._timeout_ns, self._take = bus, timeout_ns, take
        self._now_ns, self._slow_ns = bus.now_ns, round(SLOW * timeout_ns)
        self._own = frozenset(own)
        self._refused = 0
        self._owed: set[int] = set()
        self._owed_until_ns = 0
        self._noticed: set[DeviceFlag] = set()

    def restart(self) -> None:
        """Forget what was before; to be called whenever the bus was opened."""
        self._refused = 0
        self._owed.clear()
        self._noticed.clear()

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making an exchange fail, since the last call."""
        noticed = self._bus.take_noticed()
        if self._noticed:
            noticed = noticed | self._noticed
            self._noticed.clear()
        return noticed

    def tell(self, frame: Frame) -> None:
        """Send a frame; may be called in the loop.

        Raises:
            LineFault: `NOT_SENT` if there is no room for it; `BUS_OFF` when that is so again and
                again; or whatever else the bus raises.
        """
        try:
            self._bus.send(frame)
        except LineFault as fault:
            if fault.flag is not DeviceFlag.NOT_SENT:
                raise
            self._refused += 1
            if self._refused < STALLED_AFTER:
                raise
            self._bus.stalled()
            what = f"{self._bus.where}: {STALLED_AFTER} frames in a row could not be sent"
            raise LineFault(DeviceFlag.BUS_OFF, what) from fault
        self._refused = 0

    def catch_up(self, answers: Iterable[int] = ()) -> None:
        """Read all that has come; may be called in the loop.

        Args:
            answers: Identifiers that nobody sends unasked.

        Raises:
            LineFault: `BUS_OVERLOADED` if it does not end, or whatever the bus raises.
        """
        bus = self._bus
        for _ in range(MOST_FRAMES):
            frame = bus.receive(0)
            if frame is None:
                return
            if frame.id in self._owed and not frame.remote:
                self._owed.discard(frame.id)
                self._noticed.add(DeviceFlag.LATE_REPLY)
            elif frame.id in answers:
                self._noticed.add(DeviceFlag.OUT_OF_ORDER)
            else:
                self._pass_on(frame)
        raise self._overloaded()

    def ask(
        self,
        frames: Sequence[Frame],
        answers: frozenset[int],
        check: Callable[[Frame], bool] = _is_answer,
        *,
        tagged: bool = False,
    ) -> Mapping[int, bytes]:
        """Send frames and wait for those that answer; may be called in the loop.

        Args:
            frames: What is sent, in this order, the last of which is answered.
            answers: Identifiers of the frames that answer, each once.
            check: Tells whether a frame of such an identifier answers; may raise `LineFault`.
            tagged: Whether `check` tells an answer to these very frames from one to earlier ones.

        Returns:
            The data of each answer by its identifier.

        Raises:
            LineFault: `LATE_REPLY` if not all came in time, `BUS_OVERLOADED`, or as `tell` or
                `check`.
        """
        self.catch_up(answers)
        begin_ns = self._now_ns()
        if self._owed:
            if begin_ns < self._owed_until_ns:
                raise LineFault(DeviceFlag.LATE_REPLY, "a late answer may still come")
            self._owed.clear()
        for frame in frames:
            self.tell(frame)
        missing = set(answers)
        try:
            return self._await(begin_ns, answers, missing, check)
        except LineFault:
            if not tagged:
                self._owed |= missing
                self._owed_until_ns = self._now_ns() + PATIENCE * self._timeout_ns
            raise

    def _await(
        self,
        begin_ns: int,
        answers: frozenset[int],
        missing: set[int],
        check: Callable[[Frame], bool],
    ) -> Mapping[int, bytes]:
        bus, left_ns = self._bus, self._timeout_ns
        got: dict[int, bytes] = {}
        for _ in range(MOST_FRAMES):
            frame = bus.receive(left_ns)
            took_ns = self._now_ns() - begin_ns
            if frame is not None:
                identifier = frame.id
                if identifier not in answers:
                    self._pass_on(frame)
                elif identifier in missing and self._answers(frame, missing, check):
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
                what = f"no answer from {bus.where} {within}"
                raise LineFault(DeviceFlag.LATE_REPLY, what)
        raise self._overloaded()

    @staticmethod
    def _answers(frame: Frame, missing: set[int], check: Callable[[Frame], bool]) -> bool:
        try:
            return check(frame)
        except LineFault:
            missing.discard(frame.id)  # it has come, whatever is wrong with it
            raise

    def _overloaded(self) -> LineFault:
        what = f"{self._bus.where}: more than {MOST_FRAMES} frames in a cycle"
        return LineFault(DeviceFlag.BUS_OVERLOADED, what)

    def _pass_on(self, frame: Frame) -> None:
        if frame.id in self._own:
            self._noticed.add(DeviceFlag.FOREIGN_FRAME)
        else:
            self._take(frame)
