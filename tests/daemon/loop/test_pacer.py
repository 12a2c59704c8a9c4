import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.daemon.clock import MonotonicClock, clock_offsets_ns
from piezod.daemon.loop.pacer import Pacer
from piezod.testing.fake_clock import READING_NS, FakeClock

PERIOD_NS = 1_000_000
SPIN_NS = 40_000


def test_cycles_begin_at_multiples_of_the_period() -> None:
    """Deadlines are absolute: the duration of one cycle does not move the next."""
    clock = FakeClock()
    pacer = Pacer(clock, PERIOD_NS, SPIN_NS)
    start_ns = clock.t_ns

    for k in range(1, 100):
        tick = pacer.wait()
        clock.spend_ns(k * 9_000)  # busier and busier, always within the period
        assert tick.deadline_ns == start_ns + k * PERIOD_NS
        assert 0 <= tick.late_ns <= READING_NS
        assert tick.skipped == 0


def test_sleep_ends_before_the_deadline_and_spinning_at_it() -> None:
    """A cycle is on time if the sleep ends late by less than the spin."""

    class LateClock(FakeClock):
        def sleep_until_ns(self, t_ns: int) -> None:
            super().sleep_until_ns(t_ns + SPIN_NS - READING_NS)

    pacer = Pacer(LateClock(), PERIOD_NS, SPIN_NS)

    assert [pacer.wait().late_ns <= READING_NS for _ in range(10)] == [True] * 10


def test_cycle_begins_at_its_deadline() -> None:
    """The first reading of the clock at the deadline ends the wait."""
    tick = Pacer(FakeClock(), PERIOD_NS, SPIN_NS).wait()

    assert (tick.deadline_ns, tick.late_ns, tick.skipped) == (PERIOD_NS + READING_NS, 0, 0)


@pytest.mark.parametrize(("left_ns", "sleeps"), [(SPIN_NS, 0), (SPIN_NS + READING_NS, 1)])
def test_processor_is_given_away_only_before_the_spin(left_ns: int, sleeps: int) -> None:
    """Even a sleep of no duration lets others run, for longer than the rest of the period."""

    class CountingClock(FakeClock):
        slept = 0

        def sleep_until_ns(self, t_ns: int) -> None:
            self.slept += 1
            super().sleep_until_ns(t_ns)

    clock = CountingClock()
    pacer = Pacer(clock, PERIOD_NS, SPIN_NS)
    clock.spend_ns(PERIOD_NS - left_ns - READING_NS)  # and the reading at the start of the wait
    pacer.wait()

    assert clock.slept == sleeps


def test_cycle_that_is_late_runs_at_once() -> None:
    """A delay of less than a period skips nothing, and the next cycle is on time again."""
    clock = FakeClock()
    pacer = Pacer(clock, PERIOD_NS, SPIN_NS)
    first = pacer.wait()
    clock.spend_ns(PERIOD_NS + 300_000)

    second, third = pacer.wait(), pacer.wait()

    assert second.deadline_ns == first.deadline_ns + PERIOD_NS
    assert second.late_ns == pytest.approx(300_000, abs=3 * READING_NS)
    assert third.deadline_ns == second.deadline_ns + PERIOD_NS
    assert (second.skipped, third.skipped) == (0, 0)


@given(pauses_ns=st.lists(st.integers(0, 20 * PERIOD_NS), max_size=30))
def test_periods_that_are_over_are_skipped_and_counted(pauses_ns: list[int]) -> None:
    """Each period is run or counted as skipped, and none is run twice."""
    clock = FakeClock()
    pacer = Pacer(clock, PERIOD_NS, SPIN_NS)
    start_ns = clock.t_ns
    before_ns, counted = start_ns, 0

    for pause_ns in pauses_ns:
        tick = pacer.wait()
        counted += 1 + tick.skipped
        assert tick.deadline_ns == start_ns + counted * PERIOD_NS
        assert tick.deadline_ns - before_ns == (1 + tick.skipped) * PERIOD_NS
        assert 0 <= tick.late_ns < PERIOD_NS
        before_ns = tick.deadline_ns
        clock.spend_ns(pause_ns)


def test_sleeping_too_long_skips_too() -> None:
    """A process that was stopped in its sleep skips the periods that are over."""

    class StoppedClock(FakeClock):
        def sleep_until_ns(self, t_ns: int) -> None:
            super().sleep_until_ns(t_ns + 10 * PERIOD_NS)

    tick = Pacer(StoppedClock(), PERIOD_NS, 0).wait()

    assert tick.skipped == 10
    assert tick.late_ns < PERIOD_NS


def test_monotonic_clock_sleeps_until_an_instant() -> None:
    """It never wakes up early, and does not sleep until an instant in the past."""
    clock = MonotonicClock()
    until_ns = clock.now_ns() + 2_000_000

    clock.sleep_until_ns(until_ns)
    awake_ns = clock.now_ns()
    clock.sleep_until_ns(0)

    assert awake_ns >= until_ns


def test_offsets_lead_from_one_clock_to_the_others() -> None:
    """Monotonic time plus an offset is the time of day, or the time since boot."""
    wall_ns, boot_ns = clock_offsets_ns()

    now_ns = time.monotonic_ns()
    assert now_ns + wall_ns == pytest.approx(time.time_ns(), abs=10**9)
    assert now_ns + boot_ns == pytest.approx(time.clock_gettime_ns(time.CLOCK_BOOTTIME), abs=10**9)
