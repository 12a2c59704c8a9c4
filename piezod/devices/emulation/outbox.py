"""Replies of an emulated device that are still to be sent, with their faults."""

from collections import deque
from collections.abc import Sequence
from typing import Final

from piezod.devices.emulation.faults import ActiveFault, WireFaults

MOST_REPLIES: Final = 4096
"""Largest number of unsent replies, reached only by a mistake; the oldest are dropped."""


class Outbox:
    """Replies in their order, each with the instant from which it can be sent.

    Args:
        faults: Determines their fate.
    """

    def __init__(self, faults: WireFaults) -> None:
        self._faults = faults
        self._waiting: deque[tuple[int, bytes]] = deque(maxlen=MOST_REPLIES)

    def put(self, reply: bytes, hits: Sequence[ActiveFault], now_ns: int) -> None:
        """Add a reply with the faults that affect it."""
        late_ns, noise, copies = self._faults.fate(reply, hits)
        self._waiting.extend((now_ns + late_ns, part) for part in (noise, *copies) if part)

    def take(self, now_ns: int) -> bytes:
        """Return the bytes that are due."""
        data = b""
        # Only the first one is looked at, so that a late reply also delays all later ones.
        while self._waiting and self._waiting[0][0] <= now_ns:
            data += self._waiting.popleft()[1]
        return data

    def wait_ns(self, now_ns: int, at_most_ns: int) -> int:
        """Return the time until the next bytes are due, in ns, up to a limit."""
        if not self._waiting:
            return at_most_ns
        return min(max(self._waiting[0][0] - now_ns, 0), at_most_ns)

    def clear(self) -> None:
        """Drop everything."""
        self._waiting.clear()
