"""Watches the loop itself: missed cycles, and clocks that jump.

Detects L1, L2, L4, L5 and L7. The unit is the lost period: a period was skipped, or a cycle took
longer than its period.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from piezod.config.faults import Fault
from piezod.control.faults.register import Detection
from piezod.control.signals import LeakyBucket
from piezod.units import NS_PER_S

LONG_GAP_PERIODS: Final = 5
"""Periods skipped at once from which on L2 is reported: the planned motion no longer holds."""
PAUSE_PERIODS: Final = 20
"""Periods skipped at once from which on L5 is reported: the process or the machine stood still."""
SUSPENDED_NS: Final = NS_PER_S // 10
"""The machine was suspended if BOOTTIME gains this much on MONOTONIC between two cycles."""
WALL_CLOCK_JUMP_NS: Final = NS_PER_S // 2
"""The wall clock was set if REALTIME moves this much against MONOTONIC between two cycles."""
WINDOW_S, MIN_WINDOW_CYCLES = 10.0, 1000
"""Shares of lost and late periods are taken over the longer of the two."""
LATE_PART: Final = 0.5
"""A cycle is late if it begins later than this share of its period after its deadline."""
LATE_SHARE, LOST_SHARE = 0.01, 0.05
"""Largest shares of late and of lost periods: more is L7, and L2."""

_PARTS = 20  # the window slides by a twentieth of its length
_NOTHING: Final[Sequence[Detection]] = ()


class CycleTiming(NamedTuple):
    """Timing of one cycle, reported by the loop, which has the clocks.

    Attributes:
        late_ns: Time from the deadline to the begin of the cycle, in ns.
        skipped: Whole periods skipped just before the cycle.
        busy_ns: Duration of the cycle before, in ns.
        wall_offset_ns: CLOCK_REALTIME minus CLOCK_MONOTONIC, in ns.
        boot_offset_ns: CLOCK_BOOTTIME minus CLOCK_MONOTONIC, in ns.
    """

    late_ns: int
    skipped: int
    busy_ns: int
    wall_offset_ns: int
    boot_offset_ns: int


class LoopWatch:
    """Watches one loop. Fixed memory. Real-time safe.

    Args:
        period_ns: Period of the loop, in ns.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._late_ns = round(LATE_PART * period_ns)
        cycles = max(round(WINDOW_S * NS_PER_S / period_ns), MIN_WINDOW_CYCLES)
        # The window has a fixed number of cycles, so that its cost does not depend on the rate.
        self._lost, self._late = _Share(cycles), _Share(cycles)
        self._overruns = LeakyBucket()
        self._clocks: tuple[int, int] | None = None

    def check(self, timing: CycleTiming) -> Sequence[Detection]:
        """Return the faults of the loop in this cycle. Call once per cycle, first.

        `measured` and `limit` are periods for L1 and for a gap (L2, L5). They are shares of the
        periods for L2 and L7 over the window, and seconds for L4 and for a suspended machine (L5).
        """
        # A cycle that overran loses periods even if none was skipped yet.
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
        """Return the faults of clocks that jumped since the cycle before."""
        before, now = self._clocks, (timing.wall_offset_ns, timing.boot_offset_ns)
        if before == now:
            return _NOTHING
        self._clocks = now
        if before is None:
            return _NOTHING
        found = []
        wall_ns, boot_ns = abs(now[0] - before[0]), now[1] - before[1]
        # After a suspend the wall clock has jumped by the length of the sleep. That is L5 only.
        if boot_ns > SUSPENDED_NS:
            found.append(_in_seconds(Fault.L5, boot_ns, SUSPENDED_NS))
        elif wall_ns > WALL_CLOCK_JUMP_NS:
            found.append(_in_seconds(Fault.L4, wall_ns, WALL_CLOCK_JUMP_NS))
        return found


def _in_seconds(fault: Fault, measured_ns: int, limit_ns: int) -> Detection:
    return Detection(fault, measured=measured_ns / NS_PER_S, limit=limit_ns / NS_PER_S)


class _Share:
    """Share of bad periods among the last ones, over a window that slides by parts.

    Args:
        cycles: Length of the window, in cycles.
    """

    def __init__(self, cycles: int) -> None:
        self._part_cycles = max(cycles // _PARTS, 1)
        self._cycles = self._part_cycles * _PARTS
        self._parts = [0] * _PARTS
        self._part = self._filled = self._sum = 0

    def add(self, bad: int) -> float:
        """Take the bad periods of this cycle; return their share of the window."""
        if self._filled == self._part_cycles:
            self._part = (self._part + 1) % _PARTS
            self._sum -= self._parts[self._part]
            self._parts[self._part] = self._filled = 0
        self._filled += 1
        if bad:
            self._parts[self._part] += bad
            self._sum += bad
        return self._sum / self._cycles
