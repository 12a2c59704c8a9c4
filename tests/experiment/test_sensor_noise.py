"""Tests of the noise of a sensor, separated from lag and calibration."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.experiment.sensor_noise import noise_rms
from piezod.hysteresis.memory import FloatArray

T_S = np.arange(20_000) / 1000.0
TRUTH = 10.0 - 10.0 * np.cos(2.0 * np.pi * 0.5 * T_S) * (1.0 - 0.7 * np.sin(0.3 * T_S))
VELOCITY = np.gradient(TRUTH)


def noise(rms: float) -> FloatArray:
    """Return white noise with zero mean."""
    values = np.random.default_rng(7).standard_normal(T_S.size)
    return values * (rms / float(np.sqrt(np.mean(values**2))))


def test_white_noise_is_found() -> None:
    """It is relative to the range of the truth."""
    found = noise_rms(TRUTH + noise(0.02), TRUTH, VELOCITY)

    assert found == pytest.approx(0.02 / np.ptp(TRUTH), rel=1e-3)


@given(st.floats(0.0, 1.5), st.lists(st.floats(-0.3, 0.3), min_size=6, max_size=6))
def test_lag_and_calibration_are_no_noise(lag_samples: float, powers: list[float]) -> None:
    """This holds for lags up to a period and a half, and curves up to the fifth power."""
    curve = np.polynomial.Polynomial(powers)(TRUTH / np.ptp(TRUTH))
    position = TRUTH + curve - lag_samples * VELOCITY + noise(0.02)

    found = noise_rms(position, TRUTH, VELOCITY)

    assert found == pytest.approx(0.02 / np.ptp(TRUTH), rel=1e-2)


def test_late_sensor_without_noise_has_almost_none() -> None:
    """A delay of half a sample is a lag up to 0.01 % of the range."""
    late = np.interp(T_S - 0.0005, T_S, TRUTH)

    assert noise_rms(late, TRUTH, VELOCITY) < 1e-4


def test_velocity_may_be_in_any_unit() -> None:
    """Only its shape matters; without a velocity the noise is found, too."""
    position = TRUTH + 0.3 * VELOCITY + noise(0.02)
    found = noise_rms(position, TRUTH, VELOCITY)

    assert noise_rms(position, TRUTH, 1e6 * VELOCITY) == pytest.approx(found)
    assert noise_rms(TRUTH + noise(0.02), TRUTH, 0.0 * VELOCITY) == pytest.approx(found, rel=1e-2)


def test_unexplained_residual_is_noise() -> None:
    """A hum that is independent of the motion counts fully."""
    hum = 0.02 * np.sin(2.0 * np.pi * 50.0 * T_S)
    found = noise_rms(TRUTH + hum, TRUTH, VELOCITY)

    assert found == pytest.approx(0.02 / np.sqrt(2.0) / np.ptp(TRUTH), rel=1e-2)
