"""Emulated sensors: each sends a value per period, and its identity in between."""

from math import isfinite
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod.units import NS_PER_S
from piezod_drivers.serial_line.micro_epsilon.profiles import PROFILES, UM_PER_MM

RATE_HZ: Final = 1000
_BEHIND_RANGE: Final = 262_078
_MOST_WORDS: Final = 64
"""No more words are sent at once: a sensor does not catch up after a pause."""
_LONGEST_LINE: Final = 256
_PROMPT: Final = "->"


def word_of(count: int, word_bytes: int, *, additional: bool = False) -> bytes:
    """Return the word of a value, of 2 or 3 bytes; with 3 it may be an additional one."""
    if word_bytes == 2:
        return bytes((0x80 | count >> 7 & 0x7F, count & 0x7F))
    top = 0xC0 if additional else 0x80
    return bytes((count & 0x3F, 0x40 | count >> 6 & 0x3F, top | count >> 12 & 0x3F))


class SensorEmulator:
    """A sensor in front of the first axis.

    Args:
        bench: The rig; its clock is used.
        serial: Serial number, "" for the usual one.
        model: Family, a key of `PROFILES` whose words have three bytes.
        name: Reported model.
        range_mm: Measuring range, in mm.
        rest_um: Distance from the beginning of the range to the axis at rest, in µm.
    """

    def __init__(
        self, bench: SharedRig, serial: str, model: str, name: str, range_mm: float, rest_um: float
    ) -> None:
        self._bench, self._profile = bench, PROFILES[model]
        self._range_um, self._rest_um = range_mm * UM_PER_MM, rest_um
        self._line = b""
        self._next_ns = bench.now_ns()
        self._period_ns = NS_PER_S // RATE_HZ
        self._info = (
            f"Name: {name}\r\nSerial: {serial or '15030002'}\r\nOption: 000\r\n"
            f"Article: 4120212\r\nCable head: Wire\r\nMeasuring range: {range_mm:.2f}mm\r\n"
            "Version: 001.010\r\nHardware-rev: 00\r\nBoot-version: 001.000\r\n"
        )

    def receive(self, data: bytes) -> list[bytes]:
        """Reply to every complete command; the stream continues."""
        *commands, self._line = (self._line + data).replace(b"\r", b"\n").split(b"\n")
        self._line = self._line[-_LONGEST_LINE:]
        return [self._answer(command) for command in commands if command]

    def due(self) -> list[bytes]:
        """Return the words of the values since the last call."""
        now_ns = self._bench.now_ns()
        n = (now_ns - self._next_ns) // self._period_ns + 1
        if n <= 0:
            return []
        # Also for values that are not sent, so that the stream keeps its rate.
        self._next_ns += n * self._period_ns
        return [self._word()] * min(n, _MOST_WORDS)

    def _word(self) -> bytes:
        position_um = self._bench.position_um(0)
        if not isfinite(position_um):
            # Error code "behind the measuring range".
            return word_of(_BEHIND_RANGE, self._profile.word_bytes)
        count = self._profile.count_at(self._rest_um + position_um, self._range_um)
        if not self._profile.lowest <= count <= self._profile.highest:
            count = _BEHIND_RANGE
        return word_of(count, self._profile.word_bytes)

    def _answer(self, command: bytes) -> bytes:
        word = command.decode("ascii", "replace").strip()
        # A sensor repeats the command before its reply.
        answer = self._info if word.upper() == "GETINFO" else "E200 I/O error\r\n"
        return f"{word}\r\n{answer}{_PROMPT}".encode("ascii", "replace")


def _ild1420(bench: SharedRig, serial: str) -> SensorEmulator:
    return SensorEmulator(bench, serial, "ILD1420", "ILD1420-10", range_mm=10.0, rest_um=5000.0)


def _odc2520(bench: SharedRig, serial: str) -> SensorEmulator:
    return SensorEmulator(bench, serial, "ODC2520", "ODC2520-46", range_mm=46.0, rest_um=20_000.0)


ILD1420: Final = EmulatorPlugin(
    name="ild1420",
    summary="Micro-Epsilon ILD1420-10 laser sensor, 10 mm, 1 kHz",
    wire="serial",
    create=_ild1420,
)
ODC2520: Final = EmulatorPlugin(
    name="odc2520",
    summary="Micro-Epsilon ODC2520-46 micrometer, in steps of 1 µm, 1 kHz",
    wire="serial",
    create=_odc2520,
)
