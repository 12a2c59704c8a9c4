"""A connection that carries CAN frames, and what can go wrong on it."""

from collections.abc import Iterable
from typing import Protocol

from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.frame import Frame


class FrameBus(Protocol):
    """A CAN bus; used by one thread at a time.

    It is the only thing in a driver that waits, and so the only one that looks at a clock.
    """

    @property
    def where(self) -> str:
        """Which bus it is, for people: an interface and a channel."""
        ...

    def open(self, accepted: Iterable[int]) -> None:
        """Connect, with nothing in any queue: a frame of an earlier connection never leaves.

        Args:
            accepted: Identifiers that are read; where the bus can, others are not even passed on.

        Raises:
            DeviceUnavailableError: If it is absent, or an old queue cannot be emptied.
        """
        ...

    def close(self) -> None:
        """Let go. Never raises; may be called at any time, any number of times."""
        ...

    def send(self, frame: Frame) -> None:
        """Hand a frame to the controller, without waiting; may be called in the loop.

        Raises:
            LineFault: `NOT_SENT` if its queue is full, `BUS_OFF` if it has left the bus,
                `DISCONNECTED` if it is gone.
        """
        ...

    def receive(self, within_ns: int) -> Frame | None:
        """Return the next frame that this end has not sent itself; may be called in the loop.

        Args:
            within_ns: How long to wait for it; 0: not at all.

        Returns:
            A frame, not always one of the accepted identifiers; None if none came in time.

        Raises:
            LineFault: `BUS_OFF` or `DISCONNECTED`.
        """
        ...

    def stalled(self) -> None:
        """Be told that frames do not leave: `open` makes sure that they never do."""
        ...

    def now_ns(self) -> int:
        """Tell the instant on the bus's own monotonic clock; may be called in the loop."""
        ...

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making a call fail, since the last call."""
        ...
