"""The interface of a bus that carries CAN frames."""

from collections.abc import Iterable
from typing import Protocol

from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.frame import Frame


class FrameBus(Protocol):
    """A CAN bus, used by one thread at a time.

    In a driver only the bus waits, so only the bus reads a clock.
    """

    @property
    def where(self) -> str:
        """Interface and channel of the bus, for messages to people."""
        ...

    def open(self, accepted: Iterable[int]) -> None:
        """Connect, with empty queues: a frame of an earlier connection is never sent.

        Args:
            accepted: Identifiers to be read; a bus that can filter does not pass on others.

        Raises:
            DeviceUnavailableError: If the bus is absent, or an old queue cannot be emptied.
        """
        ...

    def close(self) -> None:
        """Disconnect. Never raises; may be called at any time, any number of times."""
        ...

    def send(self, frame: Frame) -> None:
        """Hand a frame to the controller, without waiting. Real-time safe.

        Raises:
            LineFault: `NOT_SENT` if its queue is full, `BUS_OFF` if it has left the bus,
                `DISCONNECTED` if the connection is lost.
        """
        ...

    def receive(self, within_ns: int) -> Frame | None:
        """Return the next frame that this end has not sent itself. Real-time safe.

        Args:
            within_ns: Longest wait, in ns; 0 for no wait.

        Returns:
            A frame, whose identifier need not be an accepted one; None if none came in time.

        Raises:
            LineFault: `BUS_OFF` or `DISCONNECTED`.
        """
        ...

    def mark_stalled(self) -> None:
        """Note that frames do not leave the queue; the next `open` discards them."""
        ...

    def now_ns(self) -> int:
        """Return the instant on the bus's own monotonic clock. Real-time safe."""
        ...

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the flags of faults that no call has raised. Real-time safe."""
        ...
