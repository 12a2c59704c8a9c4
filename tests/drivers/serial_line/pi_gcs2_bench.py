"""Devices at a scripted and at an emulated GCS 2 controller."""

from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.interface import Wiring
from piezod_drivers.serial_line.pi_gcs2.dialogue import Gcs2Dialogue
from piezod_drivers.serial_line.pi_gcs2.emulator import Gcs2Emulator
from piezod_drivers.serial_line.pi_gcs2.options import Gcs2Options
from tests.drivers.serial_line.linear_rig import LinearRig, bench
from tests.drivers.serial_line.scripted_line import (
    EmulatedLine,
    ScriptedLine,
    exchange,
)

OPTIONS = Gcs2Options(port="/dev/ttyUSB0")
OPENING = (
    exchange(b"ERR?\n", b"0\n"),
    exchange(b"*IDN?\nERR?\n", b"(c) PI, E-727, 1204, 14.1\n0\n"),
    exchange(b"SAI?\nERR?\n", b"1 \n2\n0\n"),
)
LIMITS = (
    exchange(b"VMI? 1\nERR?\n", b"1=-20\n0\n"),
    exchange(b"VMA? 1\nERR?\n", b"1=120\n0\n"),
)
NO_PLAY = (
    exchange(b"WGO? 1\nERR?\n", b"1=0\n0\n"),
    exchange(b"\x09ERR?\n", b"0\n0\n"),
)
AT_EASE = (
    *NO_PLAY,
    exchange(b"SVO? 1\nERR?\n", b"1=0\n0\n"),
    exchange(b"ONL? 1\nERR?\n", b"1=1\n0\n"),
)


def scripted(line: ScriptedLine, **options: object) -> ExchangingBusDevice:
    """Return a device of axis 1 on a script."""
    chosen = OPTIONS.model_copy(update=options)
    return ExchangingBusDevice("GCS", Gcs2Dialogue(line, chosen, Wiring.both(["1"])))


def emulated(
    n_axes: int = 1, **options: object
) -> tuple[ExchangingBusDevice, EmulatedLine, Gcs2Emulator, LinearRig]:
    """Return an open device on an emulated controller."""
    table, rig, time = bench(n_axes)
    emulator = Gcs2Emulator(table, "")
    line = EmulatedLine(emulator, time)
    wiring = Wiring.both(str(i + 1) for i in range(n_axes))
    chosen = OPTIONS.model_copy(update=options)
    device = ExchangingBusDevice("GCS", Gcs2Dialogue(line, chosen, wiring))
    device.open()
    return device, line, emulator, rig
