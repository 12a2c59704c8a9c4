"""The driver `micro_epsilon`: Micro-Epsilon's optical sensors."""

from typing import Final

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import ChannelUnits, DriverPlugin, Wiring, faults
from piezod_drivers.serial_line.micro_epsilon.dialogue import MicroEpsilonDialogue
from piezod_drivers.serial_line.micro_epsilon.options import MicroEpsilonOptions
from piezod_drivers.serial_line.options import make_line


def channels(_options: MicroEpsilonOptions) -> ChannelUnits:
    """Return the only channel, the distance from the beginning of the measuring range."""
    return ChannelUnits({"distance": "µm"}, {})


def _create(options: MicroEpsilonOptions, wiring: Wiring, _seed: int) -> BusDevice:
    line = make_line(options, options.bits_per_s)
    name = f"{options.model} at {options.port}"
    return BusDevice(name, MicroEpsilonDialogue(options, wiring, line))


PLUGIN: Final = DriverPlugin(
    name="micro_epsilon",
    summary="Micro-Epsilon ILD1220 to ILD1900, ODC2520: a stream of values over RS-422",
    options_model=MicroEpsilonOptions,
    create=_create,
    confirmed_on_hardware=False,
    channels=channels,
    sees=faults("B1 B2 B3 B5 B11 B14 S5 S6 S7 S8 S10"),
)
