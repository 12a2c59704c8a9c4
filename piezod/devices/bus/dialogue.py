"""The protocol of one device on a wire, as a driver implements it."""

from collections.abc import Sequence
from typing import Protocol, TypeAlias

from piezod.devices.interface import Capabilities, Identity
from piezod.devices.status import DeviceFlag, Flags

Reading: TypeAlias = tuple[int, Sequence[float]]
"""Instant and value of each input, in its unit; NaN for a value that must not be used."""


class Dialogue(Protocol):
    """The exchanges with one device; a `BusDevice` calls them in the right order, one at a time.

    `open`, `activate`, `deactivate`, `sample`, `put`, `in_force` and `exchange` raise `LineFault`
    if an exchange fails; the bus device handles it. The other methods exchange nothing. No method
    needs to check the order of calls, the number of values or their ranges: the bus device does.
    """

    def open(self) -> Identity:
        """Connect, ask for the identity, and for the data of `capabilities` and `ranges`.

        Outputs stay as they are.

        Raises:
            DeviceUnavailableError: If the device is absent or does not answer.
            DeviceError: If its answer violates its protocol.
            LineFault: If an exchange fails.
        """
        ...

    def close(self) -> None:
        """Release the line; outputs stay as they are. Never raises."""
        ...

    def capabilities(self) -> Capabilities:
        """Return the capabilities of the device; called after `open`."""
        ...

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Return the lowest and the highest value of each output; called after `open`."""
        ...

    def activate(self) -> None:
        """Take control of the outputs at their values: remote control, open loop, watchdog."""
        ...

    def deactivate(self) -> None:
        """Release control; outputs go to rest, or hold if `Capabilities.holds`.

        Outputs that go to rest must do so without an `activate` before, too.
        """
        ...

    def sample(self, now_ns: int) -> Reading:
        """Read every input. Real-time safe.

        Returns:
            The values with `now_ns`, or with an earlier instant if the device sends samples by
            itself.
        """
        ...

    def put(self, values: Sequence[float]) -> None:
        """Set every output; return when the device has accepted the values. Real-time safe."""
        ...

    def in_force(self, now_ns: int) -> Sequence[float]:
        """Return the value in force of each output. Real-time safe.

        A value that an exchange at this very instant reported need not be requested again. Never
        called if `Capabilities.read_back` is false.
        """
        ...

    def flags(self) -> Sequence[Flags]:
        """Return the reported flags of each channel, inputs first. Real-time safe."""
        ...

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the faults of the line that did not make an exchange fail."""
        ...


class ExchangingDialogue(Dialogue, Protocol):
    """A dialogue that can set and read in one exchange."""

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        """Set every output and read every input in one exchange. Real-time safe."""
        ...
