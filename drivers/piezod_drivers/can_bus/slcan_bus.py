"""A CAN bus behind a serial adapter that speaks slcan; python-can's own reads byte by byte."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Final

from piezod.devices.bus.line import Line, LineFault, NoticingLine
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError
from piezod_drivers.can_bus.conversation import STALLED_AFTER
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.slcan_codec import (
    BEL,
    BIT_RATES,
    CLOSE,
    OPEN,
    SlcanLines,
    decode,
    encode,
)

_ANSWER_NS: Final = 500_000_000
"""How long an adapter may take to acknowledge a command."""
_QUIET_NS: Final = 50_000_000
"""After so long without a byte it has said all it had to say."""
_MOST_FRAMES: Final = 4096
_ACKNOWLEDGEMENTS: Final = frozenset({b"", b"z", b"Z"})


class SlcanBus:
    """Implements `FrameBus` over a line to an adapter.

    Opening closes the adapter's channel before anything else, which resets its controller: what an
    earlier connection has left in its queue is gone before the channel opens again.

    Args:
        line: To the adapter.
        bit_rate: Of the CAN bus, in bit/s, one of `slcan.BIT_RATES`.
    """

    def __init__(self, line: Line, bit_rate: int) -> None:
        self._line, self._bit_rate = line, bit_rate
        self.now_ns: Callable[[], int] = line.now_ns
        """Tells the instant on the line's clock; may be called in the loop."""
        self._notices = line if isinstance(line, NoticingLine) else None
        self._lines = SlcanLines()
        self._frames: deque[Frame] = deque(maxlen=_MOST_FRAMES)
        self._noticed: set[DeviceFlag] = set()
        self._refused, self._refusals = False, 0

    @property
    def where(self) -> str:
        """The adapter's port."""
        return self._line.where

    def open(self, accepted: Iterable[int]) -> None:  # noqa: ARG002 - adapters filter by masks only
        """Connect to the adapter, empty its queue, set the bit rate and open the channel.

        Raises:
            DeviceUnavailableError: If it is absent, or refuses.
        """
        self._line.open()
        try:
            # The first CR ends what an earlier program may have left half said.
            self._close_channel(b"\r" + CLOSE, _ANSWER_NS)
            self._command(BIT_RATES[self._bit_rate], f"a bit rate of {self._bit_rate} bit/s")
            self._command(OPEN, "to open its channel")
        except LineFault as fault:
            self.close()
            raise DeviceUnavailableError(f"{self.where}: {fault}") from fault
        except DeviceUnavailableError:
            self.close()
            raise
        self._frames.clear()
        self._noticed.clear()
        self._refused, self._refusals = False, 0

    def close(self) -> None:
        """Close the channel, which empties the adapter's queue, and let go of the port; waits."""
        with suppress(LineFault):  # it is gone, or was never there
            self._close_channel(CLOSE, _QUIET_NS)
        self._line.close()

    def send(self, frame: Frame) -> None:
        """Pass a frame to the adapter; may be called in the loop.

        That the adapter had no room for it is told only later: the next frame is not sent then.

        Raises:
            LineFault: `NOT_SENT` if the adapter has refused a frame before, `BUS_OFF` if it has
                refused several in a row, `DISCONNECTED` if it is gone.
        """
        if self._refusals >= STALLED_AFTER:
            what = f"{self.where}: the adapter has refused {self._refusals} frames in a row"
            raise LineFault(DeviceFlag.BUS_OFF, what)
        if self._refused:
            self._refused = False
            raise LineFault(DeviceFlag.NOT_SENT, f"{self.where}: the adapter's queue is full")
        try:
            self._line.send(encode(frame))
        except LineFault as fault:
            if fault.flag is DeviceFlag.PARTIAL_WRITE:
                self._noticed.add(fault.flag)
                raise LineFault(DeviceFlag.NOT_SENT, str(fault)) from fault
            raise

    def receive(self, within_ns: int) -> Frame | None:
        """Return the next frame; may be called in the loop.

        Raises:
            LineFault: `DISCONNECTED` if the adapter is gone.
        """
        frames = self._frames
        if frames:
            return frames.popleft()
        line, left_ns = self._line, within_ns
        end_ns = self.now_ns() + within_ns if within_ns else 0
        while True:
            data = line.receive(left_ns)
            if data:
                self._take(data)
                if frames:
                    return frames.popleft()
            if not within_ns:
                return None
            left_ns = end_ns - self.now_ns()
            if left_ns <= 0:
                return None

    def stalled(self) -> None:
        """Be told that frames do not leave; `open` empties the adapter's queue anyway."""

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making a call fail, since the last call."""
        noticed, self._noticed = self._noticed, set()
        if self._notices is not None:
            noticed |= self._notices.take_noticed()
        return noticed

    def _take(self, data: bytes) -> None:
        for said in self._lines.feed(data):
            if said in _ACKNOWLEDGEMENTS:
                self._refusals = 0
            elif (frame := decode(said)) is not None:
                self._frames.append(frame)
            elif said == BEL:
                self._refused = True
                self._refusals += 1
            else:
                self._noticed.add(DeviceFlag.GARBAGE)

    def _close_channel(self, command: bytes, within_ns: int) -> None:
        """Have the channel closed, and wait until the adapter has said all it had to say.

        Who lets go of the port before drops the command. No answer can be told to be the one to it:
        there may be more to come of frames.
        """
        line = self._line
        line.send(command)
        end_ns = line.now_ns() + _ANSWER_NS
        while line.receive(within_ns) and line.now_ns() < end_ns:
            within_ns = _QUIET_NS
        self._lines.clear()

    def _command(self, command: bytes, what: str) -> None:
        """Give a command; some adapters acknowledge none, all refuse what they cannot do."""
        self._line.send(command)
        end_ns = self._line.now_ns() + _ANSWER_NS
        while (left_ns := end_ns - self._line.now_ns()) > 0:
            for answer in self._lines.feed(self._line.receive(left_ns)):
                if answer == BEL:
                    raise DeviceUnavailableError(f"{self.where}: the adapter refuses {what}")
                if answer == b"":
                    return
