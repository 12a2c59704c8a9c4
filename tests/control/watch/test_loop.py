"""Tests of the watch of the loop."""

from collections.abc import Iterable

import pytest

from piezod.control.watch.loop import CycleTiming, LoopWatch
from tests.control.fakes import MS

ON_TIME = CycleTiming(
    late_ns=20_000, skipped=0, busy_ns=MS // 10, wall_offset_ns=7, boot_offset_ns=9
)
S = 1000 * MS


def found(timings: Iterable[CycleTiming], watch: LoopWatch | None = None) -> list[list[str]]:
    """Return the ids of the faults in each cycle of a loop at 1 kHz."""
    watch = watch or LoopWatch(MS)
    return [[detection.fault for detection in watch.check(timing)] for timing in timings]


def late(skipped: int) -> CycleTiming:
    """Return the timing of a cycle after skipped periods."""
    return ON_TIME._replace(skipped=skipped)


def test_punctual_loop_has_no_fault() -> None:
    """A loop that is late by a few µs for a minute is healthy."""
    assert not any(found([ON_TIME] * 60_000))


@pytest.mark.fault("L1")
@pytest.mark.parametrize("timing", [late(1), ON_TIME._replace(busy_ns=MS + 1)])
def test_single_overrun_is_detected_once(timing: CycleTiming) -> None:
    """A skipped cycle, or one longer than the period, is L1 only."""
    assert found([ON_TIME, timing, ON_TIME]) == [[], ["L1"], []]


@pytest.mark.fault("L2")
def test_five_overruns_in_a_row_are_too_many() -> None:
    """Each is L1; the fifth is L2, too."""
    faults = found([late(1)] * 5)

    assert faults == [["L1"]] * 4 + [["L1", "L2"]]


@pytest.mark.fault("L2")
@pytest.mark.fault("L5")
@pytest.mark.parametrize(
    ("skipped", "expected"), [(4, ["L1"]), (5, ["L1", "L2"]), (20, ["L1", "L5", "L2"])]
)
def test_length_of_a_gap_decides_the_fault(skipped: int, expected: list[str]) -> None:
    """Five periods and more are L2; from twenty on the loop has stood still: L5."""
    assert found([ON_TIME, late(skipped), ON_TIME]) == [[], expected, []]


@pytest.mark.fault("L7")
@pytest.mark.parametrize(("every", "is_found"), [(80, True), (125, False)])
def test_often_late_is_more_than_one_cycle_in_a_hundred(every: int, is_found: bool) -> None:
    """More than 1 % of cycles that begin half a period late, over 10 s, are L7."""
    timings = [
        ON_TIME._replace(late_ns=MS * 6 // 10 if k % every == 0 else 0) for k in range(20_000)
    ]

    assert any("L7" in faults for faults in found(timings)) == is_found
    assert not any("L1" in faults or "L2" in faults for faults in found(timings))


@pytest.mark.fault("L2")
def test_one_period_lost_in_sixteen_is_too_many() -> None:
    """No overrun follows another, but over 10 s more than 5 % are lost: L2."""
    faults = found([late(1 if k % 15 == 0 else 0) for k in range(10_000)])

    assert "L2" in faults[-15]
    assert not any("L2" in one for one in faults[:5000])


def test_late_cycles_are_forgotten_after_the_window() -> None:
    """Eleven seconds after many late cycles the loop is healthy."""
    watch = LoopWatch(MS)
    found([late(k % 10 == 0) for k in range(10_000)], watch)

    assert found([ON_TIME] * 11_000, watch)[-1] == []


@pytest.mark.fault("L4")
@pytest.mark.parametrize("jump_s", [-3600, 3600])
def test_jump_of_the_wall_clock_is_detected(jump_s: int) -> None:
    """The jump is one L4 with its seconds; a clock that is slewed gives none."""
    watch = LoopWatch(MS)
    slewed = [ON_TIME._replace(wall_offset_ns=k * 500) for k in range(1000)]
    jumped = slewed[-1]._replace(wall_offset_ns=jump_s * S)

    assert not any(found(slewed, watch))
    (detection,) = watch.check(jumped)
    assert detection.fault == "L4"
    assert detection.measured == pytest.approx(3600)
    assert found([jumped], watch) == [[]]


@pytest.mark.fault("L5")
def test_suspend_is_detected() -> None:
    """BOOTTIME gains on MONOTONIC: L5; the jump of the wall clock is not reported."""
    awake = ON_TIME._replace(wall_offset_ns=60 * S, boot_offset_ns=60 * S)

    assert found([ON_TIME, awake, awake]) == [[], ["L5"], []]
