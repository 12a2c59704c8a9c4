"""Tests of the lag of a surface behind its drive."""

from math import asinh, log

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.hysteresis.rate_lag import (
    REFERENCE_RATE_PER_S,
    lag_of,
    lag_slope,
    lagging_drive,
    new_lag,
)
from piezod.hysteresis.surface_form import SurfaceForm
from tests.hysteresis.surfaces import DRIVES, SURFACES, Floats, drawn

PERIOD_S = 1e-3
ACTIVATIONS = st.floats(1e-4, 0.05)


@given(ACTIVATIONS, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_lagging_drive_solves_its_equation(activation: float, before: float, drive: float) -> None:
    """Z + w asinh((z - before) / ρ) = v, and z lies between the last one and the drive."""
    lag = new_lag(activation, 0.0, PERIOD_S)
    z = lagging_drive(lag, before, drive)

    assert z + lag_of(lag, before, z) == pytest.approx(drive, abs=1e-12)
    assert min(before, drive) <= z <= max(before, drive)


@given(ACTIVATIONS, st.floats(0.05, 0.95), st.floats(-0.04, 0.04))
def test_slope_is_that_of_the_lag(activation: float, before: float, moved: float) -> None:
    """The derivative agrees with differences."""
    lag, step = new_lag(activation, 0.0, PERIOD_S), 1e-9
    rise = lag_of(lag, before, before + moved + step) - lag_of(lag, before, before + moved - step)

    assert lag_slope(lag, before, before + moved) == pytest.approx(rise / (2 * step), rel=1e-3)


@pytest.mark.parametrize("rate_per_s", [0.1, 1.0, 10.0])
def test_lag_grows_with_the_logarithm_of_the_rate(rate_per_s: float) -> None:
    """At a steady rate far above the reference the drive leads by w ln(rate / r)."""
    lag, z, drive = new_lag(0.01, 0.0, PERIOD_S), 0.0, 0.0
    for _ in range(round(0.5 / (rate_per_s * PERIOD_S))):
        drive += rate_per_s * PERIOD_S
        z = lagging_drive(lag, z, drive)

    assert drive - z == pytest.approx(0.01 * log(rate_per_s / REFERENCE_RATE_PER_S), rel=0.02)


def test_lag_decays_with_the_logarithm_of_time() -> None:
    """In a hold each decade of time takes about the same off the lag."""
    lag, z, lags = new_lag(0.01, 0.0, PERIOD_S), 0.0, list[float]()
    for k in range(30_000):
        z = lagging_drive(lag, z, min(k * 0.01, 0.5))
        if k - 50 in {30, 300, 3000}:
            lags.append(0.5 - z)
    first, second, third = lags

    assert first - second == pytest.approx(0.01 * log(10.0), rel=0.2)
    assert 0.0 < third < second


def test_without_activation_nothing_lags() -> None:
    """The hysteresis then sees the drive itself, to the bit."""
    lag = new_lag(0.0, 0.5, PERIOD_S)

    assert lagging_drive(lag, 0.2, 0.7) == 0.7
    assert lag_of(lag, 0.2, 0.7) == 0.0
    assert asinh(0.0) == lag_slope(lag, 0.2, 0.7)


@given(SURFACES, DRIVES, ACTIVATIONS, st.floats(0.0, 1.0))
def test_inverse_is_exact_with_a_lag(
    coefficients: Floats, drives: list[float], activation: float, prompt: float
) -> None:
    """The drives for the displacements of any drives make these displacements again."""
    form = SurfaceForm(activation, prompt, PERIOD_S)
    positions = form.positions_at(coefficients, np.array(drives))
    inverted = form.drives_at(coefficients, positions)

    assert form.positions_at(coefficients, inverted) == pytest.approx(positions, abs=1e-9)


def test_loops_are_wider_at_a_higher_rate() -> None:
    """A fast loop is wider than a slow one, as on a stage with thermally activated domains."""
    coefficients, widths = drawn(1), []
    for frequency_hz in (0.1, 10.0):
        t_s = np.arange(0.0, 2.0 / frequency_hz, PERIOD_S)
        drives = 0.5 - 0.5 * np.cos(2.0 * np.pi * frequency_hz * t_s)
        form = SurfaceForm(0.01, 0.3, PERIOD_S)
        y = form.positions_at(coefficients, drives)[t_s.size // 2 :]
        v = drives[t_s.size // 2 :]
        rising = np.diff(v, prepend=v[0]) > 0.0
        middle = np.abs(v - 0.5) < 0.1
        widths.append(float(np.mean(y[middle & ~rising]) - np.mean(y[middle & rising])))

    assert widths[1] > widths[0] + 0.02
