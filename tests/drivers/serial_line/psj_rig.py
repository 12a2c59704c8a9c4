"""An amplifier of piezosystem jena with its emulator at the other end of a line of a test."""

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.psj.dialogue import PsjDialogue
from piezod_drivers.serial_line.psj.emulator import PsjEmulator
from piezod_drivers.serial_line.psj.profiles import PROFILES, ProfileName, ReadingUse
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import EmulatedLine, TestTime

RANGE_V = (-20.0, 130.0)
ALL: list[ProfileName] = ["ddrive", "30dv", "nv40", "nv40-1", "nv200"]


class Rig:
    """A device, its emulator, and the line between them."""

    def __init__(
        self,
        profile: ProfileName,
        reads: ReadingUse | None = None,
        wiring: Wiring | None = None,
        *,
        remote: bool = True,
    ) -> None:
        psj_profile = PROFILES[profile]
        psj_profile = psj_profile._replace(reads=reads or psj_profile.reads)
        self.time = TestTime()
        self.bench, self.rig, _ = bench(psj_profile.channels, self.time)
        self.emulator = PsjEmulator(profile, self.bench, "4711")
        self.emulator.reads = "position" if psj_profile.reads == "nothing" else psj_profile.reads
        self.line = EmulatedLine(self.emulator, self.time)
        inputs = ("ch0",) if psj_profile.reads == "position" else ()
        wanted = wiring or Wiring(inputs, ("ch0",))
        dialogue = PsjDialogue(self.line, psj_profile, wanted, RANGE_V, 0.05, remote=remote)
        self.device = BusDevice("psj", dialogue)

    def send(self, text: bytes) -> None:
        """Send a command as the user of the device would."""
        self.emulator.receive(text)

    def started(self) -> BusDevice:
        """Return the device, open and active."""
        self.device.open()
        self.device.activate(self.now_ns())
        self.line.sent.clear()
        return self.device

    def now_ns(self) -> int:
        return self.time.t_ns

    def flags(self) -> frozenset[DeviceFlag]:
        """Return the flags of its last channel."""
        return self.device.status(self.now_ns())[-1]
