"""The backlash before the memory: noise makes no extrema, and the error is bounded."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.hysteresis import MPIModel, even_thresholds
from tests.hysteresis.draw import dense, inputs

DEADBAND = 2e-3
HOUR = 3_600_000  # samples at 1 kHz


def stage(deadband: float) -> MPIModel:
    """Return a model with loops of 13 % and slopes from 0.45 to 1.4."""
    weights = 0.043 * np.exp(-0.12 * np.arange(19))
    return MPIModel(even_thresholds(19), weights, 0.6 * weights, deadband=deadband, capacity=64)


@given(points=inputs(least=2, most=10), deadband=st.floats(1e-4, 2e-2))
def test_error_of_a_deadband_is_about_half_of_it(
    points: NDArray[np.float64], deadband: float
) -> None:
    """On any input the output error is at most 0.5 δ (typically 0.43 δ), for any depth."""
    path = dense(points, 50)

    off = np.max(np.abs(stage(deadband).run(path) - stage(0.0).run(path)))

    assert off < 0.5 * deadband


def test_swings_inside_the_deadband_are_no_reversals() -> None:
    """They move the output along one straight line and leave no extrema."""
    mpi = stage(DEADBAND)
    mpi.run(np.linspace(0, 0.5, 100))
    inside = 0.5 - DEADBAND * np.array([0.0, 0.5, 0.99, 0.2, 0.7, 0.0])

    outputs = mpi.run(inside)

    slopes = np.diff(outputs) / np.diff(inside)
    assert mpi.depth == 0
    np.testing.assert_allclose(slopes, mpi.smallest_slope, atol=1e-9)


def test_exact_inverse_behind_a_deadband_has_the_inverse_slope() -> None:
    """Within the dead-band the inverse has the reciprocal of the model's slope."""
    inverse = stage(DEADBAND).exact_inverse()
    inverse.run(np.linspace(0, 0.5, 100))
    inside = 0.5 - DEADBAND * np.array([0.0, 0.5, 0.99, 0.2, 0.7, 0.0])

    slopes = np.diff(inverse.run(inside)) / np.diff(inside)

    np.testing.assert_allclose(slopes, 1 / inverse.smallest_slope, atol=1e-8)


@pytest.mark.parametrize("share", [0.3, 0.9, 1.5, 4.0])
@pytest.mark.parametrize(
    "hours", [1, pytest.param(24, marks=pytest.mark.stress)], ids=["an hour", "a day"]
)
def test_dither_does_not_ratchet(hours: int, share: float) -> None:
    """Dither below or above the dead-band leaves the mean output in place for any duration."""
    mpi = stage(DEADBAND)
    mpi.run(np.linspace(0, 0.5, 100))
    amplitude = 0.5 * share * DEADBAND
    random = np.random.default_rng(1)
    dither = 0.5 + amplitude * random.uniform(-1, 1, HOUR)
    first = mpi.run(dither[:1000])

    for _ in range(hours):
        last = mpi.run(dither)

    assert np.ptp(last) < 1.5 * 2 * amplitude
    assert np.mean(last) == pytest.approx(np.mean(first), abs=0.1 * DEADBAND)
    assert mpi.merged_pairs == 0


def test_noise_below_the_deadband_pushes_no_extrema() -> None:
    """A noisy rise and fall has one turning point with the dead-band, and many without it."""
    clean = np.concatenate((np.linspace(0.1, 0.9, 5000), np.linspace(0.9, 0.1, 5000)))
    noisy = clean + 0.49 * DEADBAND * np.random.default_rng(2).uniform(-1, 1, clean.size)

    def deepest(deadband: float) -> int:
        mpi = stage(deadband)
        depths = []
        for value in noisy:
            mpi.step(value)
            depths.append(mpi.depth)
        return max(depths)

    assert deepest(DEADBAND) == 1
    assert deepest(0.0) > 3
