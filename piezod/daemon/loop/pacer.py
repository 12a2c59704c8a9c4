"""Keeps the period: absolute deadlines; sleep until shortly before one, spin for the rest."""

from piezod.daemon.clock import Clock


class Tick:
    """The beginning of a cycle.

    Args:
        deadline_ns: Instant at which it should begin.
        late_ns: How long after the deadline it begins.
        skipped: Whole periods skipped just before it.
    """

    __slots__ = ("deadline_ns", "late_ns", "skipped")

    def __init__(self, deadline_ns: int, late_ns: int, skipped: int) -> None:
        self.deadline_ns, self.late_ns, self.skipped = deadline_ns, late_ns, skipped


class Pacer:
    """Waits for the beginning of each cycle.

    A cycle that is late by less than a period runs at once. If it is later, the periods that have
    passed are skipped and counted: no burst of cycles catches up.

    Args:
        clock: The clock.
        period_ns: The period.
        spin_ns: How long before the deadline the sleep ends; a sleeper wakes up some 10 µs late.
    """

    def __init__(self, clock: Clock, period_ns: int, spin_ns: int) -> None:
        self._now_ns, self._sleep_until_ns = clock.now_ns, clock.sleep_until_ns
        self._period_ns, self._spin_ns = period_ns, spin_ns
        self._deadline_ns = self._now_ns()

    def wait(self) -> Tick:
        """Wait for the next cycle; return its beginning. Call once per cycle. Real-time safe."""
        deadline_ns = self._deadline_ns + self._period_ns
        now_ns = self._now_ns()
        # Skip whole periods only: deadlines stay multiples of the period.
        skipped = max((now_ns - deadline_ns) // self._period_ns, 0)
        deadline_ns += skipped * self._period_ns
        # Sleep alone would be late by its wake-up time; spin alone would never yield the processor.
        if now_ns < deadline_ns - self._spin_ns:
            self._sleep_until_ns(deadline_ns - self._spin_ns)
            now_ns = self._now_ns()
        while now_ns < deadline_ns:
            now_ns = self._now_ns()
        # The process may have been stopped while it slept.
        overslept = (now_ns - deadline_ns) // self._period_ns
        deadline_ns += overslept * self._period_ns
        self._deadline_ns = deadline_ns
        return Tick(deadline_ns, now_ns - deadline_ns, skipped + overslept)
