"""Calibrations from a channel's value to µm or V, and back."""

from itertools import pairwise
from math import isnan

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from piezod.config.channels import LineCalibration, PolynomialCalibration, TableCalibration
from piezod.config.polynomial import derivative, evaluate, is_monotonic
from piezod.devices.calibration import (
    Curve,
    PolynomialCurve,
    StraightLine,
    TableCurve,
    curve_of,
)

NUMBERS = st.floats(-1e3, 1e3)


@st.composite
def tables(draw: st.DrawFn) -> list[tuple[float, float]]:
    """Draw points of a rising or a falling curve."""
    steps = draw(st.lists(st.tuples(*[st.floats(0.01, 10.0)] * 2), min_size=2, max_size=30))
    sign, value, physical = draw(st.sampled_from((1.0, -1.0))), draw(NUMBERS), draw(NUMBERS)
    points = []
    for right, up in steps:
        value, physical = value + right, physical + sign * up
        points.append((value, physical))
    return points


@st.composite
def cubics(draw: st.DrawFn) -> tuple[tuple[float, ...], float, float]:
    """Draw a polynomial whose slope is at least 0.1 everywhere, and its range."""
    square, sign = draw(st.floats(0.0, 5.0)), draw(st.sampled_from((1.0, -1.0)))
    centre, low = draw(st.floats(-5.0, 5.0)), draw(st.floats(-5.0, 5.0))
    # The derivative is 0.1 + square · (value - centre)².
    rising = (
        draw(NUMBERS),
        0.1 + square * centre**2,
        -square * centre,
        square / 3.0,
    )
    return tuple(sign * c for c in rising), low, low + draw(st.floats(0.1, 10.0))


def assert_round_trip(curve: Curve, low: float, high: float, part: float) -> None:
    """Assert that a value comes back from its physical value."""
    value = low + part * (high - low)
    physical = curve.physical(value)

    assert curve.value(physical) == pytest.approx(value, rel=1e-9, abs=1e-9 * (high - low))
    assert curve.physical(curve.value(physical)) == pytest.approx(physical, rel=1e-12, abs=1e-9)


@given(st.floats(0.001, 1e3), NUMBERS, st.floats(0.0, 1.0))
def test_a_line_goes_there_and_back(gain: float, offset: float, part: float) -> None:
    """The inverse returns the value."""
    assert_round_trip(StraightLine(gain, offset), -10.0, 10.0, part)


@given(tables(), st.floats(0.0, 1.0))
def test_a_table_goes_there_and_back(points: list[tuple[float, float]], part: float) -> None:
    """The inverse returns every value between the first and the last point."""
    assert_round_trip(TableCurve(points), points[0][0], points[-1][0], part)


@given(cubics(), st.floats(0.0, 1.0))
def test_a_polynomial_goes_there_and_back(
    cubic: tuple[tuple[float, ...], float, float], part: float
) -> None:
    """The inverse returns the value, for rising and falling polynomials."""
    coefficients, low, high = cubic
    curve = PolynomialCurve(coefficients, low, high)
    value = low + part * (high - low)

    assert curve.value(curve.physical(value)) == pytest.approx(value, rel=1e-9, abs=1e-8)


@given(tables())
def test_a_table_meets_its_points_and_gives_nothing_that_the_channel_cannot_be_set_to(
    points: list[tuple[float, float]],
) -> None:
    """Rounding gives no value beyond the first and the last point."""
    curve = TableCurve(points)
    for value, physical in points:
        assert curve.physical(value) == pytest.approx(physical, abs=1e-9)
        assert points[0][0] <= curve.value(physical) <= points[-1][0]


@pytest.mark.parametrize(
    "curve", [TableCurve([(1.0, 10.0), (2.0, 30.0)]), PolynomialCurve((-10.0, 20.0), 1.0, 2.0)]
)
def test_beyond_its_ends_a_curve_does_not_hold(curve: Curve) -> None:
    """Outside its range, a sample is invalid and no value exists; a read-back is extrapolated."""
    assert isnan(curve.physical(0.99))
    assert isnan(curve.physical(2.01))
    assert isnan(curve.value(9.9))
    assert isnan(curve.value(30.1))
    assert isnan(curve.value(float("nan")))
    assert curve.beyond(0.5) == pytest.approx(0.0)
    assert curve.beyond(2.5) == pytest.approx(40.0)


