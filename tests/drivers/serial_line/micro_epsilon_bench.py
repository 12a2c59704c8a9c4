"""Emulated and scripted Micro-Epsilon sensors and their drivers."""

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.interface import Wiring
from piezod_drivers.serial_line.micro_epsilon.dialogue import MicroEpsilonDialogue
from piezod_drivers.serial_line.micro_epsilon.emulator import ILD1420, ODC2520, word_of
from piezod_drivers.serial_line.micro_epsilon.options import MicroEpsilonOptions
from piezod_drivers.serial_line.micro_epsilon.profiles import PROFILES
from tests.drivers.serial_line.linear_rig import LinearRig, bench
from tests.drivers.serial_line.scripted_line import US, EmulatedLine, ScriptedLine, exchange

WIRING = Wiring(("distance",), ())
GETINFO = b"GETINFO\n"
ANSWER = (
    b"GETINFO\r\nName: ILD1420-10\r\nSerial: 77\r\nMeasuring range: 10.00mm\r\nVersion: 1\r\n->"
)
COUNT = 32_000
WORD = word_of(COUNT, 3)
AT_COUNT_UM = (COUNT * 102 / 65520 - 1) / 100 * 10_000


def options(model: str = "ILD1420", **more: object) -> MicroEpsilonOptions:
    """Return the options of a sensor."""
    return MicroEpsilonOptions.model_validate({"port": "p", "model": model, **more})


def emulated(model: str = "ILD1420") -> tuple[BusDevice, EmulatedLine, LinearRig]:
    """Return a sensor, the line to it, and the rig in front of it."""
    stand, rig, time = bench()
    plugin = ILD1420 if model == "ILD1420" else ODC2520
    assert plugin.create is not None
    line = EmulatedLine(plugin.create(stand, ""), time)
    return BusDevice(model, MicroEpsilonDialogue(options(model), WIRING, line)), line, rig


def scripted(model: str = "ILD1420", **more: object) -> tuple[BusDevice, ScriptedLine]:
    """Return an active sensor that sends the bytes of the test."""
    line = ScriptedLine()
    if PROFILES[model].answers_commands:
        line.then(exchange(GETINFO, WORD + ANSWER.replace(b"ILD1420", model.encode()) + WORD))
    device = BusDevice(model, MicroEpsilonDialogue(options(model, **more), WIRING, line))
    line.comes(word_of(COUNT >> 4, PROFILES[model].word_bytes), 200 * US)
    device.open()
    device.activate(line.now_ns())
    return device, line
