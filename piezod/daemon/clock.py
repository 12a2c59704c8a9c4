"""The clock of the daemon; everything below gets time as an argument."""

import time
from collections.abc import Callable
from typing import Final, Protocol

from piezod.units import NS_PER_S

_BOOTTIME: Final = time.CLOCK_BOOTTIME


class Clock(Protocol):
    """A clock that never goes back, and a sleep by it."""

    @property
    def now_ns(self) -> Callable[[], int]:
        """Function that returns the present instant; not a method, so that a call costs less."""
        ...

    def sleep_until_ns(self, t_ns: int) -> None:
        """Sleep until an instant; return at once if it has passed."""
        ...


class MonotonicClock:
    """CLOCK_MONOTONIC of the machine."""

    def __init__(self) -> None:
        self.now_ns: Callable[[], int] = time.monotonic_ns
        """Function that returns the present instant."""

    def sleep_until_ns(self, t_ns: int) -> None:
        """Sleep until an instant; return at once if it has passed.

        Since Python 3.11 `time.sleep` sleeps until an absolute deadline, also after signals:
        nothing more exact is needed.
        """
        left_ns = t_ns - time.monotonic_ns()
        if left_ns > 0:
            time.sleep(left_ns / NS_PER_S)


def clock_offsets_ns() -> tuple[int, int]:
    """Return CLOCK_REALTIME and CLOCK_BOOTTIME minus CLOCK_MONOTONIC, in ns. Real-time safe."""
    monotonic_ns = time.monotonic_ns()
    wall_ns, boot_ns = time.time_ns(), time.clock_gettime_ns(_BOOTTIME)
    return wall_ns - monotonic_ns, boot_ns - monotonic_ns
