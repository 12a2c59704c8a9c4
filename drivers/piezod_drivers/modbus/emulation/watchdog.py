"""The watchdog of an emulated device."""

from collections.abc import Callable

from piezod.units import NS_PER_S

OFF, RUNNING, TRIPPED = 0, 1, 2


class Watchdog:
    """Trips when nobody has asked for too long.

    Args:
        now_ns: The clock.
        timeout_s: Tells after how long, in s.
        trips: Called when it does.
    """

    def __init__(
        self, now_ns: Callable[[], int], timeout_s: Callable[[], float], trips: Callable[[], None]
    ) -> None:
        self._now_ns, self._timeout_s, self._trips = now_ns, timeout_s, trips
        self._heard_ns = 0
        self.state = OFF

    def start(self) -> None:
        """Arm it."""
        self._heard_ns, self.state = self._now_ns(), RUNNING

    def stop(self) -> None:
        """Disarm it."""
        self.state = OFF

    def heard(self, asked: bool) -> None:
        """Let time pass; somebody has asked, or not."""
        now_ns = self._now_ns()
        if self.state == RUNNING and now_ns - self._heard_ns > self._timeout_s() * NS_PER_S:
            self.state = TRIPPED
            self._trips()
        if asked:
            self._heard_ns = now_ns
