"""The driver `npoint_lc400`: nPoint's LC.400 controllers."""

from typing import Final

from piezod.config.faults import Fault
from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.interface import ChannelUnits, DriverPlugin, Wiring
from piezod_drivers.serial_line.npoint_lc400.dialogue import Lc400Dialogue
from piezod_drivers.serial_line.npoint_lc400.options import Lc400Options
from piezod_drivers.serial_line.options import make_line


def channels(options: Lc400Options) -> ChannelUnits:
    """Return the channels: each has a position in µm and a command in %."""
    names = [str(i) for i in range(1, options.axes + 1)]
    return ChannelUnits(dict.fromkeys(names, "µm"), dict.fromkeys(names, "%"))


def _create(options: Lc400Options, wiring: Wiring, _seed: int) -> ExchangingBusDevice:
    name = f"LC.400 at {options.port}"
    return ExchangingBusDevice(name, Lc400Dialogue(options, wiring, make_line(options)))


PLUGIN: Final = DriverPlugin(
    name="npoint_lc400",
    summary="nPoint LC.400 controllers, in open loop",
    options_model=Lc400Options,
    create=_create,
    confirmed_on_hardware=False,
    channels=channels,
    sees=frozenset(
        {
            Fault.A1,
            Fault.A2,
            Fault.A3,
            Fault.A8,
            Fault.A12,
            Fault.B1,
            Fault.B2,
            Fault.B3,
            Fault.B5,
            Fault.B6,
            Fault.B7,
            Fault.B14,
            Fault.S7,
        }
    ),
)
