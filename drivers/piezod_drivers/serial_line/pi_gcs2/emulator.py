"""A GCS 2.0 controller with piezo amplifiers and sensors, as an E-727 over serial, USB or TCP."""

from collections.abc import Sequence
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod_drivers.serial_line.gcs.emulator import GcsEmulator, GcsKind, GcsRefusal, switch_in

_KIND: Final = GcsKind(
    identity="(c)2015-2018 Physik Instrumente (PI) GmbH & Co. KG, E-727.3CDA, {serial}, "
    "14.11.01.05",
    ids=tuple("12345678"),
    serial="120040681",
    number="{:.6f}",
    servo_error=79,
    lowest_v=-20.0,
    highest_v=150.0,
)
_TRAVEL_UM: Final = 30.0
_NEXT: Final = " \n"
"""Ends a line of a reply that has another one."""


class _Quirks:
    """Implements `Manners`: arguments apart by spaces, replies with a line for each axis."""

    def ids(self, text: str, every: Sequence[str]) -> Sequence[str]:
        """Return the words."""
        return text.split() or every

    def pairs(self, text: str) -> Sequence[tuple[str, str]]:
        """Return the words two by two."""
        words = text.split()
        if not words or len(words) % 2:
            raise GcsRefusal(24)
        return list(zip(words[::2], words[1::2], strict=True))

    def reply(self, ids: Sequence[str], values: Sequence[str]) -> bytes:
        """Return lines as `1=2.5`, all but the last with a space before the line feed."""
        lines = (f"{axis}={value}" for axis, value in zip(ids, values, strict=True))
        return (_NEXT.join(lines) + "\n").encode()

    def listed(self, ids: Sequence[str]) -> bytes:
        """Return a line for each axis, likewise."""
        return (_NEXT.join(ids) + "\n").encode()


class Gcs2Emulator(GcsEmulator):
    """Adds what only GCS 2.0 has: online mode, voltage limits and travel.

    Args:
        bench: What it is connected to.
        serial: Its serial number, "" for its usual one.
    """

    def __init__(self, bench: SharedRig, serial: str) -> None:
        super().__init__(bench, _Quirks(), _KIND, serial)
        self._handlers |= {
            "ONL": self._set_online,
            "ONL?": self._query(lambda i: self.axes[i].online),
            "VMI?": self._query(lambda _: _KIND.lowest_v),
            "VMA?": self._query(lambda _: _KIND.highest_v),
            "TMN?": self._query(lambda _: 0.0),
            "TMX?": self._query(lambda _: _TRAVEL_UM),
        }

    def _set_online(self, arguments: str) -> bytes:
        for channel, text in self._manners.pairs(arguments):
            i = self._index(channel)
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
