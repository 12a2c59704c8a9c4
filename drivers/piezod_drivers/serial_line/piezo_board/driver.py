"""The driver `piezo_board`: a microcontroller with the player firmware."""

from typing import Final

from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.bus.line import Line
from piezod.devices.bus.playing_device import ExchangingPlayingBusDevice
from piezod.devices.interface import ChannelUnits, DriverPlugin, Wiring, faults
from piezod_drivers.serial_line.options import make_line
from piezod_drivers.serial_line.piezo_board.dialogue import BoardDialogue
from piezod_drivers.serial_line.piezo_board.options import BoardOptions


def channels(options: BoardOptions) -> ChannelUnits:
    """Return the channels: each has an output and an input, in V at the converter."""
    names = [str(i) for i in range(1, options.channels + 1)]
    return ChannelUnits(dict.fromkeys(names, "V"), dict.fromkeys(names, "V"))


def make_device(line: Line, options: BoardOptions, wiring: Wiring) -> ExchangingBusDevice:
    """Construct a board on a line; it plays if it drives anything."""
    dialogue, name = BoardDialogue(options, wiring, line), f"player board at {options.port}"
    if wiring.outputs:
        return ExchangingPlayingBusDevice(name, dialogue, dialogue.player)
    return ExchangingBusDevice(name, dialogue)


def _create(options: BoardOptions, wiring: Wiring, _seed: int) -> ExchangingBusDevice:
    return make_device(make_line(options), options, wiring)


PLUGIN: Final = DriverPlugin(
    name="piezo_board",
    summary="player board: an open firmware on a microcontroller with converters",
    options_model=BoardOptions,
    create=_create,
    confirmed_on_hardware=False,
    channels=channels,
    sees=faults("A1 A2 A3 A7 A9 A12 B1 B2 B3 B4 B5 B6 B7 B14 S7 S10"),
)
