"""The USB serial port of a Thorlabs cube."""

import time
from contextlib import suppress
from typing import Final

from piezod.devices.bus.serial_line import SerialLine

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
            self._serial.rts = True
            time.sleep(_PULSE_S)
            self._serial.reset_input_buffer()
            self._serial.rts = False
            time.sleep(_PULSE_S)
