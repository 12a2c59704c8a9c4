"""Tests of the watch of the loop."""

from collections.abc import Iterable

import pytest

from piezod.config.faults import Fault
from piezod.control.faults.cases import Case
from piezod.control.watch.loop import CycleTiming, LoopWatch
from tests.conftest import Reaction
from tests.control.fakes import MS

S = 1000 * MS


def timed(
    *,
    late_ns: int = 20_000,
    skipped: int = 0,
    busy_ns: int = MS // 10,
    wall_offset_ns: int = 7,
    boot_offset_ns: int = 9,
) -> CycleTiming:
    """Return the timing of a cycle, of a punctual one by default."""
    return CycleTiming(late_ns, skipped, busy_ns, wall_offset_ns, boot_offset_ns)


ON_TIME = timed()


def found(timings: Iterable[CycleTiming], watch: LoopWatch | None = None) -> list[list[str]]:
    """Return the ids of the faults in each cycle of a loop at 1 kHz."""
    watch = watch or LoopWatch(MS)
    return [[detection.fault for detection in watch.check(timing)] for timing in timings]


def test_punctual_loop_has_no_fault() -> None:
    """A loop that is late by a few µs for a minute is healthy."""
    assert not any(found([ON_TIME] * 60_000))


@pytest.mark.fault("L1")
@pytest.mark.parametrize("timing", [timed(skipped=1), timed(busy_ns=MS + 1)])
def test_single_overrun_is_detected_once(timing: CycleTiming) -> None:
    """A skipped cycle, or one longer than the period, is L1 only."""
    assert found([ON_TIME, timing, ON_TIME]) == [[], ["L1"], []]


@pytest.mark.fault("L1")
@pytest.mark.parametrize("skipped", [5, 50, 900])
def test_single_stall_is_counted_only(skipped: int) -> None:
    """A stall below a second is L1 once, however many periods it took."""
    watch = LoopWatch(MS)
    found([ON_TIME] * 5000, watch)

    assert found([timed(skipped=skipped), *[ON_TIME] * 5000], watch) == [["L1"]] + [[]] * 5000


@pytest.mark.fault("L2")
def test_lasting_lateness_is_more_than_a_tenth_of_the_cycles() -> None:
    """One late cycle in eleven is L7 only; one in nine becomes L2 within 5 s."""
    seldom = found([timed(skipped=1 if k % 11 == 0 else 0) for k in range(20_000)])
    often = found([timed(skipped=1 if k % 9 == 0 else 0) for k in range(6000)])

    assert not any("L2" in faults for faults in seldom)
    assert any("L2" in faults for faults in often)
    assert not any("L2" in faults for faults in often[:4000])


@pytest.mark.fault("L2")
def test_lateness_ends_below_a_twentieth_of_the_cycles() -> None:
    """It is reported in each cycle until the window has slid on."""
    watch = LoopWatch(MS)
    found([timed(skipped=1 if k % 2 == 0 else 0) for k in range(3000)], watch)
    faults = ["L2" in ids for ids in found([ON_TIME] * 6000, watch)]

    assert faults[0]
    assert faults == sorted(faults, reverse=True)
    assert not faults[5000]


@pytest.mark.fault("L2")
def test_loop_that_is_always_too_slow_is_late() -> None:
    """Each cycle takes two periods: half of the cycles are skipped, all are late."""
    faults = found([timed(skipped=1, busy_ns=2 * MS)] * 1000)

    assert faults[-1] == ["L1", "L2", "L7"]


