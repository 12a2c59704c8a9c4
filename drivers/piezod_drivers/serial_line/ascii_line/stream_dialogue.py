"""Listening to a sensor that sends lines of text unasked."""

import re
from collections.abc import Sequence
from math import nan
from typing import Final

from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line, LineFault, NoticingLine
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod_drivers.serial_line.ascii_line.codec import (
    AsciiLines,
    exchange,
    flagging,
    matched,
    number,
)
from piezod_drivers.serial_line.ascii_line.options import AsciiOptions

UNKNOWN: Final = "unknown"
MOST_READS: Final = 4
"""If the line has still more after so many reads, more comes than can be read."""
MOST_BYTES: Final = 4096
"""Only the newest lines matter: of what has come, no more than this is looked at."""

_NEVER: Final[Reading] = (0, ())


class AsciiStreamDialogue:
    """Implements `Dialogue` for a device that is only listened to.

    A sample is the newest line; where none has come since the last call, the same again with the
    same instant. The first bytes after opening belong to a line that began before, and are dropped.

    Args:
        line: The line, not open.
        options: What a configuration says, which fits together.
        wiring: Which channels are used.
        pattern: What a line must be.
    """

    def __init__(
        self, line: Line, options: AsciiOptions, wiring: Wiring, pattern: re.Pattern[str]
    ) -> None:
        self._line, self._options, self._wiring, self._pattern = line, options, wiring, pattern
        self._lines = AsciiLines(options)
        self._errors = flagging(options.errors)
        self._timeout_ns = round(options.timeout_ms * 1e6)
        self._rest = b""
        self._last = _NEVER
        self._noticed: set[DeviceFlag] = set()

    def open(self) -> Identity:
        """Connect and wait for a line.

        Raises:
            LineFault: `LATE_REPLY` if none comes.
        """
        self._line.open()
        self._noticed.clear()
        self._rest, synchronous = b"", False
        end_ns = self._line.now_ns() + 2 * self._timeout_ns
        while (left_ns := end_ns - self._line.now_ns()) > 0:
            self._rest += self._line.receive(left_ns)
            lines = self._complete()
            if (synchronous and lines) or len(lines) > 1:
                return Identity(UNKNOWN, f"device at {self._line.where}", UNKNOWN, UNKNOWN)
            synchronous |= bool(lines)
        what = f"nothing comes from {self._line.where}"
        raise LineFault(DeviceFlag.LATE_REPLY, what)

    def close(self) -> None:
        """Let go of the line."""
        self._line.close()

    def capabilities(self) -> Capabilities:
        """Tell what the options say."""
        return Capabilities(self._wiring.inputs, (), False, self._options.max_rate_hz)

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Tell that it has no outputs."""
        return ()

    def activate(self) -> None:
        """Send what comes at the start, and wait for a line.

        Raises:
            LineFault: `LATE_REPLY` if none comes; what an error means.
        """
        for each in self._options.start:
            self._line.send(self._lines.request(exchange(each).places, {}))
        self._last = _NEVER
        end_ns = self._line.now_ns() + self._timeout_ns
        while not self._last[1] and (left_ns := end_ns - self._line.now_ns()) > 0:
            self._rest += self._line.receive(left_ns)
            self._take(self._line.now_ns())
        if not self._last[1]:
            raise LineFault(DeviceFlag.LATE_REPLY, f"nothing comes from {self._line.where}")

    def deactivate(self) -> None:
        """Send what comes at the end."""
        for each in self._options.stop:
            self._line.send(self._lines.request(exchange(each).places, {}))

    def sample(self, now_ns: int) -> Reading:
        """Return what the newest line tells, with the instant of the call that found it.

        Raises:
            LineFault: `LATE_REPLY` if none has come for the time-out; what an error means.
        """
        self._listen()
        self._take(now_ns)
        t_ns, values = self._last
        if now_ns - t_ns > self._timeout_ns:
            raise LineFault(DeviceFlag.LATE_REPLY, "no line has come")
        return min(t_ns, now_ns), values

    def put(self, values: Sequence[float]) -> None:
        """Do nothing: there are no outputs."""

    def in_force(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - the interface's
        """Tell nothing: there are no outputs."""
        return ()

    def flags(self) -> Sequence[Flags]:
        """Tell nothing of what lasts."""
        return [NO_FLAGS] * len(self._wiring.inputs)

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what was wrong with lines, and with the line itself."""
        noticed, self._noticed = self._noticed, set()
        if isinstance(self._line, NoticingLine):
            noticed |= self._line.take_noticed()
        return noticed

    def _take(self, now_ns: int) -> None:
        """Take the newest line that is none of garbage; call it in the loop.

        After an error nothing is valid until another line comes.

        Raises:
            LineFault: If that line is an error.
        """
        lines = self._complete()
        while lines:
            try:
                found = matched(self._lines.text(lines.pop()), self._pattern, self._errors)
                values = [number(found[name]) for name in self._wiring.inputs]
            except LineFault as fault:
                if fault.flag is not DeviceFlag.GARBAGE:
                    self._last = now_ns, [nan] * len(self._wiring.inputs)
                    raise
                self._noticed.add(fault.flag)
            else:
                self._last = now_ns, values
                return

    def _listen(self) -> None:
        for _ in range(MOST_READS):
            got = self._line.receive(0)
            if not got:
                return
            self._rest = (self._rest + got)[-MOST_BYTES:]
        self._noticed.add(DeviceFlag.BUS_OVERLOADED)

    def _complete(self) -> list[bytes]:
        """Take the complete lines out of what has come; the rest stays."""
        lines = []
        while length := self._lines.length(self._rest):
            if length > 0:
                lines.append(self._rest[:length])
            else:
                self._noticed.add(DeviceFlag.GARBAGE)
            self._rest = self._rest[abs(length) :]
        return lines
