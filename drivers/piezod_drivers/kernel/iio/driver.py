"""The driver `iio`: converters on SPI and I²C that an IIO driver of the kernel drives."""

from typing import Final

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import DriverPlugin, Wiring, faults
from piezod_drivers.kernel.iio.dialogue import IioDialogue
from piezod_drivers.kernel.iio.options import IioOptions, channels


def create(options: IioOptions, wiring: Wiring, _seed: int) -> BusDevice:
    """Construct the device; nothing is opened."""
    return BusDevice(f"IIO device {options.device}", IioDialogue(options, wiring))


PLUGIN: Final = DriverPlugin(
    name="iio",
    summary="converters on SPI and I²C by the kernel's IIO drivers, as on a Raspberry Pi",
    options_model=IioOptions,
    create=create,
    confirmed_on_hardware=False,
    channels=channels,
    sees=faults("A1 A3 A12 B1 B10 B14 S7 S10"),
)
