"""GCS 1 as text: the axis letter directly precedes the value, `SVA A12.5`; replies are bare."""

from collections.abc import Sequence
from typing import Final

_VALUE: Final = r" {0,8}([+-]?[0-9]{1,12}\.[0-9]{0,12}(?:[eE][+-]?[0-9]{1,3})?)\n"
"""A number with a decimal point, such as `+0000.0000`; a reply to `ERR?` has none."""


class Gcs1Syntax:
    """Implements `Syntax`; each axis has a line of its own in queries and settings."""

    bare = True

    def query(self, command: str, ids: Sequence[str]) -> bytes:
        """Return a query such as `POS? A`."""
        return "".join(f"{command} {axis}\n" for axis in ids).encode()

    def setting(self, command: str, ids: Sequence[str], values: Sequence[str]) -> bytes:
        """Return a setting such as `SVA A12.5`."""
        each = zip(ids, values, strict=True)
        return "".join(f"{command} {axis}{value}\n" for axis, value in each).encode()

    def numbers(self, ids: Sequence[str]) -> Sequence[str]:
        """Return a pattern for each axis."""
        return [_VALUE] * len(ids)

    def switches(self, ids: Sequence[str]) -> Sequence[str]:
        """Return a pattern for each axis."""
        return [r"([01])\n"] * len(ids)

    def axes(self) -> str:
        """Return the pattern of the letters in a row."""
        return r"([A-Z]{1,16})\n"

    def axes_in(self, reply: str) -> Sequence[str]:
        """Return the letters."""
        return list(reply)
