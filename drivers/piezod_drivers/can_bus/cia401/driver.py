"""The driver `canopen`: nodes with analogue inputs and outputs on a CAN bus."""

from typing import Final

from piezod.config.faults import Fault
from piezod.devices.bus.bus_device import BusDevice, ExchangingBusDevice
from piezod.devices.interface import DriverPlugin, Wiring
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
    sees=frozenset(
        {
            Fault.B1,
            Fault.B2,
            Fault.B3,
            Fault.B5,
            Fault.B6,
            Fault.B7,
            Fault.B8,
            Fault.B9,
            Fault.B10,
            Fault.B11,
            Fault.B12,
            Fault.B14,
            Fault.A1,
            Fault.A3,
            Fault.A4,
            Fault.A7,
            Fault.A8,
            Fault.A9,
            Fault.A11,
            Fault.A12,
            Fault.A13,
            Fault.S7,
            Fault.S10,
        }
    ),
)
