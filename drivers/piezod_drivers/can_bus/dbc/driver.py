"""A device on a CAN bus whose frames a DBC file describes."""

from typing import Final

from piezod.devices.bus.bus_device import BusDevice, ExchangingBusDevice
from piezod.devices.interface import DriverPlugin, Wiring
from piezod_drivers.can_bus.dbc.dialogue import Dialogue
from piezod_drivers.can_bus.dbc.options import Options, channels
from piezod_drivers.can_bus.options import make_bus


def create(options: Options, wiring: Wiring, _seed: int) -> BusDevice:
    """Construct the device; nothing is opened."""
    dialogue = Dialogue(options, wiring, make_bus(options.bus))
    if wiring.inputs and wiring.outputs:
        return ExchangingBusDevice("the CAN device", dialogue)
    return BusDevice("the CAN device", dialogue)


PLUGIN: Final = DriverPlugin(
    name="can_dbc",
    summary="whatever sends and takes frames on a CAN bus that a DBC file describes",
    options_model=Options,
    create=create,
    confirmed_on_hardware=False,
    channels=channels,
    sees=frozenset(
        {f"B{number}" for number in (1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 14)}
        | {"A1", "A3", "A4", "A8", "A9", "A11", "A12", "A13", "S7", "S8"}
    ),
)
