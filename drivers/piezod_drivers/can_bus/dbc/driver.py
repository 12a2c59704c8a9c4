"""The driver `can_dbc`: a device on a CAN bus whose frames a DBC file describes."""

from typing import Final

from piezod.config.faults import Fault
from piezod.devices.bus.bus_device import BusDevice, ExchangingBusDevice
from piezod.devices.interface import DriverPlugin, Wiring
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
    sees=frozenset(
        {
            Fault.B1,
            Fault.B2,
            Fault.B3,
            Fault.B4,
            Fault.B5,
            Fault.B6,
            Fault.B7,
            Fault.B8,
            Fault.B9,
            Fault.B11,
            Fault.B12,
            Fault.B14,
            Fault.A1,
            Fault.A3,
            Fault.A4,
            Fault.A8,
            Fault.A9,
            Fault.A11,
            Fault.A12,
            Fault.A13,
            Fault.S7,
            Fault.S8,
        }
    ),
)
