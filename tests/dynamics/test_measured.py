"""Measured responses: from periods of a multisine, and from any record."""

import numpy as np
import pytest

from piezod.dynamics.measured import from_periods, from_record, noise_density
from piezod.dynamics.multisine import low_peak_multisine, odd_harmonics
from tests.dynamics.made_up import answer, model_of

RATE_HZ, PERIOD, PERIODS = 10_000.0, 2000, 12
HARMONICS = odd_harmonics(1, 800, 60)
LINES = low_peak_multisine(HARMONICS)
DRIVE = LINES.sample(np.arange(PERIOD) / PERIOD)
MODEL = model_of(2e-4, (800.0, 0.03, 1.0))
NOISE = 0.5


def test_periods_give_the_response_and_its_uncertainty() -> None:
    """The response of a made-up system is found, as well as the scatter says, despite drift."""
    rng = np.random.default_rng(1)
    position = answer(MODEL, DRIVE, RATE_HZ, PERIODS)
    n = position.size
    position += NOISE * rng.standard_normal(n) + 3.0 * np.arange(n) / n

    found = from_periods(
        np.tile(DRIVE, (PERIODS, 1)), position.reshape(PERIODS, PERIOD), HARMONICS, PERIOD / RATE_HZ
    )

    off = np.abs(found.response - MODEL.at(found.frequency_hz)) / np.sqrt(found.variance)
    assert 0.7 < np.sqrt(np.mean(off**2)) < 1.4
    assert np.mean(found.relative_uncertainty[:30]) < 0.05
    assert found.coherence[0] > 0.9
    assert found.coherence[-1] < 0.95  # far above the mode


def test_noise_has_no_coherence() -> None:
    """A position that does not follow the drive gives lines far from clear."""
    position = np.random.default_rng(2).standard_normal((PERIODS, PERIOD))

    found = from_periods(np.tile(DRIVE, (PERIODS, 1)), position, HARMONICS, PERIOD / RATE_HZ)

    assert np.median(found.coherence) < 0.3
    assert np.min(found.relative_uncertainty) > 0.2


@pytest.mark.parametrize("noise", [0.02, 0.3])
def test_record_gives_the_response_and_its_uncertainty(noise: float) -> None:
    """A random drive of any length gives the response by averages over segments."""
    rng = np.random.default_rng(3)
    drive = rng.standard_normal(120_000)
    position = answer(MODEL, drive, RATE_HZ, 1) + noise * rng.standard_normal(drive.size)

    found = from_record(drive, position, RATE_HZ)

    off = np.abs(found.response - MODEL.at(found.frequency_hz))
    # Without the flanks of the mode, which a segment of 1 s smears a little.
    plain = np.abs(found.frequency_hz - 800.0) > 60.0
    share = np.sqrt(np.mean((off**2 / found.variance)[plain]))
    assert 0.5 < share < 1.6
    assert off[found.frequency_hz < 300.0] == pytest.approx(0.0, abs=0.2)


def test_noise_density_of_white_noise() -> None:
    """White noise of 1 at a rate of 2 Hz has a density of 1 per √Hz."""
    values = np.random.default_rng(4).standard_normal(20_000)

    _, density = noise_density(values, 2.0)

    assert np.sqrt(np.mean(density**2)) == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("samples", [2000, 2001])
def test_power_of_noise_is_that_of_its_density(samples: int) -> None:
    """The density times the width of its lines adds up to the variance, whatever the drift."""
    values = np.random.default_rng(5).standard_normal(samples)
    drifting = values + np.linspace(0.0, 100.0, samples)

    frequency_hz, density = noise_density(drifting, 1000.0)

    power = np.sum(density**2) * frequency_hz[0]
    assert power == pytest.approx(np.var(values), rel=0.1)
    assert density == pytest.approx(noise_density(values, 1000.0)[1])
