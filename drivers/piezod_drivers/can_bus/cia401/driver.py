"""The driver `canopen`: nodes with analogue inputs and outputs on a CAN bus."""

from typing import Final

from piezod.devices.bus.bus_device import BusDevice, ExchangingBusDevice
from piezod.devices.interface import DriverPlugin, Wiring, faults
from piezod_drivers.can_bus.cia401.dialogue import Cia401Dialogue
from piezod_drivers.can_bus.cia401.options import Cia401Options, channels
from piezod_drivers.can_bus.options import make_bus


def create(options: Cia401Options, wiring: Wiring, _seed: int) -> BusDevice:
    """Construct the device; nothing is opened."""
    name = f"CANopen node {options.node}"
    dialogue = Cia401Dialogue(options, wiring, make_bus(options.bus))
    if wiring.inputs and wiring.outputs:
        return ExchangingBusDevice(name, dialogue)
    return BusDevice(name, dialogue)


PLUGIN: Final = DriverPlugin(
    name="canopen",
    summary="CANopen nodes with analogue inputs and outputs, device profile CiA 401",
    options_model=Cia401Options,
    create=create,
    confirmed_on_hardware=False,
    channels=channels,
    sees=faults("A1 A3 A4 A7 A8 A9 A11 A12 A13 B1 B2 B3 B5 B6 B7 B8 B9 B10 B11 B12 B14 S7 S10"),
)
