"""What an emulated device has answered and what is still on its way, faults included."""

from collections import deque
from collections.abc import Sequence
from typing import Final

from piezod.devices.emulation.faults import ActiveFault, WireFaults

MOST_REPLIES: Final = 4096
"""More than this on their way is a fault that nobody meant; the oldest are dropped."""


class Outbox:
    """Replies in their order, each with the instant from which it can be sent.

    Args:
        faults: Tells what becomes of them.
    """

    def __init__(self, faults: WireFaults) -> None:
        self._faults = faults
        self._waiting: deque[tuple[int, bytes]] = deque(maxlen=MOST_REPLIES)

    def put(self, reply: bytes, hits: Sequence[ActiveFault], now_ns: int) -> None:
        """Add a reply, with what befalls it."""
        late_ns, noise, copies = self._faults.fate(reply, hits)
        self._waiting.extend((now_ns + late_ns, part) for part in (noise, *copies) if part)

    def take(self, now_ns: int) -> bytes:
        """Return what is to be sent by now."""
        data = b""
        while self._waiting and self._waiting[0][0] <= now_ns:
            data += self._waiting.popleft()[1]
        return data

    def wait_ns(self, now_ns: int, at_most_ns: int) -> int:
        """Tell how long nothing is to be sent."""
        if not self._waiting:
            return at_most_ns
        return min(max(self._waiting[0][0] - now_ns, 0), at_most_ns)

    def clear(self) -> None:
        """Drop everything."""
        self._waiting.clear()
