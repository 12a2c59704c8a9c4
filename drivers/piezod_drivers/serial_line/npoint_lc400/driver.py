"""nPoint's LC.400 controllers as devices."""

from typing import Final

from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.interface import ChannelUnits, DriverPlugin, Wiring
from piezod_drivers.serial_line.npoint_lc400.dialogue import Lc400Dialogue
from piezod_drivers.serial_line.npoint_lc400.options import Options
from piezod_drivers.serial_line.options import make_line


def channels(options: Options) -> ChannelUnits:
    """Tell the channels: each has a position in µm and a command in %."""
    names = [str(i) for i in range(1, options.axes + 1)]
    return ChannelUnits(dict.fromkeys(names, "µm"), dict.fromkeys(names, "%"))


def _create(options: Options, wiring: Wiring, _seed: int) -> ExchangingBusDevice:
    name = f"LC.400 at {options.port}"
    return ExchangingBusDevice(name, Lc400Dialogue(options, wiring, make_line(options)))


PLUGIN: Final = DriverPlugin(
    name="npoint_lc400",
    summary="nPoint LC.400 controllers, in open loop",
    options_model=Options,
    create=_create,
    confirmed_on_hardware=False,
    channels=channels,
    sees=frozenset(
        {"A1", "A2", "A3", "A8", "A12", "B1", "B2", "B3", "B5", "B6", "B7", "B14", "S7"}
    ),
)
