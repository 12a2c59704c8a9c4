"""The emulated E-816 piezo controller, GCS 1 over a serial port."""

import re
from collections.abc import Sequence
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod_drivers.serial_line.gcs.emulator import GcsEmulator, GcsModel, GcsRefusal

_MODEL: Final = GcsModel(
    identity="Physik Instrumente,E-816,{serial},V3.20",
    ids=tuple("ABCDEFGH"),
    serial="107032415",
    number="{:+010.4f}",
    servo_error=303,
    lowest_v=-20.0,
    highest_v=150.0,
)


class _Quirks:
    """Implements `ProtocolQuirks`: letters directly before values, replies without the letter."""

    def ids(self, text: str, every: Sequence[str]) -> Sequence[str]:  # noqa: ARG002 - the protocol's
        """Return the one requested letter."""
        if not text:
            raise GcsRefusal(26)
        return [text]

    def pairs(self, text: str) -> Sequence[tuple[str, str]]:
        """Return the letters and the values behind them."""
        if not re.fullmatch(r"([A-Z][^A-Z]+)+", text):
            raise GcsRefusal(24)
        return [(pair[0], pair[1:].strip()) for pair in re.findall(r"[A-Z][^A-Z]+", text)]

    def reply(self, ids: Sequence[str], values: Sequence[str]) -> bytes:  # noqa: ARG002 - likewise
        """Return the bare value."""
        return f"{values[0]}\n".encode()

    def axes_reply(self, ids: Sequence[str]) -> bytes:
        """Return the letters in a row."""
        return f"{''.join(ids)}\n".encode()


def _create(bench: SharedRig, serial: str) -> GcsEmulator:
    return GcsEmulator(bench, _Quirks(), _MODEL, serial)


EMULATOR: Final = EmulatorPlugin(
    name="pi-e816",
    summary="PI E-816, GCS 1 over a serial port",
    wire="serial",
    create=_create,
)
