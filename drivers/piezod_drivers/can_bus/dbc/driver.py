"""The driver `can_dbc`: a device on a CAN bus whose frames a DBC file describes."""

from typing import Final

from piezod.devices.bus.bus_device import BusDevice, ExchangingBusDevice
from piezod.devices.interface import DriverPlugin, Wiring, faults
from piezod_drivers.can_bus.dbc.dialogue import DbcDialogue
from piezod_drivers.can_bus.dbc.options import DbcOptions, channels
from piezod_drivers.can_bus.options import make_bus


def create(options: DbcOptions, wiring: Wiring, _seed: int) -> BusDevice:
    """Construct the device; nothing is opened."""
    dialogue = DbcDialogue(options, wiring, make_bus(options.bus))
    if wiring.inputs and wiring.outputs:
        return ExchangingBusDevice("the CAN device", dialogue)
    return BusDevice("the CAN device", dialogue)


PLUGIN: Final = DriverPlugin(
    name="can_dbc",
    summary="any device on a CAN bus whose frames a DBC file describes",
    options_model=DbcOptions,
    create=create,
    confirmed_on_hardware=False,
    channels=channels,
    sees=faults("A1 A3 A4 A8 A9 A11 A12 A13 B1 B2 B3 B4 B5 B6 B7 B8 B9 B11 B12 B14 S7 S8"),
)
