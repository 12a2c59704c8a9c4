"""Batch identification."""

import numpy as np
import pytest
from numpy.typing import NDArray

from piezod.hysteresis import (
    InverseMPI,
    even_thresholds,
    identify_least_squares,
    new_bank,
    stop_regressors,
)

Array = NDArray[np.floating]
THRESHOLDS = even_thresholds(6)
BANK = new_bank(THRESHOLDS, THRESHOLDS)
KNOWN = np.array([0.03, -0.01, 0.02, 0.01, 0.04, 0.02, 0.01, 0.02, -0.02, 0.03, 0.01, 0.05])


def record(noise: float = 0.0) -> tuple[Array, Array]:
    """Return nested loops of displacement, and the drives that known weights make of them."""
    t = np.arange(0, 40, 2e-3)
    positions = 0.5 - 0.5 * np.cos(np.pi * t) * np.cos(0.07 * np.pi * t)
    drives = positions + stop_regressors(BANK, positions) @ KNOWN
    return positions, drives + noise * np.random.default_rng(1).standard_normal(t.size)


def test_known_weights_are_recovered() -> None:
    """Without noise, and next to no ridge, the fit finds the weights that made the record."""
    weights = identify_least_squares(BANK, *record(), ridge=1e-14)

    np.testing.assert_allclose(weights, KNOWN, rtol=0, atol=1e-8)


def test_ridge_of_the_default_costs_little() -> None:
    """The prediction stays good to a ten-thousandth of the range."""
    positions, drives = record()
    weights = identify_least_squares(BANK, positions, drives)

    predicted = positions + stop_regressors(BANK, positions) @ weights

    np.testing.assert_allclose(predicted, drives, rtol=0, atol=1e-4)


def test_fitted_weights_are_those_of_an_inverse_model() -> None:
    """Left stops come first: a model built from the two halves predicts the record."""
    positions, drives = record()
    weights = identify_least_squares(BANK, positions, drives, ridge=1e-14)
    inverse = InverseMPI(THRESHOLDS, THRESHOLDS, weights[6:], weights[:6])

    np.testing.assert_allclose(inverse.run(positions), drives, rtol=0, atol=1e-8)


def test_noise_is_averaged_out() -> None:
    """Noise of 1 % leaves a prediction that is ten times better than the record."""
    positions, noisy = record(noise=0.01)
    _, clean = record()
    weights = identify_least_squares(BANK, positions, noisy)

    predicted = positions + stop_regressors(BANK, positions) @ weights

    assert np.sqrt(np.mean((predicted - clean) ** 2)) < 0.001


@pytest.mark.parametrize("seed", range(5))
def test_ridge_keeps_weights_in_bounds_where_the_record_says_little(seed: int) -> None:
    """One partial loop with noise does not determine 38 weights; none of them grows large."""
    bank = new_bank(even_thresholds(19), even_thresholds(19))
    random = np.random.default_rng(seed)
    t = np.arange(0, 4, 1e-3)
    positions = 0.5 - 0.1 * np.cos(np.pi * t) + 1e-3 * random.standard_normal(t.size)

    weights = identify_least_squares(bank, positions, positions + 0.02)

    assert np.max(np.abs(weights)) < 1


def test_positions_outside_the_range_are_clamped() -> None:
    """Overshoot and noise at the ends do not disturb the fit."""
    positions, drives = record()
    beyond = np.where(positions > 0.999, 1.2, np.where(positions < 0.001, -0.3, positions))
    clamped = np.clip(beyond, 0, 1)

    weights = identify_least_squares(BANK, beyond, drives)

    assert weights.tolist() == identify_least_squares(BANK, clamped, drives).tolist()
