"""What an emulated device has answered and what is still on its way, faults included."""

from collections import deque
from collections.abc import Sequence

from piezod.devices.emulation.faults import FaultKind, Faults, Hit

_MOST_REPLIES = 4096
"""More than this on their way is a fault that nobody meant; the oldest are dropped."""


class Outbox:
    """Replies in their order, each with the instant from which it can be sent.

    Args:
        faults: Draws what is random.
    """

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self._waiting: deque[tuple[int, bytes]] = deque(maxlen=_MOST_REPLIES)

    def put(self, reply: bytes, hits: Sequence[Hit], now_ns: int) -> None:
        """Add a reply, with what befalls it."""
        due_ns, copies = now_ns, 1
        for kind, value in hits:
            match kind:
                case FaultKind.LATE:
                    due_ns += round((value or 0.0) * 1e9)
                case FaultKind.LOST:
                    copies = 0
                case FaultKind.DUPLICATED:
                    copies *= 2
                case FaultKind.GARBLED:
                    reply = self._garbled(reply, value)
                case FaultKind.PARTIAL:
                    reply = reply[: len(reply) // 2 if value is None else int(value)]
                case FaultKind.NOISE:
                    reply = self._faults.random_bytes(int(value or 0)) + reply
                case _:
                    pass  # befalls the device, not a reply
        self._waiting.extend([(due_ns, reply)] * copies)

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

    def _garbled(self, reply: bytes, bit: float | None) -> bytes:
        n_bits = 8 * len(reply)
        if not n_bits:
            return reply
        place = self._faults.random_below(n_bits) if bit is None else int(bit) % n_bits
        flipped = bytearray(reply)
        flipped[place // 8] ^= 1 << place % 8
        return bytes(flipped)
