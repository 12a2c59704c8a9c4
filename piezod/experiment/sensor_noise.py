"""The noise of a sensor, from the true displacement that a simulated device knows."""

from typing import Final

import numpy as np

from piezod.hysteresis.memory import FloatArray

CALIBRATION_DEGREE: Final = 5
"""Degree of the polynomial by which the sensor's curve may deviate from the truth."""


def noise_rms(position: FloatArray, truth: FloatArray, velocity: FloatArray) -> float:
    """Return the rms noise of a sensor over the range of the true displacement.

    A sensor differs from the truth in three ways: it lags, in proportion to the velocity; its
    calibration has an error, which depends on the displacement alone; and it has noise. The first
    two are fitted by least squares, with 1, the velocity and powers of the truth up to the fifth.
    The noise is the remaining difference of measured and true displacement.

    Args:
        position: (n,) measured displacement.
        truth: (n,) true displacement at the same instants, in the same unit, not all equal.
        velocity: (n,) velocity of the truth, in any unit.
    """
    # Chebyshev polynomials span the same space as the powers, and are better conditioned.
    swing = float(np.ptp(truth))
    inside = 2.0 * (truth - np.min(truth)) / swing - 1.0
    powers = np.polynomial.chebyshev.chebvander(inside, CALIBRATION_DEGREE)
    regressors = np.column_stack((powers, velocity / (np.max(np.abs(velocity)) or 1.0)))
    difference = position - truth
    explained, *_ = np.linalg.lstsq(regressors, difference, rcond=None)
    return float(np.sqrt(np.mean((difference - regressors @ explained) ** 2)) / swing)