@pytest.mark.fault("L5")
@pytest.mark.parametrize(("period_ns", "skipped"), [(MS, 1000), (MS // 10, 10_000), (400 * MS, 5)])
def test_pause_of_a_second_is_a_pause(period_ns: int, skipped: int) -> None:
    """At low rates it is at least five periods."""
    assert "L5" in found([timed(skipped=skipped)], LoopWatch(period_ns))[0]
    assert "L5" not in found([timed(skipped=skipped - 1)], LoopWatch(period_ns))[0]


@pytest.mark.fault("L2")
def test_strict_five_overruns_in_a_row_are_too_many() -> None:
    """Each is L1; the fifth is L2, too."""
    faults = found([timed(skipped=1)] * 5, LoopWatch(MS, strict=True))

    assert faults == [["L1"]] * 4 + [["L1", "L2"]]


@pytest.mark.fault("L2")
@pytest.mark.fault("L5")
@pytest.mark.parametrize(
    ("skipped", "expected"), [(4, ["L1"]), (5, ["L1", "L2"]), (20, ["L1", "L5", "L2"])]
)
def test_strict_length_of_a_gap_decides_the_fault(skipped: int, expected: list[str]) -> None:
    """Five periods and more are L2; from twenty on the loop has stood still: L5."""
    watch = LoopWatch(MS, strict=True)

    assert found([ON_TIME, timed(skipped=skipped), ON_TIME], watch) == [[], expected, []]


@pytest.mark.fault("L5")
def test_strict_faults_have_the_rules_of_their_case() -> None:
    """The case decides the reaction and who ends it."""
    watch = LoopWatch(MS, strict=True)
    faults = {detection.fault: detection.case for detection in watch.check(timed(skipped=20))}

    assert faults == {Fault.L1: Case.USUAL, Fault.L2: Case.STRICT, Fault.L5: Case.STRICT}


@pytest.mark.fault("L7")
@pytest.mark.parametrize(("every", "is_found"), [(80, True), (125, False)])
@pytest.mark.parametrize("strict", [False, True])
def test_often_late_is_more_than_one_cycle_in_a_hundred(
    every: int, is_found: bool, strict: bool, reaction: Reaction
) -> None:
    """More than 1 % of cycles that begin half a period late are L7."""
    timings = [timed(late_ns=MS * 6 // 10 if k % every == 0 else 0) for k in range(20_000)]

    faults = found(timings, LoopWatch(MS, strict=strict))

    assert any("L7" in ids for ids in faults) == is_found
    if is_found and not strict:
        reaction("L7", cycles=next(k for k, ids in enumerate(faults) if "L7" in ids) + 1)
    assert not any("L1" in ids or "L2" in ids for ids in faults)


@pytest.mark.fault("L2")
def test_strict_one_period_lost_in_sixteen_is_too_many() -> None:
    """No overrun follows another, but over 10 s more than 5 % are lost: L2."""
    timings = [timed(skipped=1 if k % 15 == 0 else 0) for k in range(10_000)]
    faults = found(timings, LoopWatch(MS, strict=True))

    assert "L2" in faults[-15]
    assert not any("L2" in one for one in faults[:5000])


@pytest.mark.parametrize("strict", [False, True])
def test_late_cycles_are_forgotten_after_the_window(strict: bool) -> None:
    """Eleven seconds after many late cycles the loop is healthy."""
    watch = LoopWatch(MS, strict=strict)
    found([timed(skipped=k % 10 == 0) for k in range(10_000)], watch)

    assert found([ON_TIME] * 11_000, watch)[-1] == []


@pytest.mark.fault("L4")
@pytest.mark.parametrize("jump_s", [-3600, 3600])
def test_jump_of_the_wall_clock_is_detected(jump_s: int) -> None:
    """The jump is one L4 with its seconds; a clock that is slewed gives none."""
    watch = LoopWatch(MS)
    slewed = [timed(wall_offset_ns=k * 500) for k in range(1000)]
    jumped = timed(wall_offset_ns=jump_s * S)

    assert not any(found(slewed, watch))
    (detection,) = watch.check(jumped)
    assert detection.fault == "L4"
    assert detection.measured == pytest.approx(3600)
    assert found([jumped], watch) == [[]]


@pytest.mark.fault("L5")
def test_suspend_is_detected() -> None:
    """BOOTTIME gains on MONOTONIC: L5; the jump of the wall clock is not reported."""
    awake = timed(wall_offset_ns=60 * S, boot_offset_ns=60 * S)

    assert found([ON_TIME, awake, awake]) == [[], ["L5"], []]
