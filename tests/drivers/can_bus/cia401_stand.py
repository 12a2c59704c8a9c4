"""The driver `canopen` with an emulated node on a fake bus, in virtual time."""

from collections.abc import Callable, Sequence
from typing import Any

from piezod.devices.bus.bus_device import BusDevice, ExchangingBusDevice
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.cia401.dialogue import Cia401Dialogue
from piezod_drivers.can_bus.cia401.emulation.sdo_server import AbortCode, AbortError
from piezod_drivers.can_bus.cia401.emulator import Cia401Node
from piezod_drivers.can_bus.cia401.options import Cia401Options
from tests.drivers.can_bus.fake_bus import FakeBus
from tests.drivers.can_bus.profiles import CODES, canopen
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import MS


class Stand:
    """An emulated node, the fake bus it is on, and the rig behind it.

    Attributes:
        device: The driver's device with all channels.
    """

    def __init__(self, start_v: Sequence[float] = (0.0, 0.0), **more: object) -> None:
        on_bench, self.rig, self.time = bench(2)
        on_bench.drive_all(start_v)
        self.node = Cia401Node(on_bench)
        self.bus = FakeBus(self.node, self.time)
        two = {f"a{i}": {"number": i, **CODES} for i in (1, 2)}
        options = canopen("/dev/null", 5.0, **{"inputs": two, "outputs": two, **more})
        self.options = Cia401Options.model_validate(options)
        self.device = self.make(Wiring(tuple(self.options.inputs), tuple(self.options.outputs)))

    def make(self, wiring: Wiring) -> Any:
        """Construct a device with some channels."""
        kind = ExchangingBusDevice if all(wiring) else BusDevice
        return kind("the node", Cia401Dialogue(self.options, wiring, self.bus))

    def active(self, wiring: Wiring | None = None) -> Any:
        """Return a device that is open and active."""
        device = self.device if wiring is None else self.make(wiring)
        device.open()
        device.activate(self.time.t_ns)
        return device

    def passes(self, ms: float, each: Callable[[], object] = lambda: None) -> None:
        """Let time pass and call a function every 5 ms."""
        for _ in range(round(ms / 5)):
            self.time.t_ns += 5 * MS
            each()

    def flags(self) -> frozenset[DeviceFlag]:
        """Return the flags of all channels."""
        return frozenset().union(*self.device.status(self.time.t_ns))


def read(device: Any, stand: Stand) -> list[float]:
    """Read all inputs of a device."""
    return [sample.position_um for sample in device.read(stand.time.t_ns)]


def without(stand: Stand, missing: set[int]) -> None:
    """Remove these objects from a node."""
    entry = stand.node.entry

    def some(index: int, number: int) -> Any:
        if index in missing:
            raise AbortError(AbortCode.NO_OBJECT)
        return entry(index, number)

    stand.node.entry = some  # type: ignore[method-assign] # a node that lacks something
