"""The driver `thorlabs_apt`: Thorlabs' piezo amplifiers and strain gauge readers."""

from typing import Final

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import ChannelUnits, DriverPlugin, Wiring, faults
from piezod_drivers.serial_line.thorlabs_apt.amplifier_dialogue import AmplifierDialogue
from piezod_drivers.serial_line.thorlabs_apt.cube_line import CubeLine
from piezod_drivers.serial_line.thorlabs_apt.options import AptOptions
from piezod_drivers.serial_line.thorlabs_apt.reader_dialogue import ReaderDialogue

CHANNEL: Final = "1"


def channels(options: AptOptions) -> ChannelUnits:
    """Return the channel of a cube: one output or one input."""
    if options.is_amplifier:
        return ChannelUnits({}, {CHANNEL: "V"})
    return ChannelUnits({CHANNEL: "µm"}, {})


def _create(options: AptOptions, wiring: Wiring, _seed: int) -> BusDevice:
    settle_s = options.settle_ms * 1e-3
    line = CubeLine(options.port, options.baud, rtscts=options.rtscts, settle_s=settle_s)
    name = f"{options.model} at {options.port}"
    if options.is_amplifier:
        return BusDevice(name, AmplifierDialogue(options, wiring, line))
    return BusDevice(name, ReaderDialogue(options, wiring, line))


PLUGIN: Final = DriverPlugin(
    name="thorlabs_apt",
    summary="Thorlabs KPZ101 and TPZ001 amplifiers, KSG101 and TSG001 strain gauge readers",
    options_model=AptOptions,
    create=_create,
    confirmed_on_hardware=False,
    channels=channels,
    sees=faults("A1 A2 A3 A7 A8 A12 B1 B2 B3 B5 B6 B7 B10 B14 S7 S10"),
)
