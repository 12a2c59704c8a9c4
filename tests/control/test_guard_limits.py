"""Tests of the limits, with values dense around each edge and sparse elsewhere."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.guard import Limits

LIMITS = Limits(drive_min_v=-10.0, drive_max_v=150.0, slew_v_per_s=20_000.0)
CYCLE_S = 1e-3
REACH_V = 20.0
INSIDE = st.floats(-10, 150)


def around(edge: float) -> list[float]:
    """Return the edge, its neighbours in floating point, and values a little farther away."""
    return [
        edge,
        math.nextafter(edge, -math.inf),
        math.nextafter(edge, math.inf),
        edge - 1e-9,
        edge + 1e-9,
        edge - 0.1,
        edge + 0.1,
    ]


EDGES = [v for edge in (-10.0, 150.0, 10.0, 130.0) for v in around(edge)]
ANY_DRIVE = st.one_of(st.floats(), st.sampled_from(EDGES))


@given(requested_v=ANY_DRIVE, previous_v=st.one_of(INSIDE, st.sampled_from([-10.0, 150.0])))
def test_admitted_voltage_is_in_range_and_within_reach(
    requested_v: float, previous_v: float
) -> None:
    """Any request becomes a voltage in range and within the slew rate."""
    drive_v = LIMITS.admit(requested_v, previous_v, CYCLE_S)

    assert -10.0 <= drive_v <= 150.0
    assert abs(drive_v - previous_v) <= REACH_V * (1 + 1e-12)


@given(requested_v=ANY_DRIVE, previous_v=st.floats(-1e3, 1e3))
def test_admitted_voltage_is_the_nearest_in_the_window(
    requested_v: float, previous_v: float
) -> None:
    """Inside the window a voltage passes to the bit; outside it becomes the nearer end."""
    window = LIMITS.window(previous_v, CYCLE_S)
    drive_v = LIMITS.admit(requested_v, previous_v, CYCLE_S)

    assert window[0] <= window[1]
    if not math.isfinite(requested_v):
        assert drive_v == previous_v
    elif requested_v < window[0]:
        assert drive_v == window[0]
    elif requested_v > window[1]:
        assert drive_v == window[1]
    else:
        assert drive_v == requested_v


@pytest.mark.parametrize("requested_v", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("previous_v", [-10.0, 0.0, 150.0, 200.0])
def test_voltage_that_is_not_finite_moves_nothing(requested_v: float, previous_v: float) -> None:
    """It does not even move towards the end of the range."""
    assert LIMITS.admit(requested_v, previous_v, CYCLE_S) == previous_v


@pytest.mark.parametrize("edge", EDGES)
def test_window_ends_at_the_nearer_of_range_and_reach(edge: float) -> None:
    """Near an end of the range the range limits, elsewhere the slew rate."""
    previous_v = min(max(edge, -10.0), 150.0)

    low_v, high_v = LIMITS.window(previous_v, CYCLE_S)

    assert low_v == pytest.approx(max(previous_v - REACH_V, -10.0), abs=1e-12)
    assert high_v == pytest.approx(min(previous_v + REACH_V, 150.0), abs=1e-12)


@pytest.mark.parametrize(("high_v", "allowed_v"), [(150.0, 0.8), (90.0, 0.5), (20.0, 0.5)])
def test_read_back_may_differ_by_half_a_volt_or_half_a_percent(
    high_v: float, allowed_v: float
) -> None:
    """The larger of both counts; the percent is one of the whole range."""
    limits = Limits(-10.0, high_v, 20_000.0)

    assert limits.read_back_tolerance_v == pytest.approx(allowed_v)


def test_window_without_time_is_one_voltage() -> None:
    """In no time the voltage cannot change."""
    assert LIMITS.window(42.0, 0.0) == (42.0, 42.0)


@pytest.mark.parametrize(("start_v", "end_v"), [(215.0, 150.0), (-75.0, -10.0)])
def test_voltage_outside_the_range_returns_at_the_slew_rate(start_v: float, end_v: float) -> None:
    """A stage at 215 V reaches 150 V in four cycles, without a step."""
    voltages_v = [start_v]
    while voltages_v[-1] != end_v:
        voltages_v.append(LIMITS.admit(end_v, voltages_v[-1], CYCLE_S))

    steps_v = [abs(b - a) for a, b in pairwise(voltages_v)]
    assert steps_v == [20.0, 20.0, 20.0, 5.0]


@pytest.mark.parametrize("requested_v", [0.0, 300.0, 215.0])
def test_voltage_outside_the_range_never_moves_further_out(requested_v: float) -> None:
    """From 215 V every finite request leads towards the range."""
    assert LIMITS.admit(requested_v, 215.0, CYCLE_S) == 195.0
