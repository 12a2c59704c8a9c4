"""The exchanges of a play, as a driver of a device on a wire implements them."""

from collections.abc import Sequence
from typing import Protocol

from piezod.devices.bus.dialogue import Reading
from piezod.devices.player import Check, PlayedRecord, PlayerCapabilities, Progress, Table


class PlayDialogue(Protocol):
    """The exchanges of a play; a `PlayingBusDevice` calls them in the right order, one at a time.

    All methods but `close` raise `LineFault` if an exchange fails; those outside of the loop also
    `DeviceError` if the device refuses.
    """

    def capabilities(self) -> PlayerCapabilities:
        """Return the capabilities; may ask the device."""
        ...

    def load(self, table: Table, check: Check) -> Table:
        """Load a checked table; return it as the device will play it.

        Calls `check` between two exchanges; what it raises ends the loading.
        """
        ...

    def arm(self) -> None:
        """Prepare the start."""
        ...

    def start(self) -> None:
        """Start the play and the record."""
        ...

    def progress(self, now_ns: int) -> Progress:
        """Return the progress of a play that was started. Real-time safe."""
        ...

    def stop(self) -> Sequence[float]:
        """Stop a play, if one is going on; return the value in force of each output.

        Real-time safe.
        """
        ...

    def recording(self, check: Check) -> PlayedRecord:
        """Return the record of the play that has ended.

        Calls `check` between two exchanges; what it raises ends the reading.
        """
        ...

    def sample(self, now_ns: int) -> Reading:
        """Return the newest sample of each input during a play. Real-time safe."""
        ...

    def in_force(self, now_ns: int) -> Sequence[float]:
        """Return the value of each output during a play. Real-time safe."""
        ...

    def close(self) -> None:
        """Release what only a play needs. Never raises."""
        ...
