"""The covariance P of slopes, offset and scale as random walks, for recursive least squares.

Exponential forgetting winds up: while pairs carry no information P grows without limit, and the
next informative pair throws the weights off. Here P decays by the share Q / bound in each step and
the random walk adds Q, so that no variance exceeds its bound:

    P ← D (P - P u u' P / (R + u' P u)) D + Q,   D² = 1 - Q / bound.
"""

import numpy as np

from piezod.errors import ModelError
from piezod.hysteresis.memory import FloatArray
from piezod.jit import compiled

REGRESSOR, GAIN, DECAY = 0, 1, 2
"""Rows of vectors, shape (3, N): u, P u (K before its division), and the diagonal of D."""

SLOPE_VARIANCE, SLOPE_BOUND = 1e-4, 1e-3
"""Initial and largest variance of a slope, dimensionless."""
OFFSET_VARIANCE, OFFSET_BOUND = 1e-6, 1e-4
"""Initial and largest variance of the offset, in units of the range squared."""
SCALE_VARIANCE, SCALE_BOUND = 1e-6, 1e-4
"""Initial and largest variance of the scale, dimensionless."""
WEIGHT_WALK, OFFSET_WALK, SCALE_WALK = 1e-8, 3e-9, 3e-10
"""Variances that each slope, the offset and the scale gain per learning step."""
MEASUREMENT_VARIANCE = 1e-6
"""R: variance of the error that no model explains."""


@compiled
def fill_gain(covariance: FloatArray, vectors: FloatArray) -> float:
    """Write P u and return u' P u.

    The loop runs row by row, in the order of the storage; that is allowed because P is symmetric.
    """
    regressor, gain = vectors[REGRESSOR], vectors[GAIN]
    for j in range(gain.size):
        gain[j] = 0.0
    for i in range(gain.size):
        for j in range(gain.size):
            gain[j] += covariance[i, j] * regressor[i]
    predicted_variance = 0.0
    for j in range(gain.size):
        predicted_variance += regressor[j] * gain[j]
    return predicted_variance


@compiled
def update_covariance(
    covariance: FloatArray, walk: FloatArray, vectors: FloatArray, innovation_variance: float
) -> None:
    """Replace P by D (P - (P u) (P u)' / (R + u' P u)) D + Q, symmetric to the bit."""
    gain, decay = vectors[GAIN], vectors[DECAY]
    # Half of the division goes into each factor, so that the product is exactly symmetric.
    root = 1.0 / np.sqrt(innovation_variance)
    for j in range(gain.size):
        gain[j] *= root
    # All N² elements, not a triangle, because `fill_gain` reads whole rows.
    for i in range(gain.size):
        for j in range(gain.size):
            left = covariance[i, j] - gain[i] * gain[j]
            covariance[i, j] = left * (decay[i] * decay[j]) + walk[i, j]


def constrained_covariance(
    cells: FloatArray, slope_variance: float, offset_variance: float, scale_variance: float
) -> FloatArray:
    """Return a covariance, shape (N, N), whose slopes obey the constraint Σ s c = const per side.

    All slopes have the same variance in that plane; offset and scale are independent. N is 2 M + 4:
    the slopes of both sides, the offset and the scale.
    """
    count = cells.shape[1]
    covariance = np.zeros((2 * count + 2, 2 * count + 2))
    for side, normal in enumerate(cells):
        plane = np.eye(count) - np.outer(normal, normal) / (normal @ normal)
        block = slice(side * count, (side + 1) * count)
        covariance[block, block] = slope_variance * plane
    covariance[-2, -2] = offset_variance
    covariance[-1, -1] = scale_variance
    return covariance


def checked_walk(name: str, walk: float, bound: float) -> float:
    """Return the variance that a state gains per step.

    Raises:
        ModelError: If it is not in [0, bound).
    """
    if not 0.0 <= walk < bound:
        message = f"the walk of {name} must be from 0 to below its bound {bound:g}, got {walk:g}"
        raise ModelError(message)
    return walk
