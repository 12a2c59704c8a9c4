"""Requests and replies in the frames of Modbus TCP."""

from collections.abc import Sequence
from struct import Struct
from typing import Final

from piezod.devices.bus.line import Line, LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.modbus.codec import ModbusRequest, check_reply
from piezod_drivers.modbus.transactions import LineTransactions

# The header: number of the request, protocol (always 0), bytes that follow, unit.
_HEADER: Final = Struct(">HHHB")
_HEAD: Final = Struct(">HHH")
_LENGTHS: Final = range(3, 255)


class TcpTransactions(LineTransactions):
    """Modbus TCP: each request has a number of its own, which the reply repeats.

    Therefore no reply is taken for another one, however late it is. A reply with the right number
    and a wrong header or length is refused. The data itself is protected by TCP's checksum only.

    Args:
        timeout_s: Longest wait for a reply, in s.
    """

    def __init__(self, line: Line, timeout_s: float) -> None:
        super().__init__(line, timeout_s)
        self._number, self._tag = 0, b""
        self._other_number: int | None = None

    def ask(self, unit: int, requests: Sequence[ModbusRequest], first: int = 0) -> bytes:
        """Send one request and return its reply. Real-time safe.

        Raises:
            LineFault: If there is no reply in time, or the device refuses.
        """
        request = requests[first]
        self._number = number = (self._number + 1) & 0xFFFF
        # The length counts the unit and the request.
        frame = _HEADER.pack(number, 0, len(request.pdu) + 1, unit) + request.pdu
        self._tag = frame[:2]
        self._other_number = None
        try:
            reply = self._conversation.ask(frame, _length_tcp, self._is_reply)
        except LineFault as fault:
            if self._other_number is None:
                raise
            what = f"{fault}; the request had transaction number {number}, a reply had "
            what += f"{self._other_number}: a device or gateway that does not repeat the number is "
            raise LineFault(
                fault.flag, what + "not supported, a late reply would be unnoticed"
            ) from fault
        if reply[6] != unit:
            what = f"unit {reply[6]} replied instead of {self.name_of(unit)}"
            raise LineFault(DeviceFlag.GARBAGE, what)
        pdu = reply[7:]
        if len(pdu) == request.n_bytes and pdu.startswith(request.echo):
            return pdu
        return check_reply(pdu, request, self.name_of(unit))

    def settle(self) -> None:
        """Do nothing: a late reply is recognized by its number."""

    def is_free(self, unit: int, requests: Sequence[ModbusRequest]) -> bool:  # noqa: ARG002 - of RTU
        """Return True: a late reply is recognized by its number. Real-time safe."""
        return True

    def _is_reply(self, frame: bytes) -> bool:
        if frame.startswith(self._tag):
            return True
        self._other_number = int.from_bytes(frame[:2], "big")
        return False


def _length_tcp(got: bytes) -> int:
    # Look for the first header; the bytes before it are garbage.
    for start in range(len(got) - 5):
        _, protocol, length = _HEAD.unpack_from(got, start)
        if protocol == 0 and length in _LENGTHS:
            if start:
                return -start
            return length + 6 if len(got) >= length + 6 else 0
    # No header: drop all but the last five bytes, which may be the start of one.
    return min(5 - len(got), 0)
