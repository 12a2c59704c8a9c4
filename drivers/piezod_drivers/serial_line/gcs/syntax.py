"""What differs between the generations: how requests are written and replies look."""

from collections.abc import Sequence
from typing import Final, Protocol

NUMBER: Final = r" {0,8}([+-]?[0-9]{1,12}(?:\.[0-9]{0,12})?(?:[eE][+-]?[0-9]{1,3})?)"
ASK_ERROR: Final = b"ERR?\n"


class Syntax(Protocol):
    """Pure; every method may be called in the loop.

    Attributes:
        bare: Whether the reply to a query of a switch looks like that to `ERR?`.
    """

    bare: bool

    def query(self, command: str, ids: Sequence[str]) -> bytes:
        """Return the request for something of some axes, as POS? of 1 and 2."""
        ...

    def setting(self, command: str, ids: Sequence[str], values: Sequence[str]) -> bytes:
        """Return the request that sets something of some axes."""
        ...

    def numbers(self, ids: Sequence[str]) -> Sequence[str]:
        """Return the patterns of the replies to a query of measured values."""
        ...

    def switches(self, ids: Sequence[str]) -> Sequence[str]:
        """Return the patterns of the replies to a query of what is 0 or 1."""
        ...

    def axes(self) -> str:
        """Return the pattern of the reply to `SAI?`, with one group."""
        ...

    def axes_in(self, told: str) -> Sequence[str]:
        """Return the axes in that group."""
        ...


def volts(values: Sequence[float]) -> list[str]:
    """Write voltages with steps of 0.1 mV, finer than any converter here."""
    return [f"{value:.4f}" for value in values]
