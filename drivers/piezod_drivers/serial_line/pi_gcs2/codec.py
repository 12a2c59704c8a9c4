"""GCS 2.0 as text: `SVA 1 2.5 2 3.1`; replies have a line `axis=value` for each axis."""

import re
from collections.abc import Sequence
from typing import Final

from piezod_drivers.serial_line.gcs.syntax import NUMBER

# An identifier has no space and no "=", which separates it from the value.
_AXIS: Final = r"[!-<>-~]{1,8}"


class Gcs2Syntax:
    """Implements `Syntax`."""

    bare = False

    def query(self, command: str, ids: Sequence[str]) -> bytes:
        """Return a query such as `POS? 1 2`."""
        return f"{' '.join((command, *ids))}\n".encode()

    def setting(self, command: str, ids: Sequence[str], values: Sequence[str]) -> bytes:
        """Return a setting such as `SVA 1 2.5 2 3.1`."""
        pairs = (f" {axis} {value}" for axis, value in zip(ids, values, strict=True))
        return f"{command}{''.join(pairs)}\n".encode()

    def numbers(self, ids: Sequence[str]) -> Sequence[str]:
        """Return one pattern: one reply has all axes."""
        # A space before the line feed announces another line of the same reply.
        return [r" \n".join(f"{re.escape(axis)}={NUMBER}" for axis in ids) + r"\n"]

    def switches(self, ids: Sequence[str]) -> Sequence[str]:
        """Return one pattern: one reply has all axes."""
        return [r" \n".join(f"{re.escape(axis)}=([01])" for axis in ids) + r"\n"]

    def axes(self) -> str:
        """Return the pattern of the axes, each on a line of its own."""
        return rf"((?:{_AXIS} \n){{0,31}}{_AXIS})\n"

    def axes_in(self, reply: str) -> Sequence[str]:
        """Return the lines."""
        return reply.split()
