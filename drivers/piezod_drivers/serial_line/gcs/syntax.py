"""The interface to the text format of a generation: requests and patterns of replies."""

from collections.abc import Sequence
from typing import Final, Protocol

NUMBER: Final = r" {0,8}([+-]?[0-9]{1,12}(?:\.[0-9]{0,12})?(?:[eE][+-]?[0-9]{1,3})?)"
ASK_ERROR: Final = b"ERR?\n"


class Syntax(Protocol):
    """How a generation writes requests and replies. Pure. Real-time safe."""

    bare: bool  #: Whether the reply to the query of a switch looks like the reply to `ERR?`.

    def query(self, command: str, ids: Sequence[str]) -> bytes:
        """Return the query of some axes, such as `POS?` for 1 and 2."""
        ...

    def setting(self, command: str, ids: Sequence[str], values: Sequence[str]) -> bytes:
        """Return the command that sets some axes."""
        ...

    def numbers(self, ids: Sequence[str]) -> Sequence[str]:
        """Return the patterns of the replies to a query of numbers."""
        ...

    def switches(self, ids: Sequence[str]) -> Sequence[str]:
        """Return the patterns of the replies to a query of values that are 0 or 1."""
        ...

    def axes(self) -> str:
        """Return the pattern of the reply to `SAI?`, with one group."""
        ...

    def axes_in(self, reply: str) -> Sequence[str]:
        """Return the axes in this group."""
        ...


def volts(values: Sequence[float]) -> list[str]:
    """Return voltages as text with steps of 0.1 mV, finer than any converter of these devices."""
    return [f"{value:.4f}" for value in values]
