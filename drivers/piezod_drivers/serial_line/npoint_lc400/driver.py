"""The driver `npoint_lc400`: nPoint's LC.400 controllers."""

from typing import Final

from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.bus.line import Line
from piezod.devices.bus.playing_device import ExchangingPlayingBusDevice
from piezod.devices.interface import ChannelUnits, DriverPlugin, Wiring, faults
from piezod_drivers.serial_line.npoint_lc400.dialogue import Lc400Dialogue
from piezod_drivers.serial_line.npoint_lc400.options import Lc400Options
from piezod_drivers.serial_line.options import make_line


def channels(options: Lc400Options) -> ChannelUnits:
    """Return the channels: each has a position in µm and a command in %."""
    names = [str(i) for i in range(1, options.axes + 1)]
    return ChannelUnits(dict.fromkeys(names, "µm"), dict.fromkeys(names, "%"))


def make_device(line: Line, options: Lc400Options, wiring: Wiring) -> ExchangingBusDevice:
    """Construct a controller on a line; it plays if it drives anything."""
    dialogue, name = Lc400Dialogue(options, wiring, line), f"LC.400 at {options.port}"
    if wiring.outputs:
        return ExchangingPlayingBusDevice(name, dialogue, dialogue.player)
    return ExchangingBusDevice(name, dialogue)


def _create(options: Lc400Options, wiring: Wiring, _seed: int) -> ExchangingBusDevice:
    return make_device(make_line(options), options, wiring)


PLUGIN: Final = DriverPlugin(
    name="npoint_lc400",
    summary="nPoint LC.400 controllers, in open loop",
    options_model=Lc400Options,
    create=_create,
    confirmed_on_hardware=False,
    channels=channels,
    sees=faults("A1 A2 A3 A8 A12 B1 B2 B3 B5 B6 B7 B14 S7"),
)
