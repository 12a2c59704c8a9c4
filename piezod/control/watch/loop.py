"""Watches the loop itself: missed cycles, and clocks that jump.

Detects L1, L2, L4, L5 and L7. A period is lost if it was skipped, or if a cycle took longer than
its period. While a period is lost, the amplifier holds its voltage and nothing is damaged: a stall
is counted, and only lateness that lasts holds the stage. With `strict_rt` a stall holds it, too.
"""

from collections.abc import Sequence
from typing import Final

from piezod.config.faults import Fault
from piezod.control.faults.cases import Case
from piezod.control.faults.detection import Detection
from piezod.control.signals import LeakyBucket
from piezod.units import NS_PER_S

WINDOW_S: Final = 5.0
"""Shares of late cycles are taken over this time."""
LASTING_SHARE, PUNCTUAL_SHARE = 0.1, 0.05
"""L2 begins if a larger share of the cycles loses periods than the first number. It ends below the
second one."""
PAUSE_S, PAUSE_PERIODS = 1.0, 5
"""A gap of at least this time, and of at least this number of periods, is L5: the machine or the
process was suspended."""
SUSPENDED_NS: Final = NS_PER_S // 10
"""The machine was suspended if BOOTTIME gains this much on MONOTONIC between two cycles."""
WALL_CLOCK_JUMP_NS: Final = NS_PER_S // 2
"""The wall clock was set if REALTIME moves this much against MONOTONIC between two cycles."""
LATE_PART: Final = 0.5
"""A cycle begins late if this share of its period has passed since its deadline."""
LATE_SHARE, SELDOM_SHARE = 0.01, 0.005
"""L7 begins above the first share of cycles that begin late or lose periods, and ends below the
second."""

STRICT_GAP_PERIODS, STRICT_PAUSE_PERIODS = 5, 20
"""Periods skipped at once from which on L2 and L5 are reported with `strict_rt`."""
STRICT_WINDOW_S, STRICT_WINDOW_CYCLES = 10.0, 1000
"""With `strict_rt`, shares are taken over the longer of the two."""
STRICT_LOST_SHARE: Final = 0.05
"""Largest share of lost periods with `strict_rt`: more is L2."""

_PARTS = 20  # the window slides by a twentieth of its length
_NOTHING: Final[Sequence[Detection]] = ()


class CycleTiming:
    """Timing of one cycle, reported by the loop, which has the clocks.

    Args:
        late_ns: Time from the deadline to the begin of the cycle, in ns.
        skipped: Whole periods skipped just before the cycle.
        busy_ns: Duration of the cycle before, in ns.
        wall_offset_ns: CLOCK_REALTIME minus CLOCK_MONOTONIC, in ns.
        boot_offset_ns: CLOCK_BOOTTIME minus CLOCK_MONOTONIC, in ns.
    """

    __slots__ = ("boot_offset_ns", "busy_ns", "late_ns", "skipped", "wall_offset_ns")

    def __init__(
        self, late_ns: int, skipped: int, busy_ns: int, wall_offset_ns: int, boot_offset_ns: int
    ) -> None:
        self.late_ns, self.skipped, self.busy_ns = late_ns, skipped, busy_ns
        self.wall_offset_ns, self.boot_offset_ns = wall_offset_ns, boot_offset_ns


