"""GCS 1 as text: the axis letter stands glued to the value, `SVA A12.5`, and replies are bare."""

from collections.abc import Sequence
from typing import Final

_VALUE: Final = r" {0,8}([+-]?[0-9]{1,12}\.[0-9]{0,12}(?:[eE][+-]?[0-9]{1,3})?)\n"
"""Has a point always, as `+0000.0000`, and so is no reply to `ERR?`."""


class Gcs1:
    """Implements `Syntax`; each axis is asked and set by a line of its own."""

    bare = True

    def query(self, command: str, ids: Sequence[str]) -> bytes:
        """Return as `POS? A`."""
        return "".join(f"{command} {axis}\n" for axis in ids).encode()

    def setting(self, command: str, ids: Sequence[str], values: Sequence[str]) -> bytes:
        """Return as `SVA A12.5`."""
        each = zip(ids, values, strict=True)
        return "".join(f"{command} {axis}{value}\n" for axis, value in each).encode()

    def numbers(self, ids: Sequence[str]) -> Sequence[str]:
        """Return a pattern for each axis."""
        return [_VALUE] * len(ids)

    def switches(self, ids: Sequence[str]) -> Sequence[str]:
        """Return a pattern for each axis."""
        return [r"([01])\n"] * len(ids)

    def axes(self) -> str:
        """Return the pattern of letters in a row."""
        return r"([A-Z]{1,16})\n"

    def axes_in(self, told: str) -> Sequence[str]:
        """Return the letters."""
        return list(told)
