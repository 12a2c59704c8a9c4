"""A CANopen node with analogue inputs and outputs as a device."""

from typing import Final

from piezod.devices.bus.bus_device import BusDevice, ExchangingBusDevice
from piezod.devices.interface import DriverPlugin, Wiring
from piezod_drivers.can_bus.cia401.dialogue import Dialogue
from piezod_drivers.can_bus.cia401.options import Options, channels
from piezod_drivers.can_bus.options import make_bus


def create(options: Options, wiring: Wiring, _seed: int) -> BusDevice:
    """Construct the device; nothing is opened."""
    name = f"CANopen node {options.node}"
    dialogue = Dialogue(options, wiring, make_bus(options.bus))
    if wiring.inputs and wiring.outputs:
        return ExchangingBusDevice(name, dialogue)
    return BusDevice(name, dialogue)


PLUGIN: Final = DriverPlugin(
    name="canopen",
    summary="analogue inputs and outputs on a CAN bus, by CANopen's profile CiA 401",
    options_model=Options,
    create=create,
    confirmed_on_hardware=False,
    channels=channels,
    sees=frozenset(
        {f"B{number}" for number in (1, 2, 3, 5, 6, 7, 8, 9, 10, 11, 12, 14)}
        | {"A1", "A3", "A4", "A7", "A8", "A9", "A11", "A12", "A13", "S7", "S10"}
    ),
)
