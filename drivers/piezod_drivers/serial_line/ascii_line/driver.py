"""The driver `ascii`: devices that speak in lines of text."""

from typing import Final

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import ChannelUnits, DriverPlugin, Wiring, faults
from piezod_drivers.serial_line.ascii_line.dialogue import AsciiDialogue
from piezod_drivers.serial_line.ascii_line.options import AsciiOptions
from piezod_drivers.serial_line.ascii_line.patterns import compiled
from piezod_drivers.serial_line.ascii_line.stream_dialogue import AsciiStreamDialogue
from piezod_drivers.serial_line.options import make_line


def _channels(options: AsciiOptions) -> ChannelUnits:
    return ChannelUnits(
        {name: channel.unit for name, channel in options.inputs.items()},
        {name: channel.unit for name, channel in options.outputs.items()},
    )


def _create(options: AsciiOptions, wiring: Wiring, _seed: int) -> BusDevice:
    line = make_line(options)
    if options.stream is not None:
        listening = AsciiStreamDialogue(line, options, wiring, compiled(options.stream))
        return BusDevice("ASCII sensor", listening)
    return BusDevice("ASCII device", AsciiDialogue(line, options, wiring))


PLUGIN: Final = DriverPlugin(
    name="ascii",
    summary="any device that speaks in lines of text: the configuration has commands and replies",
    options_model=AsciiOptions,
    create=_create,
    confirmed_on_hardware=False,
    channels=_channels,
    sees=faults("A1 A2 A3 A4 A8 A9 A11 A12 A13 B1 B2 B3 B5 B6 B7 B10 B11 B13 B14 S7 S8 S10"),
)
