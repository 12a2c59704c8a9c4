"""Removes the NULs that the A models send behind some of their prompts."""

from piezod.devices.bus.line import Line, NoticingLine
from piezod.devices.status import DeviceFlag


class NulFreeLine:
    """Implements `Line` and `NoticingLine`; drops NULs, which mean nothing in this protocol.

    Args:
        line: The line to the amplifier.
    """

    def __init__(self, line: Line) -> None:
        self._line = line

    @property
    def where(self) -> str:
        """Port of the line."""
        return self._line.where

    def open(self) -> None:
        """Connect, as the line does."""
        self._line.open()

    def close(self) -> None:
        """Disconnect. Never raises."""
        self._line.close()

    def send(self, data: bytes) -> None:
        """Send all bytes, as the line does. Real-time safe."""
        self._line.send(data)

    def receive(self, within_ns: int) -> bytes:
        """Return the received bytes without NULs, as the line does. Real-time safe."""
        end_ns = self._line.now_ns() + within_ns
        while got := self._line.receive(within_ns):
            if kept := got.replace(b"\0", b""):
                return kept
            within_ns = max(0, end_ns - self._line.now_ns())
        return b""

    def now_ns(self) -> int:
        """Return the instant, as the line does. Real-time safe."""
        return self._line.now_ns()

    def take_noticed(self) -> set[DeviceFlag]:
        """Return and clear the flags that the line has noticed. Real-time safe."""
        return self._line.take_noticed() if isinstance(self._line, NoticingLine) else set()
