"""The watchdog of an emulated device."""

from collections.abc import Callable

from piezod.units import NS_PER_S

OFF, RUNNING, TRIPPED = 0, 1, 2


class Watchdog:
    """Trips after a time without requests.

    Args:
        now_ns: The clock.
        timeout_s: Returns the time-out, in s.
        on_trip: Called when it trips.
    """

    def __init__(
        self, now_ns: Callable[[], int], timeout_s: Callable[[], float], on_trip: Callable[[], None]
    ) -> None:
        self._now_ns, self._timeout_s, self._on_trip = now_ns, timeout_s, on_trip
        self._requested_ns = 0
        self.state = OFF

    def start(self) -> None:
        """Arm it."""
        self._requested_ns, self.state = self._now_ns(), RUNNING

    def stop(self) -> None:
        """Disarm it."""
        self.state = OFF

    def update(self, asked: bool) -> None:
        """Let time pass.

        Args:
            asked: Whether a request has come.
        """
        now_ns = self._now_ns()
        if self.state == RUNNING and now_ns - self._requested_ns > self._timeout_s() * NS_PER_S:
            self.state = TRIPPED
            self._on_trip()
        # After the check: a request that comes too late does not prevent the trip.
        if asked:
            self._requested_ns = now_ns
