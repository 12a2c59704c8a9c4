"""Two emulated devices for the examples: a nanopositioner with commands, a streaming sensor."""

import re
from math import isfinite
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import Emulator, EmulatorPlugin

MOST_BYTES: Final = 256
V_PER_UM: Final = 150 / 26
"""Voltage at the actuator per µm of the setpoint."""
TRAVEL_UM: Final = 26.0
LINE_NS: Final = 2_000_000
"""Period of the sensor's lines."""

_MOVE: Final = re.compile(r"MOVE([XYZ]) (-?\d{1,4}(?:\.\d{1,6})?)u", re.ASCII)


class NanopositionerEmulator(Emulator):
    """Implements `Emulator`; its commands look like PiezoConcept's (source: micro-manager).

    `INFOX` returns its identity, `MOVEX 1.2340u` is acknowledged by `Ok`, `GET_X` returns the
    position. It has no closed loop: a stage with hysteresis is behind it.

    Args:
        bench: The rig; axes X, Y and Z are the first three.
        serial: Serial number.
    """

    def __init__(self, bench: SharedRig, serial: str) -> None:
        self._bench, self._serial = bench, serial or "1001"
        self._axes = "XYZ"[: bench.n_axes]
        self._rest = b""

    def receive(self, data: bytes) -> list[bytes]:
        """Reply to every complete command."""
        *lines, rest = (self._rest + data).split(b"\n")
        self._rest = rest[-MOST_BYTES:]
        return [self._answer(line.decode("latin-1")).encode("ascii") + b"\n" for line in lines]

    def _answer(self, command: str) -> str:
        axis = self._axes.find(command[-1:]) if command else -1
        if command.startswith("INFO") and len(command) == 5 and axis >= 0:
            return f"DEMO-{TRAVEL_UM:.0f} um SN{self._serial}"
        if command.startswith("GET_") and len(command) == 5 and axis >= 0:
            position_um = self._bench.position_um(axis)
            return f"{position_um:.4f} um" if isfinite(position_um) else "Error: sensor saturated"
        move = _MOVE.fullmatch(command)
        if move is None or move[1] not in self._axes:
            return "Error: unknown command"
        wanted_um = float(move[2])
        in_range = 0.0 <= wanted_um <= TRAVEL_UM
        if in_range and self._bench.drive(self._axes.index(move[1]), wanted_um * V_PER_UM):
            return "Ok"
        return "Error: out of range"


class StreamingSensor:
    """Implements `Emulator`: a home-made sensor that sends `P 12.3456 um` every 2 ms.

    Args:
        bench: The rig; the first axis is measured.
    """

    def __init__(self, bench: SharedRig) -> None:
        self._bench, self._sent_ns = bench, 0

    def receive(self, data: bytes) -> list[bytes]:  # noqa: ARG002 - it has no commands
        """Return nothing."""
        return []

    def due(self) -> list[bytes]:
        """Return a line if it is due; missed lines are not sent."""
        now_ns = self._bench.now_ns()
        if now_ns - self._sent_ns < LINE_NS:
            return []
        self._sent_ns = now_ns
        position_um = self._bench.position_um(0)
        text = f"{position_um:.4f} um" if isfinite(position_um) else "saturated"
        return [f"P {text}\r\n".encode("ascii")]


def _streaming_sensor(bench: SharedRig, _serial: str) -> StreamingSensor:
    return StreamingSensor(bench)


DEMO: Final = EmulatorPlugin(
    "ascii-demo",
    "a nanopositioner with commands like PiezoConcept's",
    "serial",
    NanopositionerEmulator,
)
SENSOR: Final = EmulatorPlugin(
    "ascii-sensor", "a sensor that sends a line every 2 ms", "serial", _streaming_sensor
)