def test_physical_values_need_no_curve() -> None:
    """The curve of a gain of 1 and an offset of 0 is None."""
    assert curve_of(LineCalibration()) is None
    assert curve_of(LineCalibration(gain=2.0)) is not None
    assert curve_of(LineCalibration(offset=2.0)) is not None


PEAK = TableCalibration(
    values=(1.0, 3.0, 4.0, 3.5, 2.0), physical=(0.0, 10.0, 20.0, 30.0, 40.0), side="near"
)


def test_the_near_side_is_what_comes_before_the_greatest_value() -> None:
    """A value that only the far side reaches, or above the maximum, gives no displacement."""
    curve = curve_of(PEAK)

    assert curve is not None
    assert [curve.physical(value) for value in (1.0, 3.0, 3.5, 4.0)] == [0.0, 10.0, 15.0, 20.0]
    assert isnan(curve.physical(4.1))
    assert isnan(curve.physical(0.9))
    assert PEAK.physical_range() == (0.0, 20.0)


def test_the_far_side_has_the_opposite_slope() -> None:
    """The same value is another displacement there; a value of the near side alone gives none."""
    far = PEAK.model_copy(update={"side": "far"})
    curve = curve_of(far)

    assert curve is not None
    assert [curve.physical(value) for value in (4.0, 3.5, 2.0)] == [20.0, 30.0, 40.0]
    assert curve.value(35.0) == pytest.approx(2.75)
    assert isnan(curve.physical(1.9))
    assert far.physical_range() == (20.0, 40.0)


def test_the_gap_may_grow_while_what_is_physical_falls() -> None:
    """The order of the points gives the direction of the gap: the near side comes first."""
    towards = TableCalibration(
        values=PEAK.values, physical=tuple(-physical for physical in PEAK.physical), side="near"
    )
    curve = curve_of(towards)

    assert curve is not None
    assert curve.physical(3.5) == -15.0


@given(st.lists(st.floats(-10.0, 10.0), min_size=2, max_size=6), st.floats(-5.0, 5.0))
def test_a_polynomial_is_monotonic_where_no_sample_of_it_turns(
    coefficients: list[float], low: float
) -> None:
    """A polynomial accepted as monotonic never reverses on a fine grid."""
    high = low + 3.0
    grid = [evaluate(coefficients, low + 3.0 * i / 300) for i in range(301)]
    steps = [later - earlier for earlier, later in pairwise(grid)]
    size = max(map(abs, grid))
    assume(all(abs(step) > 1e-9 * size for step in steps))

    turns = any(first * second < 0.0 for first, second in pairwise(steps))
    assert not (turns and is_monotonic(coefficients, low, high))
    if not turns and all(abs(step) > 1e-3 * size for step in steps):
        assert is_monotonic(coefficients, low, high)


def test_a_polynomial_that_turns_back_between_its_ends_is_found() -> None:
    """Even a narrow reversal between monotonic ends is found; a level point is no reversal."""
    narrow = (0.0, 0.02999, -0.3, 1.0)  # turns where the derivative is below 0, by 1e-5

    assert not is_monotonic(narrow, -10.0, 10.0)
    assert is_monotonic((0.0, 0.0, 0.0, 1.0), -1.0, 1.0)
    assert is_monotonic((0.0, 0.0, 1.0), 0.0, 1.0)
    assert not is_monotonic((0.0, 0.0, 1.0), -0.1, 1.0)
    assert not is_monotonic((5.0, 0.0), -1.0, 1.0)
    assert derivative((1.0, 2.0, 3.0)) == (2.0, 6.0)


def test_a_level_point_has_an_inverse_too() -> None:
    """At a level point bisection replaces Newton's steps."""
    curve = PolynomialCurve((0.0, 0.0, 0.0, 1.0), -1.0, 1.0)

    assert curve.value(0.0) == pytest.approx(0.0, abs=1e-9)
    assert curve.value(1e-12) == pytest.approx(1e-4, rel=1e-9)
    assert curve_of(PolynomialCalibration(coefficients=(1.0, -2.0), values=(0.0, 1.0))) is not None
