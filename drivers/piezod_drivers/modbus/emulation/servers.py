"""Emulated devices behind the frames of Modbus TCP and of Modbus RTU."""

from collections.abc import Callable, Mapping
from struct import Struct
from typing import Final

from piezod.devices.emulation.emulator import Emulator
from piezod_drivers.modbus.checksum import checksum, has_valid_checksum
from piezod_drivers.modbus.emulation.unit import EmulatedUnit

_HEADER: Final = Struct(">HHHB")
_MOST: Final = 512
_QUIET_NS: Final = 20_000_000
"""A frame on a serial line ends after a silence of this length; an emulator is not exact."""


class TcpServer:
    """Implements `Emulator`: one device, which replies under any unit address.

    Args:
        on_request: Called with True for each request, and with False by `due`.
    """

    def __init__(
        self, unit: EmulatedUnit, on_request: Callable[[bool], None] = lambda _asked: None
    ) -> None:
        self._unit, self._on_request, self._got = unit, on_request, b""

    def connected(self) -> None:
        """Discard bytes of an earlier connection."""
        self._got = b""

    def receive(self, data: bytes) -> list[bytes]:
        """Reply to every complete request; bytes that are no header are dropped."""
        self._got += data
        replies = []
        while len(self._got) >= _HEADER.size:
            number, protocol, length, unit = _HEADER.unpack_from(self._got)
            # The next frame cannot be found, so everything is dropped.
            if protocol != 0 or not 2 <= length <= _MOST:
                self._got = b""
                break
            if len(self._got) < length + 6:
                break
            pdu, self._got = self._got[_HEADER.size : length + 6], self._got[length + 6 :]
            self._on_request(True)
            answer = self._unit.answer(pdu)
            replies.append(_HEADER.pack(number, 0, len(answer) + 1, unit) + answer)
        return replies

    def due(self) -> list[bytes]:
        """Send nothing; let time pass for the watchdog."""
        self._on_request(False)
        return []


class RtuServer(Emulator):
    """Implements `Emulator`: the devices of one serial line.

    Args:
        units: Each device by its address.
        now_ns: The clock.
    """

    def __init__(self, units: Mapping[int, EmulatedUnit], now_ns: Callable[[], int]) -> None:
        self._units, self._now_ns = units, now_ns
        self._got, self._until_ns = b"", 0

    def receive(self, data: bytes) -> list[bytes]:
        """Reply to each complete request to one of the devices, unless it is damaged."""
        now_ns = self._now_ns()
        if now_ns > self._until_ns:
            self._got = b""
        self._until_ns = now_ns + _QUIET_NS
        self._got = (self._got + data)[-_MOST:]
        replies = []
        while size := _size(self._got):
            frame, self._got = self._got[:size], self._got[size:]
            # The length itself may be damaged, so the rest cannot be split into frames.
            if not has_valid_checksum(frame):
                self._got = b""
                break
            unit = self._units.get(frame[0])
            if unit is not None:
                answer = frame[:1] + unit.answer(frame[1:-2])
                replies.append(answer + checksum(answer))
        return replies


def _size(got: bytes) -> int:
    """Return the length of the request that has come, 0 if it is incomplete."""
    if len(got) < 8:
        return 0
    # Functions with a byte count have data behind it: 15 and 16 at byte 6, 23 at byte 10.
    size = 8
    if got[1] in {15, 16}:
        size = 9 + got[6]
    elif got[1] == 23:
        size = 13 + got[10] if len(got) > 10 else len(got) + 1
    return size if len(got) >= size else 0
