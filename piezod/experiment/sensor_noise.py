"""The noise of a sensor, seen beside the true displacement that a simulated device knows."""

from typing import Final

import numpy as np

from piezod.hysteresis.memory import FloatArray

CALIBRATION_DEGREE: Final = 5
"""The sensor's curve may deviate from the truth by a polynomial of this degree."""


def noise_rms(position: FloatArray, truth: FloatArray, velocity: FloatArray) -> float:
    """Return the root mean square of a sensor's noise over the range of the true displacement.

    A sensor differs from the truth in three ways. It lags, which is in proportion to the velocity;
    its calibration is off, which depends on the displacement alone; and it is noisy. The first two
    are fitted by least squares, with 1, the velocity and powers of the truth up to the fifth, and
    the noise is what they leave of measured minus true displacement.

    Args:
        position: (n,) measured displacement.
        truth: (n,) true displacement at the same instants, in the same unit, not all equal.
        velocity: (n,) velocity of the truth, in any unit.
    """
    # Chebyshev's polynomials span the same space as the powers, and stay well apart.
    swing = float(np.ptp(truth))
    inside = 2.0 * (truth - np.min(truth)) / swing - 1.0
    powers = np.polynomial.chebyshev.chebvander(inside, CALIBRATION_DEGREE)
    regressors = np.column_stack((powers, velocity / (np.max(np.abs(velocity)) or 1.0)))
    difference = position - truth
    explained, *_ = np.linalg.lstsq(regressors, difference, rcond=None)
    return float(np.sqrt(np.mean((difference - regressors @ explained) ** 2)) / swing)
