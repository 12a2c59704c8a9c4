"""Tests of the guard, the last check before the write."""

from collections.abc import Sequence
from math import inf, isfinite, nan

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from piezod.control.guard import Guard
from tests.control.guard_properties import (
    ASKED_V,
    ELAPSED_S,
    IN_FORCE_V,
    LIMITS,
    LONGEST_S,
    PAIR_IN_FORCE_V,
    PAIR_V,
    check_all,
    told,
)

T_NS = 5_000_000
PERIOD_S = 1e-3
PLANNED_NS = st.sampled_from((0, 0, 0, 1, -1_000_000))


def guard() -> Guard:
    """Return a guard of two axes. A constant would be made before a mutant changes the class."""
    return Guard(LIMITS, LONGEST_S)


@pytest.mark.fault("A5")
@pytest.mark.fault("A6")
@given(PLANNED_NS, PAIR_V, PAIR_IN_FORCE_V, ELAPSED_S)
@example(0, (nan, -inf), (150.0, 0.0), PERIOD_S)
@example(0, (150.0, 100.0), (-0.0, 5e-324), inf)
@settings(max_examples=500)
def test_admitted_voltages_are_always_allowed(
    planned_ns: int, asked_v: Sequence[float], in_force_v: Sequence[float], elapsed_s: float
) -> None:
    """They are finite, in range, within the slew rate and of this cycle; or nothing moves."""
    check_all(guard().admit, planned_ns, asked_v, in_force_v, elapsed_s)


@example(200.0, 171.0, PERIOD_S)
@given(ASKED_V, IN_FORCE_V, ELAPSED_S)
def test_admitted_voltage_is_admitted_again(
    asked_v: float, in_force_v: float, elapsed_s: float
) -> None:
    """A voltage that was admitted passes unchanged."""
    before_v = [in_force_v, 0.0]
    first = guard().admit(0, 0, [asked_v, 0.0], before_v, elapsed_s)
    assume(not first.refused)
    second = guard().admit(0, 0, first.drive_v, before_v, elapsed_s)

    assert second.drive_v == first.drive_v


@pytest.mark.fault("A5")
@pytest.mark.parametrize("asked_v", [nan, inf, -inf])
def test_voltage_that_is_not_a_number_moves_nothing(asked_v: float) -> None:
    """The axis is reported as refused; the other axis continues."""
    admitted = guard().admit(T_NS, T_NS, [asked_v, 40.1], [75.0, 40.0], PERIOD_S)

    assert told(admitted) == [[75.0, 40.1], (), (0,), (), (), False, ()]


def test_unknown_voltage_in_force_forbids_a_write() -> None:
    """Without a known start no voltage is safe."""
    admitted = guard().admit(T_NS, T_NS, [20.0, 40.1], [nan, 40.0], PERIOD_S)

    assert not admitted.writable
    assert admitted.refused == (0,)
    assert not isfinite(admitted.drive_v[0])


@pytest.mark.parametrize("planned_ns", [T_NS - 1_000_000, T_NS - 1, T_NS + 1, 0])
def test_plan_for_another_cycle_moves_nothing(planned_ns: int) -> None:
    """Every voltage stays, and the result is marked as stale."""
    admitted = guard().admit(planned_ns, T_NS, [20.0, 60.0], [30.0, 40.0], PERIOD_S)

    assert told(admitted) == [[30.0, 40.0], (), (), (), (), True, ()]


def test_range_and_slew_rate_are_reported_separately() -> None:
    """A voltage can be out of range, too fast, or both."""
    too_far = guard().admit(T_NS, T_NS, [160.0, 0.0], [149.0, 0.0], PERIOD_S)
    too_fast = guard().admit(T_NS, T_NS, [0.0, 1.0], [0.0, 0.0], PERIOD_S)
    both = guard().admit(T_NS, T_NS, [0.0, 200.0], [0.0, 0.0], PERIOD_S)

    assert told(too_far) == [[150.0, 0.0], (), (), (0,), (), False, ()]
    assert told(too_fast) == [[0.0, 0.5], (), (), (), (1,), False, ()]
    assert told(both) == [[0.0, 0.5], (), (), (1,), (1,), False, ()]


@pytest.mark.parametrize("elapsed_s", [LONGEST_S, 0.1, 10.0, 1e300])
def test_no_step_catches_up_after_a_pause(elapsed_s: float) -> None:
    """After a pause of any length the step is that of two periods."""
    admitted = guard().admit(T_NS, T_NS, [150.0, 100.0], [0.0, 0.0], elapsed_s)

    assert admitted.drive_v == [40.0, 1.0]


@pytest.mark.parametrize("elapsed_s", [0.0, -1.0, nan, inf, -inf])
def test_nothing_moves_without_a_valid_time(elapsed_s: float) -> None:
    """A time that is not finite, or negative, counts as zero."""
    admitted = guard().admit(T_NS, T_NS, [20.0, 60.0], [30.0, 40.0], elapsed_s)

    assert admitted.drive_v == [30.0, 40.0]


@pytest.mark.parametrize(("start_v", "end_v"), [(215.0, 150.0), (-75.0, -10.0)])
def test_stage_outside_its_range_returns_at_the_slew_rate(start_v: float, end_v: float) -> None:
    """It returns in four cycles without a step, and is reported as limited meanwhile."""
    in_force_v, limited = [start_v, 0.0], []
    for _ in range(4):
        admitted = guard().admit(T_NS, T_NS, [end_v, 0.0], in_force_v, PERIOD_S)
        limited.append(admitted.slew_limited)
        in_force_v = admitted.drive_v

    assert in_force_v[0] == end_v
    assert limited == [(0,), (0,), (0,), ()]


@pytest.mark.fault("A4")
def test_halved_slew_rate_acts_on_its_axis_only() -> None:
    """It counts from the voltage in force and from one that was not acknowledged."""
    step_v = LIMITS[0].slew_v_per_s * 1e-4
    asked_v = [100.0, LIMITS[1].drive_max_v]
    in_force_v, sent_v = [10.0, LIMITS[1].drive_min_v], [9.0, LIMITS[1].drive_min_v]
    usual = guard().admit(0, 0, asked_v, in_force_v, 1e-4, sent_v)
    halved = guard().admit(0, 0, asked_v, in_force_v, 1e-4, sent_v, (0,))

    assert usual.drive_v[0] == pytest.approx(9.0 + step_v)
    assert halved.drive_v[0] == pytest.approx(9.0 + step_v / 2.0)
    assert halved.drive_v[1] == usual.drive_v[1]
