"""Two TCP ports as the device end: requests at the first one, a stream from the second one."""

from typing import Final

from piezod.devices.emulation.emulator import Streams
from piezod.devices.emulation.tcp_end import TcpEnd
from piezod.errors import DeviceUnavailableError

_ATTEMPTS: Final = 50
"""Ports that are tried if any will do; the second one of a free port may be taken."""


class TwoPortEnd(TcpEnd):
    """A `TcpEnd` with a second port, which only sends.

    Args:
        host: Address to listen at.
        port: Number of the first port; 0 for any.
        distance: Number of the second port minus that of the first one.
    """

    def __init__(self, host: str, port: int, distance: int) -> None:
        super().__init__(host, port)
        self._any_port, self._distance = port == 0, distance
        self._second = TcpEnd(host, port + distance)

    def appear(self) -> None:
        """Listen at both; after the first time always at the same ports.

        Raises:
            DeviceUnavailableError: If a port is taken, or the address does not exist.
        """
        for attempt in range(_ATTEMPTS if self._any_port else 1):
            super().appear()
            self._second = TcpEnd(self._host, self._port + self._distance)
            try:
                self._second.appear()
            except DeviceUnavailableError:
                super().vanish()
                if not self._any_port or attempt == _ATTEMPTS - 1:
                    raise
                self._port = 0
            else:
                self._any_port = False
                return

    def vanish(self) -> None:
        """Close all connections and stop listening."""
        super().vanish()
        self._second.vanish()

    def pass_on(self, device: Streams) -> None:
        """Send the waiting bytes of the device's stream, as many as there is room for."""
        self._second.receive(0)  # accepts clients; a device reads nothing here
        if self._second.take_connected():
            device.stream_connected()
        while data := device.stream_waiting():
            n_sent = self._second.send_some(data)
            device.stream_sent(n_sent)
            if n_sent < len(data):
                return
