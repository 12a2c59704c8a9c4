"""The second port of an emulated LabJack, in virtual time."""

from piezod.devices.bus.line import LineFault
from piezod.devices.emulation.emulator import Streams
from piezod.devices.status import DeviceFlag
from tests.drivers.serial_line.scripted_line import TestTime


class StreamLine:
    """Implements `Line` to the stream of an emulated device.

    Args:
        emulator: The device.
        time: Clock of the device's rig.

    Attributes:
        room: Number of bytes that can be received at all; None for any number.
        unplugged: Whether the connection is lost.
    """

    where = "the stream of this test"

    def __init__(self, emulator: Streams, time: TestTime) -> None:
        self._emulator, self._time = emulator, time
        self.room: int | None = None
        self.opened = self.unplugged = False

    def open(self) -> None:
        self.opened = True
        self._emulator.stream_connected()

    def close(self) -> None:
        self.opened = False

    def send(self, data: bytes) -> None:
        raise AssertionError(f"{data!r} was sent to the stream")

    def receive(self, within_ns: int) -> bytes:
        assert within_ns == 0, "waited in the loop"
        if self.unplugged or not self.opened:
            raise LineFault(DeviceFlag.DISCONNECTED, f"{self.where} is gone")
        got = b""
        while waiting := self._emulator.stream_waiting()[: self.room]:
            got += waiting
            self._emulator.stream_sent(len(waiting))
            if self.room is not None:
                self.room -= len(waiting)
        return got

    def now_ns(self) -> int:
        return self._time.t_ns
