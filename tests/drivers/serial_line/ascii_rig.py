"""Devices that speak in lines, at a line of a test."""

from collections.abc import Mapping

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.bus.line import Line
from piezod.devices.interface import Wiring
from piezod_drivers.serial_line.ascii_line.dialogue import AsciiDialogue
from piezod_drivers.serial_line.ascii_line.options import AsciiOptions
from piezod_drivers.serial_line.ascii_line.patterns import compiled
from piezod_drivers.serial_line.ascii_line.stream_dialogue import AsciiStreamDialogue
from tests.drivers.serial_line.scripted_line import ScriptedLine, Step

PLAIN: Mapping[str, object] = {
    "port": "somewhere",
    "outputs": {"x": {"lowest": 0.0, "highest": 100.0}},
    "inputs": {"x": {}},
    "set": ({"send": "V {x:.2f}", "reply": "OK"},),
    "read": ({"send": "P?", "reply": r"(?P<x>-?\d+\.\d+)"},),
    "errors": (
        {"pattern": r"ERR \d+", "flag": "wrong request"},
        {"pattern": "OVERLOAD", "flag": "overload"},
    ),
}
"""Options of a device with one channel."""
LISTENED: Mapping[str, object] = {
    "port": "somewhere",
    "inputs": {"x": {}},
    "stream": r"P (?P<x>-?\d+\.\d+) um",
    "errors": ({"pattern": "saturated", "flag": "saturated"},),
    "timeout_ms": 50.0,
}
"""Options of a sensor that sends by itself."""


def device(line: Line, wiring: Wiring = Wiring.both("x"), /, **options: object) -> BusDevice:  # noqa: B008 - it never changes
    """Construct a device at a line, with `PLAIN` options and the given ones."""
    model = AsciiOptions.model_validate({**PLAIN, **options})
    return BusDevice("ASCII", AsciiDialogue(line, model, wiring))


def sensor(line: Line, **options: object) -> BusDevice:
    """Construct a sensor at a line, with `LISTENED` options and the given ones."""
    model = AsciiOptions.model_validate({**LISTENED, **options})
    assert model.stream is not None
    wiring = Wiring(tuple(model.inputs), ())
    return BusDevice("ASCII", AsciiStreamDialogue(line, model, wiring, compiled(model.stream)))


def started(*steps: Step, **options: object) -> tuple[BusDevice, ScriptedLine]:
    """Return a device that is open and active, and its line with a script."""
    line = ScriptedLine(*steps)
    dut = device(line, **options)
    dut.open()
    dut.activate(line.now_ns())
    return dut, line
