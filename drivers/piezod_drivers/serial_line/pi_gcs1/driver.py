"""The driver `pi_gcs1`: PI controllers with GCS 1, over a serial port."""

from typing import Final

from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.interface import DriverPlugin, Wiring
from piezod_drivers.serial_line.gcs.channels import channels
from piezod_drivers.serial_line.gcs.faults import SEES
from piezod_drivers.serial_line.options import make_line
from piezod_drivers.serial_line.pi_gcs1.dialogue import Gcs1Dialogue
from piezod_drivers.serial_line.pi_gcs1.options import Gcs1Options


def _create(options: Gcs1Options, wiring: Wiring, _seed: int) -> ExchangingBusDevice:
    dialogue = Gcs1Dialogue(make_line(options), options, wiring)
    return ExchangingBusDevice("PI GCS 1 controller", dialogue)


PLUGIN: Final = DriverPlugin(
    name="pi_gcs1",
    summary="PI controllers with GCS 1: E-816 (E-621, E-625, E-665), E-516",
    options_model=Gcs1Options,
    create=_create,
    confirmed_on_hardware=False,
    channels=channels,
    sees=SEES,
)
