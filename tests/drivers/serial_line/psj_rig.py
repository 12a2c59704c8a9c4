"""An amplifier of piezosystem jena with its emulator at the other end of a line of a test."""

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.psj.dialogue import PsjDialogue
from piezod_drivers.serial_line.psj.emulator import PsjEmulator
from piezod_drivers.serial_line.psj.profiles import MODELS, Profile, Reads
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import EmulatedLine, TestTime

RANGE_V = (-20.0, 130.0)
ALL: list[Profile] = ["ddrive", "30dv", "nv40", "nv40-1", "nv200"]


class Rig:
    """A device, the emulator that it talks to, and all between them."""

    def __init__(
        self,
        profile: Profile,
        reads: Reads | None = None,
        wiring: Wiring | None = None,
        *,
        remote: bool = True,
    ) -> None:
        model = MODELS[profile]
        model = model._replace(reads=reads or model.reads)
        self.time = TestTime()
        self.bench, self.rig, _ = bench(model.channels, self.time)
        self.emulator = PsjEmulator(profile, self.bench, "4711")
        self.emulator.reads = "position" if model.reads == "nothing" else model.reads
        self.line = EmulatedLine(self.emulator, self.time)
        inputs = ("ch0",) if model.reads == "position" else ()
        wanted = wiring or Wiring(inputs, ("ch0",))
        dialogue = PsjDialogue(self.line, model, wanted, RANGE_V, 0.05, remote=remote)
        self.device = BusDevice("psj", dialogue)

    def send(self, text: bytes) -> None:
        """Do at the device what a user would do."""
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
        """Return what its last channel says."""
        return self.device.status(self.now_ns())[-1]
