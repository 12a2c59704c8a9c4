"""The driver `thorlabs_mdt`: Thorlabs MDT amplifiers, over a serial port or a USB one."""

from typing import Final

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import ChannelUnits, DriverPlugin, Wiring, faults
from piezod_drivers.serial_line.options import make_line
from piezod_drivers.serial_line.thorlabs_mdt.dialogue import MdtDialogue
from piezod_drivers.serial_line.thorlabs_mdt.options import MdtOptions


def _channels(_options: MdtOptions) -> ChannelUnits:
    return ChannelUnits({}, dict.fromkeys(("x", "y", "z"), "V"))


def _create(options: MdtOptions, wiring: Wiring, _seed: int) -> BusDevice:
    dialogue = MdtDialogue(make_line(options), options.timeout_ms * 1e-3, wiring)
    return BusDevice("Thorlabs MDT amplifier", dialogue)


PLUGIN: Final = DriverPlugin(
    name="thorlabs_mdt",
    summary="Thorlabs MDT693A/B and MDT694A/B open-loop amplifiers",
    options_model=MdtOptions,
    create=_create,
    confirmed_on_hardware=False,
    channels=_channels,
    sees=faults("A1 A2 A3 A7 A12 B1 B2 B3 B5 B6 B7 B10 B14 S10"),
)
