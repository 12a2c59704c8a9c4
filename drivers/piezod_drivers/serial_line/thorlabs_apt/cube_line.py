"""The USB serial port of a Thorlabs cube."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from piezod.devices.bus.serial_line import SerialLine

if TYPE_CHECKING:
    from collections.abc import Callable

    from serial import Serial

_PULSE_S: Final = 0.05


class CubeLine(SerialLine):
    """A serial port that wakes the cube after opening, by a pulse of RTS."""

    def open(self) -> None:
        """Open the port, wake the cube and discard pending bytes; takes 0.1 s.

        Raises:
            DeviceUnavailableError: If the port is absent, locked, or no serial port.
        """
        super().open()
        assert self._serial is not None  # noqa: S101 - `open` has set it
        with suppress(OSError):  # a pty has no RTS
            wake_cube(self._serial, time.sleep)


def wake_cube(port: Serial, sleep: Callable[[float], None]) -> None:
    """Switch RTS on and off, and discard the bytes that come in between.

    Args:
        port: The open port.
        sleep: Waits for a time in s.

    Raises:
        OSError: If the port has no RTS.
    """
    port.rts = True
    sleep(_PULSE_S)
    port.reset_input_buffer()
    port.rts = False
    sleep(_PULSE_S)
