"""The emulated GCS 2.0 controller, an E-727 with piezo amplifiers and sensors, serial or TCP."""

from collections.abc import Sequence
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod_drivers.serial_line.gcs.emulator import GcsEmulator, GcsModel, GcsRefusal, switch_in
from piezod_drivers.serial_line.pi_gcs2.emulation.wave_commands import WaveCommands
from piezod_drivers.serial_line.pi_gcs2.emulation.wave_generators import WaveGenerators

_MODEL: Final = GcsModel(
    identity="(c)2015-2018 Physik Instrumente (PI) GmbH & Co. KG, E-727.3CDA, {serial}, "
    "14.11.01.05",
    ids=tuple("12345678"),
    serial="120040681",
    number="{:.6f}",
    servo_error=79,
    lowest_v=-20.0,
    highest_v=150.0,
    longest=1024,  # 32 arguments, each of 12 digits
)
_TRAVEL_UM: Final = 30.0
_IS_PLAYING: Final = 0x09
_GENERATOR_ACTIVE: Final = 73
_NEXT: Final = " \n"
"""Ends a line of a reply that another line follows."""


class _Quirks:
    """Implements `ProtocolQuirks`: spaces between arguments, a line for each axis in replies."""

    def ids(self, text: str, every: Sequence[str]) -> Sequence[str]:
        """Return the words."""
        return text.split() or every

    def pairs(self, text: str) -> Sequence[tuple[str, str]]:
        """Return the words in pairs."""
        words = text.split()
        if not words or len(words) % 2:
            raise GcsRefusal(24)
        return list(zip(words[::2], words[1::2], strict=True))

    def reply(self, ids: Sequence[str], values: Sequence[str]) -> bytes:
        """Return lines such as `1=2.5`; all but the last have a space before the line feed."""
        lines = (f"{axis}={value}" for axis, value in zip(ids, values, strict=True))
        return (_NEXT.join(lines) + "\n").encode()

    def axes_reply(self, ids: Sequence[str]) -> bytes:
        """Return a line for each axis, ended in the same way."""
        return (_NEXT.join(ids) + "\n").encode()


class Gcs2Emulator(GcsEmulator):
    """Adds what only GCS 2.0 has: online mode, voltage limits, travel, wave generators, recorder.

    Args:
        serial: Serial number, "" for its usual one.
    """

    def __init__(self, bench: SharedRig, serial: str) -> None:
        super().__init__(bench, _Quirks(), _MODEL, serial)
        self._handlers |= {
            "ONL": self._set_online,
            "ONL?": self._query(lambda i: self.axes[i].online),
            "VMI?": self._query(lambda _: _MODEL.lowest_v),
            "VMA?": self._query(lambda _: _MODEL.highest_v),
            "TMN?": self._query(lambda _: 0.0),
            "TMX?": self._query(lambda _: _TRAVEL_UM),
        }
        self._waves = WaveGenerators(bench, self.axes)
        self.pulses = self._waves.triggers.pulses
        """Number of pulses of each digital output."""
        commands = WaveCommands(self._waves)
        self._handlers |= commands.handlers
        self._bytes[_IS_PLAYING] = commands.running

    def receive(self, data: bytes) -> list[bytes]:
        """Run the servo cycles that are due, then process bytes of the host."""
        self._waves.advance()
        return super().receive(data)

    def due(self) -> list[bytes]:
        """Run the servo cycles that are due; return nothing."""
        self._waves.advance()
        return super().due()

    def _set_voltages(self, arguments: str) -> bytes:
        moving = self._waves.running()
        if any(moving >> self._index(axis) & 1 for axis, _ in self._quirks.pairs(arguments)):
            raise GcsRefusal(_GENERATOR_ACTIVE)
        return super()._set_voltages(arguments)

    def _stop(self) -> bytes:
        self._waves.stop_all()
        return super()._stop()

    def _measured_v(self, axis: int) -> float:
        return self._waves.measured_v(axis)

    def _position_um(self, axis: int) -> float:
        return self._waves.position_um(axis)

    def _set_online(self, arguments: str) -> bytes:
        for channel, text in self._quirks.pairs(arguments):
            i = self._index(channel)
            # The setpoint of `SVA` takes effect when the channel comes online.
            self.axes[i].online = switch_in(text)
            self._drive(i)
        return b""


EMULATOR: Final = EmulatorPlugin(
    name="pi-gcs2",
    summary="PI E-727, GCS 2.0 over a serial port",
    wire="serial",
    create=Gcs2Emulator,
)
EMULATOR_TCP: Final = EmulatorPlugin(
    name="pi-gcs2-tcp",
    summary="PI E-727, GCS 2.0 over TCP",
    wire="tcp",
    create=Gcs2Emulator,
)
