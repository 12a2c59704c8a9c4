"""What a driver of a device on a wire says to it."""

from collections.abc import Sequence
from typing import Protocol, TypeAlias

from piezod.devices.interface import Capabilities, Identity
from piezod.devices.status import DeviceFlag, Flags

Reading: TypeAlias = tuple[int, Sequence[float]]
"""An instant, and what each input read then in its unit; NaN where it may not be used."""


class Dialogue(Protocol):
    """The exchanges with one device; a `BusDevice` calls them in the right order, one at a time.

    `open`, `activate`, `deactivate`, `sample`, `put`, `in_force` and `exchange` raise `LineFault`
    where an exchange fails, and leave it to the bus device what becomes of that; the others
    exchange nothing. None checks what the bus device checks: order, numbers, ranges.
    """

    def open(self) -> Identity:
        """Connect, ask who is there, and ask for what `capabilities` and `ranges` tell.

        Outputs stay as they are.

        Raises:
            DeviceUnavailableError: If nobody is there, or nobody answers.
            DeviceError: If it answers something that its protocol does not allow.
            LineFault: If an exchange fails.
        """
        ...

    def close(self) -> None:
        """Let go of the line; outputs stay as they are. Never raises."""
        ...

    def capabilities(self) -> Capabilities:
        """Tell what the device can do; after `open`."""
        ...

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Tell the lowest and the highest value that each output can be set to; after `open`."""
        ...

    def activate(self) -> None:
        """Take control of the outputs, where they are: remote control, open loop, watchdog."""
        ...

    def deactivate(self) -> None:
        """Give control back; outputs come to rest, or hold where `Capabilities.holds`.

        Those that come to rest are to do so without an `activate` before, too.
        """
        ...

    def sample(self, now_ns: int) -> Reading:
        """Read every input; may be called in the loop.

        Returns:
            `now_ns`, or an earlier instant where the device sends samples by itself.
        """
        ...

    def put(self, values: Sequence[float]) -> None:
        """Set every output; returns when the device has taken it; may be called in the loop."""
        ...

    def in_force(self, now_ns: int) -> Sequence[float]:
        """Tell what is in force on each output; may be called in the loop.

        What was told in an exchange of this very instant need not be asked for again. Where
        `Capabilities.read_back` is false, it is never called.
        """
        ...

    def flags(self) -> Sequence[Flags]:
        """Tell what the device has said of each channel, inputs first; call it in the loop."""
        ...

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong on the line without making an exchange fail; and forget it."""
        ...


class ExchangingDialogue(Dialogue, Protocol):
    """One that can set and read in one exchange."""

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        """Set every output and read every input, in one exchange; may be called in the loop."""
        ...
