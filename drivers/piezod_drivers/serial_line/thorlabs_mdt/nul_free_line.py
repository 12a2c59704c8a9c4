"""Removes the NULs that the A models send behind some of their prompts."""

from piezod.devices.bus.line import LineWrapper


class NulFreeLine(LineWrapper):
    """A line that drops NULs, which mean nothing in this protocol."""

    def receive(self, within_ns: int) -> bytes:
        """Return the received bytes without NULs, as the line does. Real-time safe."""
        end_ns = self._line.now_ns() + within_ns
        while got := self._line.receive(within_ns):
            if kept := got.replace(b"\0", b""):
                return kept
            within_ns = max(0, end_ns - self._line.now_ns())
        return b""
