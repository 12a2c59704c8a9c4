"""GCS 2.0 as text: `SVA 1 2.5 2 3.1`, and replies with a line `axis=value` for each axis."""

import re
from collections.abc import Sequence
from typing import Final

from piezod_drivers.serial_line.gcs.syntax import NUMBER

_AXIS: Final = r"[!-<>-~]{1,8}"


class Gcs2:
    """Implements `Syntax`."""

    bare = False

    def query(self, command: str, ids: Sequence[str]) -> bytes:
        """Return as `POS? 1 2`."""
        return f"{' '.join((command, *ids))}\n".encode()

    def setting(self, command: str, ids: Sequence[str], values: Sequence[str]) -> bytes:
        """Return as `SVA 1 2.5 2 3.1`."""
        pairs = (f" {axis} {value}" for axis, value in zip(ids, values, strict=True))
        return f"{command}{''.join(pairs)}\n".encode()

    def numbers(self, ids: Sequence[str]) -> Sequence[str]:
        """Return one pattern: all axes are in one reply."""
        return [r" \n".join(f"{re.escape(axis)}={NUMBER}" for axis in ids) + r"\n"]

    def switches(self, ids: Sequence[str]) -> Sequence[str]:
        """Return one pattern, likewise."""
        return [r" \n".join(f"{re.escape(axis)}=([01])" for axis in ids) + r"\n"]

    def axes(self) -> str:
        """Return the pattern of axes, each on a line of its own."""
        return rf"((?:{_AXIS} \n){{0,31}}{_AXIS})\n"

    def axes_in(self, told: str) -> Sequence[str]:
        """Return the lines."""
        return told.split()
