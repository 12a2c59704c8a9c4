"""The conversation with a sensor that sends lines of text by itself."""

import re
from math import nan
from typing import Final

from piezod.devices.bus.base_dialogue import BaseDialogue
from piezod.devices.bus.conversation import BOOT_NS
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line, LineFault, NoticingLine
from piezod.devices.interface import UNKNOWN, Capabilities, Identity, Wiring
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.ascii_line.codec import (
    AsciiLines,
    compiled_exchange,
    compiled_flags,
    match_reply,
    number,
)
from piezod_drivers.serial_line.ascii_line.options import AsciiOptions

MOST_READS: Final = 4
"""If more bytes come after this number of reads, the line is overloaded."""
MOST_BYTES: Final = 4096
"""Only the newest lines matter: at most this number of bytes is searched."""

_NO_READING: Final[Reading] = (0, ())


class AsciiStreamDialogue(BaseDialogue):
    """Implements `Dialogue` for a device that is only read.

    A sample is the newest line. If none has come since the last call, it is the same sample with
    the same instant. The first bytes after opening belong to a line that began earlier, and are
    dropped.

    Args:
        line: The line, not open.
        options: Valid options.
        pattern: Pattern of a line.
    """

    def __init__(
        self, line: Line, options: AsciiOptions, wiring: Wiring, pattern: re.Pattern[str]
    ) -> None:
        super().__init__(wiring, line, line if isinstance(line, NoticingLine) else None)
        self._line, self._options, self._pattern = line, options, pattern
        self._lines = AsciiLines(options)
        self._errors = compiled_flags(options.errors)
        self._timeout_ns = round(options.timeout_ms * 1e6)
        self._rest = b""
        self._newest = _NO_READING

    def open(self) -> Identity:
        """Connect and wait for a line.

        Raises:
            LineFault: `LATE_REPLY` if none comes.
        """
        self._line.open()
        self._noticed.clear()
        self._rest, synchronous = b"", False
        # Twice the time-out: the first line is incomplete, so two have to come. Before them the
        # device may boot.
        end_ns = self._line.now_ns() + BOOT_NS + 2 * self._timeout_ns
        while (left_ns := end_ns - self._line.now_ns()) > 0:
            self._rest += self._line.receive(left_ns)
            lines = self._complete_lines()
            # The first line is complete only from its second terminator on: its beginning may be
            # missing.
            if (synchronous and lines) or len(lines) > 1:
                return Identity(UNKNOWN, f"device at {self._line.where}", UNKNOWN, UNKNOWN)
            synchronous |= bool(lines)
        what = f"no line from {self._line.where}"
        raise LineFault(DeviceFlag.LATE_REPLY, what)

    def capabilities(self) -> Capabilities:
        """Return the capabilities of the options."""
        return Capabilities(self._wiring.inputs, (), False, self._options.max_rate_hz)

    def activate(self) -> None:
        """Send the commands of `start`, and wait for a line.

        Raises:
            LineFault: `LATE_REPLY` if none comes; the fault of an error line.
        """
        for ask in self._options.start:
            self._line.send(self._lines.request(compiled_exchange(ask).places, {}))
        self._newest = _NO_READING
        end_ns = self._line.now_ns() + self._timeout_ns
        while not self._newest[1] and (left_ns := end_ns - self._line.now_ns()) > 0:
            self._rest += self._line.receive(left_ns)
            self._use_newest(self._line.now_ns())
        if not self._newest[1]:
            raise LineFault(DeviceFlag.LATE_REPLY, f"no line from {self._line.where}")

    def deactivate(self) -> None:
        """Send the commands of `stop`."""
        for ask in self._options.stop:
            self._line.send(self._lines.request(compiled_exchange(ask).places, {}))

    def sample(self, now_ns: int) -> Reading:
        """Return the values of the newest line, with the instant it was found. Real-time safe.

        Raises:
            LineFault: `LATE_REPLY` if none has come for the time-out; the fault of an error line.
        """
        self._read_pending()
        self._use_newest(now_ns)
        t_ns, values = self._newest
        if now_ns - t_ns > self._timeout_ns:
            raise LineFault(DeviceFlag.LATE_REPLY, "no line within the time-out")
        # `activate` dates a line by the line's clock, which may be slightly ahead of the caller's
        # instant.
        return min(t_ns, now_ns), values

    def _use_newest(self, now_ns: int) -> None:
        """Use the newest line that is not garbage. Real-time safe.

        After an error line samples are invalid until another line comes.

        Raises:
            LineFault: If the newest line is an error.
        """
        lines = self._complete_lines()
        # From the newest line backwards.
        while lines:
            try:
                found = match_reply(self._lines.text(lines.pop()), self._pattern, self._errors)
                values = [number(found[name]) for name in self._wiring.inputs]
            except LineFault as fault:
                if fault.flag is not DeviceFlag.GARBAGE:
                    self._newest = now_ns, [nan] * len(self._wiring.inputs)
                    raise
                self._noticed.add(fault.flag)
            else:
                self._newest = now_ns, values
                return

    def _read_pending(self) -> None:
        for _ in range(MOST_READS):
            got = self._line.receive(0)
            if not got:
                return
            self._rest = (self._rest + got)[-MOST_BYTES:]
        self._noticed.add(DeviceFlag.BUS_OVERLOADED)

    def _complete_lines(self) -> list[bytes]:
        """Remove the complete lines from the pending bytes and return them."""
        lines = []
        while length := self._lines.length(self._rest):
            if length > 0:
                lines.append(self._rest[:length])
            else:
                self._noticed.add(DeviceFlag.GARBAGE)
            self._rest = self._rest[abs(length) :]
        return lines
