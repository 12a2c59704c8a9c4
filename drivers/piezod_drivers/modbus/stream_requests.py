"""The requests to a LabJack during a play: one exchange each."""

from collections.abc import Sequence
from struct import Struct, pack
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.modbus.codec import FEEDBACK, ModbusRequest
from piezod_drivers.modbus.profiles.labjack_stream import DIO_STATE, ENABLE
from piezod_drivers.modbus.stream_setup import StreamSetup, dio_word

_PART: Final = Struct(">BHB")
"""Header of a part of a request: 0 to read or 1 to write, address, number of registers."""
_ECHO: Final = bytes((FEEDBACK,))


class StreamRequests:
    """Asks for the stream and the outputs. Real-time safe.

    Args:
        setup: Sends the requests.
        outputs: Address of each output.
    """

    def __init__(self, setup: StreamSetup, outputs: Sequence[int]) -> None:
        self._setup, self._addresses, n = setup, outputs, len(outputs)
        values = b"".join(_PART.pack(0, address, 2) for address in outputs)
        poll = _PART.pack(0, ENABLE, 2) + values
        self._poll = ModbusRequest(_ECHO + poll, _ECHO, 5 + 4 * n)
        self._read = ModbusRequest(_ECHO + values, _ECHO, 1 + 4 * n)
        self.pulse(0)
        self._unpack_poll, self._unpack = Struct(f">BI{n}f").unpack, Struct(f">B{n}f").unpack

    def pulse(self, mask: int) -> None:
        """Make a stop also set the digital outputs of a mask low; 0 for none."""
        low = _PART.pack(1, DIO_STATE, 1) + pack(">H", dio_word(0, mask)) if mask else b""
        values = b"".join(_PART.pack(0, address, 2) for address in self._addresses)
        stop = _PART.pack(1, ENABLE, 2) + bytes(4)
        self._stop = ModbusRequest(_ECHO + stop + low + values, _ECHO, self._read.n_bytes)

    def poll(self) -> tuple[bool, Sequence[float]]:
        """Return whether the stream is running, and the outputs, in V.

        Raises:
            LineFault: If there is no reply.
        """
        _, is_on, *outputs = self._unpack_poll(self._setup.ask(self._poll))
        return bool(is_on), outputs

    def stop(self) -> Sequence[float]:
        """Stop the stream and return the outputs, in V. A second exchange if it has ended already.

        Raises:
            LineFault: If there is no reply.
        """
        try:
            reply = self._setup.ask(self._stop)
        except LineFault as fault:
            if fault.flag is not DeviceFlag.DEVICE_FAILURE:
                raise
            reply = self._setup.ask(self._read)  # error 2620: no stream is running
        return self._unpack(reply)[1:]
