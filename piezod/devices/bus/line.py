"""A stream of bytes to a device, and what can go wrong on it."""

from typing import Protocol, runtime_checkable

from piezod.devices.status import DeviceFlag


class LineFault(Exception):  # noqa: N818 - a fault of the line, which a bus device turns into a value
    """Raised within a driver, and never beyond it, where an exchange has failed.

    Args:
        flag: What is told of it.
        what: What happened, for people.
    """

    def __init__(self, flag: DeviceFlag, what: str) -> None:
        super().__init__(what)
        self.flag = flag


class Line(Protocol):
    """A connection that carries bytes both ways; used by one thread at a time.

    It is the only thing in a driver that waits, and so the only one that looks at a clock.
    """

    @property
    def where(self) -> str:
        """Where it leads to, for people: a port or an address."""
        ...

    def open(self) -> None:
        """Connect.

        Raises:
            DeviceUnavailableError: If it is absent, held by somebody else, or cannot be reached.
        """
        ...

    def close(self) -> None:
        """Let go. Never raises; may be called at any time, any number of times."""
        ...

    def send(self, data: bytes) -> None:
        """Send all of this; may be called in the loop.

        Raises:
            LineFault: `PARTIAL_WRITE` if only a part went out in time: then nothing more may go
                out before it was opened again, and the dialogue's `open` has to end that part so
                that nobody obeys it. `DISCONNECTED` if it is gone.
        """
        ...

    def receive(self, within_ns: int) -> bytes:
        """Return what has come, as soon as something has; may be called in the loop.

        Args:
            within_ns: How long to wait for the first byte; 0: not at all.

        Returns:
            At least one byte, or nothing where none came in time.

        Raises:
            LineFault: `DISCONNECTED` if it is gone.
        """
        ...

    def now_ns(self) -> int:
        """Tell the instant on the line's own monotonic clock; may be called in the loop."""
        ...


@runtime_checkable
class NoticingLine(Protocol):
    """A line that also tells what is the matter with it where no exchange fails."""

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what was noticed since the last call, and forget it; may be called in the loop."""
        ...
