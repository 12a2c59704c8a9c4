"""A CAN bus behind a serial slcan adapter; python-can's own driver reads byte by byte."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Final

from piezod.devices.bus.conversation import BOOT_NS
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
"""Longest time that an adapter may take to acknowledge a command."""
_QUIET_NS: Final = 50_000_000
"""After a silence of this length the adapter has sent all that was pending."""
# A bus that nothing reads must not fill the memory.
_MOST_FRAMES: Final = 4096
# CR alone for a command; `z` or `Z` before it for a frame, by some adapters.
_ACKNOWLEDGEMENTS: Final = frozenset({b"", b"z", b"Z"})


class SlcanBus:
    """Implements `FrameBus` over a line to an slcan adapter.

    `open` closes the adapter's channel first. This resets its CAN controller, so frames of an
    earlier connection are gone before the channel opens again. An adapter may boot when its port is
    opened: the commands of `open` are repeated until it acknowledges them, or for `BOOT_NS`. The
    echo of a sent frame is not taken for a frame of the bus.

    Args:
        bit_rate: Bit rate of the CAN bus in bit/s, a key of `slcan_codec.BIT_RATES`.
    """

    def __init__(self, line: Line, bit_rate: int) -> None:
        self._line, self._bit_rate = line, bit_rate
        self.now_ns: Callable[[], int] = line.now_ns
        """Returns the instant on the line's clock. Real-time safe."""
        self._notices = line if isinstance(line, NoticingLine) else None
        self._lines = SlcanLines()
        self._frames: deque[Frame] = deque(maxlen=_MOST_FRAMES)
        self._noticed: set[DeviceFlag] = set()
        self._refused, self._refusals = False, 0
        self._echoes = self._says_other = False
        self._unechoed: deque[bytes] = deque(maxlen=_MOST_FRAMES)

    @property
    def where(self) -> str:
        """Path of the adapter's port."""
        return self._line.where

    def open(self, accepted: Iterable[int]) -> None:  # noqa: ARG002 - adapters filter by masks only
        """Connect to the adapter, empty its queue, set the bit rate and open the channel.

        Raises:
            DeviceUnavailableError: If the adapter is absent or refuses a command.
        """
        self._line.open()
        try:
            end_ns = self._line.now_ns() + BOOT_NS
            # Some adapters acknowledge nothing, others do not yet hear anything.
            while not self._configure() and self._line.now_ns() < end_ns:
                continue
        except LineFault as fault:
            self.close()
            raise DeviceUnavailableError(f"{self.where}: {fault}") from fault
        except DeviceUnavailableError:
            self.close()
            raise
        self._frames.clear()
        self._unechoed.clear()
        self._noticed.clear()
        self._refused, self._refusals = False, 0

    def close(self) -> None:
        """Close the channel, which empties the adapter's queue, and release the port; waits."""
        with suppress(LineFault):  # the adapter was unplugged, or never opened
            self._close_channel(CLOSE, _QUIET_NS)
        self._line.close()

    def send(self, frame: Frame) -> None:
        """Pass a frame to the adapter. Real-time safe.

        The adapter reports a full queue only after the frame; then the next frame is not sent.

        Raises:
            LineFault: `NOT_SENT` if the adapter refused an earlier frame, `BUS_OFF` if it refused
                several in a row, `DISCONNECTED` if it was unplugged.
        """
        if self._refusals >= STALLED_AFTER:
            what = f"{self.where}: the adapter has refused {self._refusals} frames in a row"
            raise LineFault(DeviceFlag.BUS_OFF, what)
        if self._refused:
            self._refused = False
            raise LineFault(DeviceFlag.NOT_SENT, f"{self.where}: the adapter's queue is full")
        line = encode(frame)
        try:
            self._line.send(line)
        except LineFault as fault:
            # The adapter refuses half a command together with the next one: neither is sent.
            if fault.flag is DeviceFlag.PARTIAL_WRITE:
                self._noticed.add(fault.flag)
                raise LineFault(DeviceFlag.NOT_SENT, str(fault)) from fault
            raise
        if self._echoes:
            self._unechoed.append(line[:-1])

    def receive(self, within_ns: int) -> Frame | None:
        """Return the next frame, None if none came in time. Real-time safe.

        Raises:
            LineFault: `DISCONNECTED` if the adapter was unplugged.
        """
        frames = self._frames
        if frames:
            return frames.popleft()
        line, left_ns = self._line, within_ns
        end_ns = self.now_ns() + within_ns if within_ns else 0
        while True:
            data = line.receive(left_ns)
            if data:
                self._parse(data)
                if frames:
                    return frames.popleft()
            if not within_ns:
                return None
            left_ns = end_ns - self.now_ns()
            if left_ns <= 0:
                return None

    def mark_stalled(self) -> None:
        """Do nothing: `open` empties the adapter's queue in any case."""

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the flags of faults that no call has raised. Real-time safe."""
        noticed, self._noticed = self._noticed, set()
        if self._notices is not None:
            noticed |= self._notices.take_noticed()
        return noticed

    def _parse(self, data: bytes) -> None:
        for text in self._lines.feed(data):
            if text in _ACKNOWLEDGEMENTS:
                self._refusals = 0
            elif self._unechoed and text == self._unechoed[0]:
                self._unechoed.popleft()
            elif (frame := decode(text)) is not None:
                self._frames.append(frame)
            elif text == BEL:
                self._refused = True
                self._refusals += 1
            else:
                self._noticed.add(DeviceFlag.GARBAGE)

    def _configure(self) -> bool:
        """Set the bit rate and open the channel; return whether the adapter surely did so."""
        # The first CR ends an incomplete command that an earlier program may have left.
        self._close_channel(b"\r" + CLOSE, _ANSWER_NS)
        self._echoes = self._says_other = False
        bit_rate = f"a bit rate of {self._bit_rate} bit/s"
        acknowledged = self._command(BIT_RATES[self._bit_rate], bit_rate)
        acknowledged &= self._command(OPEN, "to open its channel")
        # What an adapter says after booting may begin with an empty line, like an acknowledgement.
        end_ns = self._line.now_ns() + _QUIET_NS
        while acknowledged and (left_ns := end_ns - self._line.now_ns()) > 0:
            for line in self._lines.feed(self._line.receive(left_ns)):
                self._look_at(line)
        return acknowledged and not self._says_other

    def _close_channel(self, command: bytes, within_ns: int) -> None:
        """Close the channel and wait until the adapter is silent.

        A port that is released earlier would drop the command. The acknowledgement cannot be
        recognized: those of earlier frames may still come, and look the same.
        """
        line = self._line
        line.send(command)
        end_ns = line.now_ns() + _ANSWER_NS
        while line.receive(within_ns) and line.now_ns() < end_ns:
            within_ns = _QUIET_NS
        # The rest of a line belongs to the closed channel.
        self._lines.clear()

    def _command(self, command: bytes, what: str) -> bool:
        """Send a command; return whether it was acknowledged.

        Some adapters acknowledge none, all refuse an impossible one.
        """
        self._line.send(command)
        end_ns = self._line.now_ns() + _ANSWER_NS
        while (left_ns := end_ns - self._line.now_ns()) > 0:
            lines = self._lines.feed(self._line.receive(left_ns))
            if BEL in lines:
                raise DeviceUnavailableError(f"{self.where}: the adapter refuses {what}")
            for line in lines:
                self._look_at(line, command[:-1])
            if b"" in lines:
                return True
        return False

    def _look_at(self, line: bytes, command: bytes = b"") -> None:
        """Note whether the adapter echoes a command, or says what is no answer and no frame."""
        if line and line == command:
            self._echoes = True
        elif line not in _ACKNOWLEDGEMENTS and decode(line) is None:
            self._says_other = True
