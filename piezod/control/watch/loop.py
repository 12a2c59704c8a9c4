"""Watches the loop itself: cycles that were missed, clocks that jumped.

Detects L1, L2, L4, L5 and L7. Counted is in periods that were lost, by skipping or by a cycle that
took longer than its period.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from piezod.config.faults import Fault
from piezod.control.faults.register import Detection
from piezod.control.signals import LeakyBucket
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
        self._late_ns = round(LATE_PART * period_ns)
        cycles = max(round(WINDOW_S * NS_PER_S / period_ns), LEAST_WINDOW_CYCLES)
        self._lost, self._late = _Share(cycles), _Share(cycles)
        self._overruns = LeakyBucket()
        self._clocks: tuple[int, int] | None = None

    def check(self, timing: CycleTiming) -> Sequence[Detection]:
        """Return what is wrong with the loop in this cycle; call it first in each cycle.

        Measured and limit are periods for L1 and for a gap (L2, L5), a share of the periods for L2
        and L7 where it lasts, and s for L4 and a suspended machine (L5).
        """
        lost = max(timing.skipped, timing.busy_ns // self._period_ns)
        late = lost > 0 or timing.late_ns > self._late_ns
        lost_share = self._lost.add(lost)
        late_share = self._late.add(max(lost, 1) if late else 0)
        tripped = self._overruns.update(lost > 0)
        jumps = self._jumps(timing)
        if not (lost or tripped or jumps or late_share > LATE_SHARE):
            return _NOTHING
        found = list(jumps)
        if lost:
            found.append(Detection(Fault.L1, measured=lost, limit=0.0))
        if timing.skipped >= PAUSE_PERIODS:
            found.append(Detection(Fault.L5, measured=timing.skipped, limit=PAUSE_PERIODS))
        if timing.skipped >= LONG_GAP_PERIODS:
            found.append(Detection(Fault.L2, measured=timing.skipped, limit=LONG_GAP_PERIODS))
        elif tripped or lost_share > LOST_SHARE:
            found.append(Detection(Fault.L2, measured=lost_share, limit=LOST_SHARE))
        if late_share > LATE_SHARE:
            found.append(Detection(Fault.L7, measured=late_share, limit=LATE_SHARE))
        return found

    def _jumps(self, timing: CycleTiming) -> Sequence[Detection]:
        before, now = self._clocks, (timing.wall_offset_ns, timing.boot_offset_ns)
        if before == now:
            return _NOTHING
        self._clocks = now
        if before is None:
            return _NOTHING
        found = []
        wall_ns, boot_ns = abs(now[0] - before[0]), now[1] - before[1]
        # A machine that wakes up finds its wall clock ahead by as long as it slept: that is L5.
        if boot_ns > SUSPENDED_NS:
            found.append(_in_seconds(Fault.L5, boot_ns, SUSPENDED_NS))
        elif wall_ns > WALL_CLOCK_JUMP_NS:
            found.append(_in_seconds(Fault.L4, wall_ns, WALL_CLOCK_JUMP_NS))
        return found


def _in_seconds(fault: Fault, measured_ns: int, limit_ns: int) -> Detection:
    return Detection(fault, measured=measured_ns / NS_PER_S, limit=limit_ns / NS_PER_S)


class _Share:
    """How large a part of the last periods was bad, over a window that slides by parts.

    Args:
        cycles: Length of the window.
    """

    def __init__(self, cycles: int) -> None:
        self._part_cycles = max(cycles // _PARTS, 1)
        self._cycles = self._part_cycles * _PARTS
        self._parts = [0] * _PARTS
        self._part = self._filled = self._sum = 0

    def add(self, bad: int) -> float:
        """Take the bad periods of this cycle; return their share of the window's length."""
        if self._filled == self._part_cycles:
            self._part = (self._part + 1) % _PARTS
            self._sum -= self._parts[self._part]
            self._parts[self._part] = self._filled = 0
        self._filled += 1
        if bad:
            self._parts[self._part] += bad
            self._sum += bad
        return self._sum / self._cycles
