"""The clock of a rig in real time; it slows down if a device that plays cannot keep up."""

from collections.abc import Callable
from threading import Lock


class RigClock:
    """Real time, less the time that was lost.

    A device that plays computes every point of its table. On a busy machine that may take longer
    than the play; then this clock waits, so that neither the points nor what happens between them
    depend on the speed of the machine. Thread-safe.

    Args:
        now_ns: Real time.
    """

    def __init__(self, now_ns: Callable[[], int]) -> None:
        self._now_ns = now_ns
        self._lost_ns = 0
        self._limit_ns: int | None = None
        self._lock = Lock()

    def __call__(self) -> int:
        """Return the instant, in ns; it never decreases."""
        with self._lock:
            t_ns = self._now_ns() - self._lost_ns
            if self._limit_ns is not None and t_ns > self._limit_ns:
                self._lost_ns += t_ns - self._limit_ns
                t_ns = self._limit_ns
            return t_ns

    def wait_at(self, limit_ns: int | None) -> None:
        """Do not go on beyond this instant, until there is another one; None for no limit."""
        with self._lock:
            self._limit_ns = limit_ns
