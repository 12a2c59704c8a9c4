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


class CubePort(SerialLine):
    """A serial port whose RTS goes on and off after opening, which makes the cube listen."""

    def open(self) -> None:
        """Open the port, wake the cube and forget what it has said before: takes 0.1 s.

        Raises:
            DeviceUnavailableError: If it is absent, held by somebody else, or no serial port.
        """
        super().open()
        assert self._serial is not None  # noqa: S101 - it was opened
        with suppress(OSError):  # a pty has no RTS
            wake(self._serial, time.sleep)


def wake(port: Serial, sleep: Callable[[float], None]) -> None:
    """Switch RTS on and off, and drop what comes in between.

    Args:
        port: The open port.
        sleep: Waits so long, in s.

    Raises:
        OSError: If the port has no RTS.
    """
    port.rts = True
    sleep(_PULSE_S)
    port.reset_input_buffer()
    port.rts = False
    sleep(_PULSE_S)
