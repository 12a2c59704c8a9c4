"""The driver `pi_gcs2`: PI controllers with GCS 2.0, over a serial port, a USB one or TCP."""

from typing import Final

from piezod.config.faults import Fault
from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.bus.line import Line
from piezod.devices.bus.playing_device import ExchangingPlayingBusDevice
from piezod.devices.interface import DriverPlugin, Wiring
from piezod_drivers.serial_line.gcs.channels import channels
from piezod_drivers.serial_line.gcs.faults import SEES
from piezod_drivers.serial_line.options import make_line
from piezod_drivers.serial_line.pi_gcs2.dialogue import Gcs2Dialogue
from piezod_drivers.serial_line.pi_gcs2.options import Gcs2Options


def make_device(line: Line, options: Gcs2Options, wiring: Wiring) -> ExchangingBusDevice:
    """Construct a controller on a line; it plays if it drives anything."""
    dialogue, name = Gcs2Dialogue(line, options, wiring), "PI GCS 2 controller"
    if wiring.outputs:
        return ExchangingPlayingBusDevice(name, dialogue, dialogue.player)
    return ExchangingBusDevice(name, dialogue)


def _create(options: Gcs2Options, wiring: Wiring, _seed: int) -> ExchangingBusDevice:
    return make_device(make_line(options), options, wiring)


PLUGIN: Final = DriverPlugin(
    name="pi_gcs2",
    summary="PI controllers with GCS 2.0: E-517, E-709, E-712, E-727, E-754; serial or TCP",
    options_model=Gcs2Options,
    create=_create,
    confirmed_on_hardware=False,
    channels=channels,
    sees=SEES | {Fault.B13},  # over TCP
)
