"""The clock of the loop: the only one there is below the supervisor."""

import time
from collections.abc import Callable
from typing import Protocol

from piezod.units import NS_PER_S


class Clock(Protocol):
    """A clock that never goes back, and sleeping by it."""

    @property
    def now_ns(self) -> Callable[[], int]:
        """The function that tells the instant; in the loop it is called without a detour."""
        ...

    def sleep_until_ns(self, t_ns: int) -> None:
        """Sleep until an instant; return at once where it is past."""
        ...


class MonotonicClock:
    """CLOCK_MONOTONIC of the machine."""

    now_ns = staticmethod(time.monotonic_ns)

    def sleep_until_ns(self, t_ns: int) -> None:
        """Sleep until an instant; return at once where it is past.

        Since Python 3.11 `time.sleep` makes an absolute deadline of its argument and goes on after
        signals: no better primitive is needed.
        """
        left_ns = t_ns - time.monotonic_ns()
        if left_ns > 0:
            time.sleep(left_ns / NS_PER_S)


def clock_offsets_ns() -> tuple[int, int]:
    """Return how far CLOCK_REALTIME and CLOCK_BOOTTIME are ahead of CLOCK_MONOTONIC."""
    monotonic_ns = time.monotonic_ns()
    wall_ns, boot_ns = time.time_ns(), time.clock_gettime_ns(time.CLOCK_BOOTTIME)
    return wall_ns - monotonic_ns, boot_ns - monotonic_ns
