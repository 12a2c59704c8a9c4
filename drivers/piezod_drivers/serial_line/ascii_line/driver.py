"""The driver `ascii`: devices that speak in lines of text."""

from typing import Final

from piezod.config.faults import Fault
from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import ChannelUnits, DriverPlugin, Wiring
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
    sees=frozenset(
        {
            Fault.B1,
            Fault.B2,
            Fault.B3,
            Fault.B5,
            Fault.B6,
            Fault.B7,
            Fault.B10,
            Fault.B11,
            Fault.B13,
            Fault.B14,
        }
        | {
            Fault.A1,
            Fault.A2,
            Fault.A3,
            Fault.A4,
            Fault.A8,
            Fault.A9,
            Fault.A11,
            Fault.A12,
            Fault.A13,
            Fault.S7,
            Fault.S8,
            Fault.S10,
        }
    ),
)
