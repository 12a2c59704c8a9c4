"""The heartbeat consumer of the emulated node, object 0x1016: it supervises the host."""

from typing import Final

from piezod_drivers.can_bus.cia401.emulation.sdo_server import AbortCode, AbortError

_MS: Final = 1_000_000
_TIME_MASK: Final = 0xFFFF


class HeartbeatConsumer:
    """Supervises one host, as strictly as the stack of a real node (canopen-stack 4.4).

    Supervision of a host ends only with the time 0 for this host. Another entry with the time 0 is
    accepted and ends nothing. Until then, a new time is refused, also after a time-out.
    """

    def __init__(self) -> None:
        self._host: int | None = None
        self._wait_ns = 0
        self._heard_ns: int | None = None

    def configure(self, entry: int) -> None:
        """Start or end the supervision.

        Args:
            entry: Node number of the host in bits 16 to 23, longest time in ms in bits 0 to 15.

        Raises:
            AbortError: If a host is already supervised.
        """
        host, wait_ms = entry >> 16 & 0xFF, entry & _TIME_MASK
        if wait_ms and self._host is not None:
            raise AbortError(AbortCode.INCOMPATIBLE)
        if wait_ms:
            self._host, self._wait_ns = host, wait_ms * _MS
        elif host == self._host:
            self._host = self._heard_ns = None

    def hear(self, node: int, now_ns: int) -> None:
        """Process a heartbeat of a node; the time runs from the first one of the host."""
        if node == self._host:
            self._heard_ns = now_ns

    def take_loss(self, now_ns: int) -> bool:
        """Return whether the host has just been lost; it is lost once until it is heard again."""
        is_lost = self._heard_ns is not None and now_ns - self._heard_ns > self._wait_ns
        if is_lost:
            self._heard_ns = None
        return is_lost
