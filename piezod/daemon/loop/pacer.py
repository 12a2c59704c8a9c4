"""Keeps the period: absolute deadlines, sleep until shortly before one, spin the rest."""

from typing import NamedTuple

from piezod.daemon.clock import Clock


class Tick(NamedTuple):
    """The beginning of a cycle.

    Attributes:
        deadline_ns: When it was to begin.
        late_ns: How long after that it began.
        skipped: Whole periods skipped just before it.
    """

    deadline_ns: int
    late_ns: int
    skipped: int


class Pacer:
    """Gives a cycle its turn, period by period.

    A cycle that comes late by less than a period runs at once. Where it is later, the periods that
    are over are skipped and counted: there is no burst to catch up.

    Args:
        clock: The clock.
        period_ns: The period.
        spin_ns: How long before the deadline sleeping ends: a sleeper wakes up some 10 µs late.
    """

    def __init__(self, clock: Clock, period_ns: int, spin_ns: int) -> None:
        self._now_ns, self._sleep_until_ns = clock.now_ns, clock.sleep_until_ns
        self._period_ns, self._spin_ns = period_ns, spin_ns
        self._deadline_ns = self._now_ns()

    def wait(self) -> Tick:
        """Return when the next cycle is to begin; may be called in the loop."""
        deadline_ns = self._deadline_ns + self._period_ns
        now_ns = self._now_ns()
        skipped = max(now_ns - deadline_ns, 0) // self._period_ns
        deadline_ns += skipped * self._period_ns
        if now_ns < deadline_ns - self._spin_ns:
            self._sleep_until_ns(deadline_ns - self._spin_ns)
            now_ns = self._now_ns()
        while now_ns < deadline_ns:
            now_ns = self._now_ns()
        overslept = (now_ns - deadline_ns) // self._period_ns
        deadline_ns += overslept * self._period_ns
        self._deadline_ns = deadline_ns
        return Tick(deadline_ns, now_ns - deadline_ns, skipped + overslept)