class LoopWatch:
    """Watches one loop. Fixed memory. Real-time safe.

    Args:
        period_ns: Period of the loop, in ns.
        strict: Whether a single stall is a fault, as `loop.strict_rt` requests.
    """

    def __init__(self, period_ns: int, *, strict: bool = False) -> None:
        self._period_ns = period_ns
        self._late_ns = round(LATE_PART * period_ns)
        self._judge = _Strict(period_ns) if strict else _Tolerant(period_ns)
        self._wall_offset_ns = self._boot_offset_ns = 0
        self._clocks_known = False

    def check(self, timing: CycleTiming) -> Sequence[Detection]:
        """Return the faults of the loop in this cycle. Call once per cycle, first.

        `measured` and `limit` are periods for L1 and for a gap (L2, L5). They are shares for L2 and
        L7 over the window, and seconds for L4 and for a suspended machine (L5).
        """
        # A cycle that overran loses periods even if none was skipped yet.
        skipped, busy_ns = timing.skipped, timing.busy_ns
        lost = skipped if busy_ns < self._period_ns else max(skipped, busy_ns // self._period_ns)
        late = lost > 0 or timing.late_ns > self._late_ns
        found = self._judge.check(skipped, lost, late=late)
        jumps = self._jumps(timing.wall_offset_ns, timing.boot_offset_ns)
        return [*jumps, *found] if jumps else found

    def _jumps(self, wall_offset_ns: int, boot_offset_ns: int) -> Sequence[Detection]:
        """Return the faults of clocks that jumped since the cycle before."""
        wall_ns = abs(wall_offset_ns - self._wall_offset_ns)
        boot_ns = boot_offset_ns - self._boot_offset_ns
        self._wall_offset_ns, self._boot_offset_ns = wall_offset_ns, boot_offset_ns
        if not self._clocks_known:
            self._clocks_known = True
            return _NOTHING
        # After a suspend the wall clock has jumped by the length of the sleep. That is L5 only.
        if boot_ns > SUSPENDED_NS:
            return [self._judge.suspended(boot_ns)]
        if wall_ns > WALL_CLOCK_JUMP_NS:
            return [_in_seconds(Fault.L4, wall_ns, WALL_CLOCK_JUMP_NS)]
        return _NOTHING


class _Tolerant:
    """Finds lateness that lasts. A late cycle counts once, however many periods it lost."""

    def __init__(self, period_ns: int) -> None:
        window = round(WINDOW_S * NS_PER_S / period_ns)
        self._lost, self._late = _Share(window), _Share(window)
        self._pause = max(round(PAUSE_S * NS_PER_S / period_ns), PAUSE_PERIODS)
        self._lasts = self._often = False

    def check(self, skipped: int, lost: int, *, late: bool) -> Sequence[Detection]:
        """Return the faults of this cycle."""
        lost_share = self._lost.add(1 if lost else 0, 1 + skipped)
        late_share = self._late.add(1 if late else 0, 1 + skipped)
        self._lasts = lost_share > (PUNCTUAL_SHARE if self._lasts else LASTING_SHARE)
        self._often = late_share > (SELDOM_SHARE if self._often else LATE_SHARE)
        if not (lost or self._often):
            return _NOTHING
        found = []
        if lost:
            found.append(Detection(Fault.L1, measured=lost, limit=0.0))
        if skipped >= self._pause:
            found.append(Detection(Fault.L5, measured=skipped, limit=self._pause))
        if self._lasts:
            found.append(Detection(Fault.L2, measured=lost_share, limit=LASTING_SHARE))
        if self._often:
            found.append(Detection(Fault.L7, measured=late_share, limit=LATE_SHARE))
        return found

    def suspended(self, boot_ns: int) -> Detection:
        """Return the fault of a machine that was suspended."""
        return _in_seconds(Fault.L5, boot_ns, SUSPENDED_NS)


class _Strict:
    """Finds each stall: several periods lost at once, cycles in a row, or many over time."""

    def __init__(self, period_ns: int) -> None:
        window = max(round(STRICT_WINDOW_S * NS_PER_S / period_ns), STRICT_WINDOW_CYCLES)
        self._lost, self._late = _Share(window), _Share(window)
        self._overruns = LeakyBucket()

    def check(self, skipped: int, lost: int, *, late: bool) -> Sequence[Detection]:
        """Return the faults of this cycle."""
        lost_share = self._lost.add(lost, 1)
        late_share = self._late.add(max(lost, 1) if late else 0, 1)
        tripped = self._overruns.update(lost > 0)
        if not (lost or tripped or late_share > LATE_SHARE):
            return _NOTHING
        found = []
        if lost:
            found.append(Detection(Fault.L1, measured=lost, limit=0.0))
        if skipped >= STRICT_PAUSE_PERIODS:
            found.append(_strict(Fault.L5, skipped, STRICT_PAUSE_PERIODS))
        if skipped >= STRICT_GAP_PERIODS:
            found.append(_strict(Fault.L2, skipped, STRICT_GAP_PERIODS))
        elif tripped or lost_share > STRICT_LOST_SHARE:
            found.append(_strict(Fault.L2, lost_share, STRICT_LOST_SHARE))
        if late_share > LATE_SHARE:
            found.append(_strict(Fault.L7, late_share, LATE_SHARE))
        return found

    def suspended(self, boot_ns: int) -> Detection:
        """Return the fault of a machine that was suspended."""
        return _in_seconds(Fault.L5, boot_ns, SUSPENDED_NS)._replace(case=Case.STRICT)


def _strict(fault: Fault, measured: float, limit: float) -> Detection:
    return Detection(fault, measured=measured, limit=limit, case=Case.STRICT)


def _in_seconds(fault: Fault, measured_ns: int, limit_ns: int) -> Detection:
    return Detection(fault, measured=measured_ns / NS_PER_S, limit=limit_ns / NS_PER_S)


class _Share:
    """Share of bad events among the cycles of a window, which slides by parts.

    Args:
        periods: Length of the window, in periods. Before the start all cycles were good.
    """

    def __init__(self, periods: int) -> None:
        self._part_periods = max(periods // _PARTS, 1)
        self._bad, self._cycles = [0] * _PARTS, [self._part_periods] * _PARTS
        self._part = self._bad_sum = 0
        self._filled, self._cycles_sum = self._part_periods, self._part_periods * _PARTS

    def add(self, bad: int, periods: int) -> float:
        """Take a cycle with its bad events; return their share of the cycles.

        Args:
            bad: Bad events of this cycle.
            periods: Periods since the cycle before.
        """
        if self._filled >= self._part_periods:
            self._begin_part()
        self._filled += periods
        self._bad[self._part] += bad
        self._cycles[self._part] += 1
        self._bad_sum += bad
        self._cycles_sum += 1
        return self._bad_sum / self._cycles_sum

    def _begin_part(self) -> None:
        """Replace the oldest part by a new one; after a gap the parts that it covers are empty."""
        ended, self._filled = divmod(self._filled, self._part_periods)
        for _ in range(min(ended, _PARTS)):
            self._part = (self._part + 1) % _PARTS
            self._bad_sum -= self._bad[self._part]
            self._cycles_sum -= self._cycles[self._part]
            self._bad[self._part] = self._cycles[self._part] = 0
