"""The value of an output for a voltage, near the ends of its range."""

from math import inf, isnan, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.channels import (
    Calibration,
    LineCalibration,
    PolynomialCalibration,
    TableCalibration,
)
from piezod.devices.outputs import SLACK_V, CalibratedOutput

SLOPES = st.floats(0.1, 50.0) | st.floats(-50.0, -0.1)
TWO_ENDS = st.tuples(st.floats(-10.0, 0.0), st.floats(0.1, 10.0))


def output(calibration: Calibration, low: float, high: float) -> CalibratedOutput:
    """Return an output whose device has this range."""
    made = CalibratedOutput(calibration)
    made.set_range(low, high)
    return made


@st.composite
def calibrations(draw: st.DrawFn) -> Calibration:
    """Draw lines, and curves with a range wider than any device range."""
    slope, offset = draw(SLOPES), draw(st.floats(-100.0, 100.0))
    bent = slope * draw(st.floats(0.0, 0.01))
    low_v, middle_v, high_v = (offset + (slope + bent * x) * x for x in (-15.0, 0.3, 15.0))
    each: tuple[Calibration, ...] = (
        LineCalibration(gain=slope, offset=offset),
        PolynomialCalibration(coefficients=(offset, slope, bent), values=(-15.0, 15.0)),
        TableCalibration(values=(-15.0, 0.3, 15.0), physical=(low_v, middle_v, high_v)),
    )
    return draw(st.sampled_from(each))


@given(calibrations(), TWO_ENDS)
def test_every_voltage_that_is_in_reach_is_taken(
    calibration: Calibration, ends: tuple[float, float]
) -> None:
    """Every voltage in range, within the tolerance, gives a value in range."""
    low, high = ends
    one = output(calibration, low, high)
    for end_v in one.reach_v():
        for drive_v in (end_v, end_v - SLACK_V, end_v + SLACK_V):
            assert one.reaches(drive_v)
            assert low <= one.value(drive_v) <= high


def test_the_end_of_a_range_is_not_missed_by_rounding() -> None:
    """(1.5 · 10 + 12.1 - 12.1) / 1.5 exceeds 10 by one bit."""
    one = output(LineCalibration(gain=1.5, offset=12.1), 0.0, 10.0)

    assert (27.1 - 12.1) / 1.5 > 10.0
    assert one.value(27.1) == 10.0


@pytest.mark.parametrize("calibration", [LineCalibration(), LineCalibration(gain=-15.0)])
def test_value_beyond_the_range_stays_beyond(calibration: LineCalibration) -> None:
    """A voltage out of range gives a value out of range: nothing is clamped."""
    one = output(calibration, 0.0, 10.0)
    for end_v, beyond in zip(one.reach_v(), (-1.0, 1.0), strict=True):
        too_far_v = end_v + beyond * 3.0 * SLACK_V
        assert not one.reaches(too_far_v)
        assert not 0.0 <= one.value(too_far_v) <= 10.0


@pytest.mark.parametrize(
    "calibration",
    [
        LineCalibration(),
        LineCalibration(gain=2.0),
        TableCalibration(values=(0.0, 10.0), physical=(0.0, 150.0)),
    ],
)
def test_a_voltage_that_is_not_finite_gives_no_value(calibration: Calibration) -> None:
    """The device must refuse it."""
    one = output(calibration, 0.0, 10.0)

    assert isnan(one.value(nan))
    assert not 0.0 <= one.value(inf) <= 10.0
    assert not 0.0 <= one.value(-inf) <= 10.0


def test_a_device_that_tells_no_range_reaches_everything() -> None:
    """Such a device refuses values itself."""
    one = CalibratedOutput(LineCalibration(gain=2.0))

    assert one.reaches(1e6)
    assert one.value(1e6) == 5e5
    assert one.voltage(5e5) == 1e6
