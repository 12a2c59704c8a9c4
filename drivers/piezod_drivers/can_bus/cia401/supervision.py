"""The host and a node supervise each other: heartbeats both ways, and the node's emergencies."""

from collections.abc import Callable
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.cia401 import objects
from piezod_drivers.can_bus.cia401.health import NodeHealth
from piezod_drivers.can_bus.cia401.options import Cia401Options
from piezod_drivers.can_bus.frame import Frame

MS: Final = 1_000_000
_HEARTBEATS_PER_TIMEOUT: Final = 4
"""Number of heartbeats that the host sends within the node's time-out."""
_MISSED_HEARTBEATS: Final = 3
"""A node counts as silent when this many of its heartbeats are missing."""


class Supervision:
    """Sends the host's heartbeats and keeps what the node reports by itself.

    Attributes:
        health: The state that the node reports.
        is_armed: Whether the node's watchdog is configured for this host.
    """

    def __init__(self, options: Cia401Options, now_ns: Callable[[], int]) -> None:
        self._node, self._now_ns = options.node, now_ns
        self._heartbeat_frame = Frame(
            objects.HEARTBEAT + options.host_node, bytes((objects.OPERATIONAL,))
        )
        self._period_ns = options.watchdog_ms * MS // _HEARTBEATS_PER_TIMEOUT
        self._longest_silence_ns = _MISSED_HEARTBEATS * options.heartbeat_ms * MS
        self._sent_ns = self._node_heard_ns = 0
        self._node_sends, self._is_running = False, False
        self.health = NodeHealth()
        self.is_armed = False

    def restart(self, *, is_armed: bool = False, node_sends: bool = False) -> None:
        """Forget what happened before the setup of the node.

        Args:
            is_armed: Whether the node's watchdog is configured for this host.
            node_sends: Whether the node sends heartbeats.
        """
        self.health.clear()
        self.is_armed, self._is_running = is_armed, False
        self._node_sends, self._node_heard_ns = node_sends, self._now_ns()

    def disarm(self) -> None:
        """Send no more heartbeats."""
        self.is_armed = self._is_running = False

    def start_watchdog(self) -> None:
        """Start the node's watchdog, if it is armed, with the next heartbeat. Real-time safe."""
        if self.is_armed and not self._is_running:
            self._is_running, self._sent_ns = True, 0

    def keep_alive(self, send: Callable[[Frame], None]) -> None:
        """Send a heartbeat if it is due, and check that the node keeps its setup. Real-time safe.

        Raises:
            LineFault: `DISCONNECTED` if the node has lost its setup, or any fault of `send`.
        """
        if self.health.needs_setup:
            what = (
                "the node has restarted, or its watchdog has tripped: it must be configured again"
            )
            raise LineFault(DeviceFlag.DISCONNECTED, what)
        if self._is_running:
            now_ns = self._now_ns()
            if now_ns - self._sent_ns >= self._period_ns:
                send(self._heartbeat_frame)
                self._sent_ns = now_ns

    def require_heartbeat(self) -> None:
        """Check that the node has sent a heartbeat lately, if it sends any. Real-time safe.

        Raises:
            LineFault: `LATE_REPLY` if it has not.
        """
        silent_ns = self._now_ns() - self._node_heard_ns
        if self._node_sends and silent_ns > self._longest_silence_ns:
            what = f"no heartbeat from the node for {silent_ns // MS} ms"
            raise LineFault(DeviceFlag.LATE_REPLY, what)

    def take_frame(self, frame: Frame) -> None:
        """Process a frame that answers no request. Real-time safe."""
        if not frame.is_plain:
            return
        if frame.id == objects.HEARTBEAT + self._node:
            self._node_heard_ns = self._now_ns()
            self.health.take_heartbeat(frame.data)
        elif frame.id == objects.EMERGENCY + self._node:
            self.health.take_emergency(frame.data)
