"""A client of an emulated LabJack, for its stream."""

from struct import pack, unpack_from

from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod_drivers.modbus import emulator
from piezod_drivers.modbus.emulation.labjack import LabJackServer
from piezod_drivers.modbus.stream_codec import Packet, take_packet
from tests.drivers.serial_line.linear_rig import LinearRig, bench
from tests.drivers.serial_line.scripted_line import TestTime

AIN0, DAC0, OUT0 = 0, 1000, 4800


class Client:
    """A client of an emulated LabJack, without the driver.

    Args:
        plugin: The device.
    """

    def __init__(self, plugin: EmulatorPlugin = emulator.LABJACK_T7) -> None:
        self.rig: LinearRig
        self.time: TestTime
        table, self.rig, self.time = bench(2)
        assert plugin.create is not None
        server = plugin.create(table, "")
        assert isinstance(server, LabJackServer)
        self.server = server

    def ask(self, pdu: bytes) -> bytes:
        """Return the reply to a request, without its header."""
        (reply,) = self.server.receive(pack(">HHHB", 1, 0, len(pdu) + 1, 1) + pdu)
        return reply[7:]

    def write(self, address: int, *numbers: float, kind: str = "I") -> int:
        """Write numbers; return the device's error, 0 if there is none."""
        words = pack(f">{len(numbers)}{kind}", *numbers)
        head = pack(">BHHB", 16, address, len(words) // 2, len(words))
        reply = self.ask(head + words)
        return 0 if reply[0] == 16 else int.from_bytes(self.ask(b"\3\xd6\xd8\0\1")[2:], "big")

    def read(self, address: int, kind: str = "I") -> float:
        """Return a number."""
        reply = self.ask(pack(">BHH", 3, address, 2))
        assert reply[0] == 3, f"exception {reply[1]}"
        return float(unpack_from(f">{kind}", reply, 2)[0])

    def load(self, values: list[float], n_looped: int, n_bytes: int = 1024) -> None:
        """Give the first stream-out its values."""
        for address, number in ((4090, 0), (4040, DAC0), (4050, n_bytes), (4090, 1)):
            assert self.write(address, number) == 0
        assert self.write(4060, n_looped) == 0
        assert self.write(4400, *values, kind="f") == 0
        assert self.write(4070, 1) == 0

    def stream(
        self, *channels: int, rate_hz: float = 1000.0, scans: int = 0, packet: int = 1
    ) -> int:
        """Start a stream; return the error."""
        assert self.write(4002, rate_hz, kind="f") == 0
        for address, number in (
            (4004, len(channels)),
            (4006, packet),
            (4016, 1),
            (4018, 0),
            (4020, scans),
        ):
            assert self.write(address, number) == 0
        assert self.write(4100, *channels) == 0
        return self.write(4990, 1)

    def wait(self, for_ns: int) -> None:
        """Let time pass."""
        self.time.t_ns += for_ns
        self.server.due()

    def packets(self) -> list[Packet]:
        """Take every packet that is waiting."""
        found, data = [], b""
        while waiting := self.server.stream_waiting():
            data += waiting
            self.server.stream_sent(len(waiting))
        while data:
            packet, data = take_packet(data)
            assert packet is not None
            found.append(packet)
        return found

    def played_v(self) -> list[float]:
        """Return all voltages that the first output has had, in V."""
        return [round(each[0] / 30, 3) for each in self.rig.driven_v]
