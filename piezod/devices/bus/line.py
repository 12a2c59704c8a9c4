"""A byte stream to a device, and its faults."""

from typing import Protocol, runtime_checkable

from piezod.devices.status import DeviceFlag


class LineFault(Exception):  # noqa: N818 - a fault of the line, which a bus device turns into a value
    """Raised inside a driver if an exchange has failed; it never leaves the driver.

    Args:
        flag: Flag to report for it.
        what: Description for people.
    """

    def __init__(self, flag: DeviceFlag, what: str) -> None:
        super().__init__(what)
        self.flag = flag


class Line(Protocol):
    """A connection that carries bytes in both directions; used by one thread at a time.

    It is the only part of a driver that waits, and so the only part that reads a clock.
    """

    @property
    def where(self) -> str:
        """Port or address, for people."""
        ...

    def open(self) -> None:
        """Connect.

        Raises:
            DeviceUnavailableError: If it is absent, held by another program, or cannot be reached.
        """
        ...

    def close(self) -> None:
        """Disconnect. Never raises; may be called at any time, any number of times."""
        ...

    def send(self, data: bytes) -> None:
        """Send all bytes. Real-time safe.

        Raises:
            LineFault: `PARTIAL_WRITE` if only a part was sent in time. Nothing more may be sent
                before the line is opened again, and `open` of the dialogue must end that part so
                that no device acts on it. `DISCONNECTED` if the line is lost.
        """
        ...

    def receive(self, within_ns: int) -> bytes:
        """Return the received bytes, as soon as there are any. Real-time safe.

        Args:
            within_ns: How long to wait for the first byte, in ns; 0 for no wait.

        Returns:
            At least one byte, or nothing if none came in time.

        Raises:
            LineFault: `DISCONNECTED` if the line is lost.
        """
        ...

    def now_ns(self) -> int:
        """Return the time of the line's monotonic clock, in ns. Real-time safe."""
        ...


@runtime_checkable
class NoticingLine(Protocol):
    """A line that also reports faults that did not make an exchange fail."""

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the faults since the last call. Real-time safe."""
        ...


class LineWrapper:
    """Implements `Line` and `NoticingLine` by another line, except what a subclass changes."""

    def __init__(self, line: Line) -> None:
        self._line = line

    @property
    def where(self) -> str:
        """Port or address, for people."""
        return self._line.where

    def open(self) -> None:
        """Connect."""
        self._line.open()

    def close(self) -> None:
        """Disconnect. Never raises."""
        self._line.close()

    def send(self, data: bytes) -> None:
        """Send all bytes. Real-time safe."""
        self._line.send(data)

    def receive(self, within_ns: int) -> bytes:
        """Return the received bytes. Real-time safe."""
        return self._line.receive(within_ns)

    def now_ns(self) -> int:
        """Return the instant, in ns. Real-time safe."""
        return self._line.now_ns()

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the faults that the other line has noticed. Real-time safe."""
        return self._line.take_noticed() if isinstance(self._line, NoticingLine) else set()
