"""The covariance P of slopes, offset and scale that walk at random, for recursive least squares.

Forgetting winds up: where pairs tell nothing, P grows without end, and the first that does throws
the weights off. Here P decays by the share Q / bound at each step while the walk adds Q, so that no
variance exceeds its bound:

    P ← D (P - P u u' P / (R + u' P u)) D + Q,   D² = 1 - Q / bound.
"""

import numpy as np

from piezod.errors import ModelError
from piezod.hysteresis.memory import FloatArray
from piezod.jit import compiled

REGRESSOR, GAIN, DECAY = 0, 1, 2
"""Rows of vectors, shape (3, N): u, K, and the root of what is left of each variance in a step."""

SLOPE_VARIANCE, SLOPE_BOUND = 1e-4, 1e-3
"""Variance of a slope at the start, and the largest it can have."""
OFFSET_VARIANCE, OFFSET_BOUND = 1e-6, 1e-4
"""Variance of the offset at the start, and the largest it can have; in units of the range."""
SCALE_VARIANCE, SCALE_BOUND = 1e-6, 1e-4
"""The same of the scale, dimensionless."""


@compiled
def fill_gain(covariance: FloatArray, vectors: FloatArray) -> float:
    """Write P u; return u' P u.

    The sum runs row by row, which P being symmetric allows and the processor prefers.
    """
    regressor, gain = vectors[REGRESSOR], vectors[GAIN]
    for j in range(gain.size):
        gain[j] = 0.0
    for i in range(gain.size):
        for j in range(gain.size):
            gain[j] += covariance[i, j] * regressor[i]
    told = 0.0
    for j in range(gain.size):
        told += regressor[j] * gain[j]
    return told


@compiled
def update_covariance(
    covariance: FloatArray, walk: FloatArray, vectors: FloatArray, told: float
) -> None:
    """P ← D (P - (P u) (P u)' / (R + u' P u)) D + Q, symmetric to the bit."""
    gain, decay = vectors[GAIN], vectors[DECAY]
    root = 1.0 / np.sqrt(told)
    for j in range(gain.size):
        gain[j] *= root
    for i in range(gain.size):
        for j in range(gain.size):
            left = covariance[i, j] - gain[i] * gain[j]
            covariance[i, j] = left * (decay[i] * decay[j]) + walk[i, j]


def on_planes(
    cells: FloatArray, slope_variance: float, offset_variance: float, scale_variance: float
) -> FloatArray:
    """Return a covariance, shape (N, N): slopes vary alike but for Σ s c, the others alone.

    N is 2 M + 4: slopes of both sides, the offset and the scale.
    """
    count = cells.shape[1]
    covariance = np.zeros((2 * count + 2, 2 * count + 2))
    for side, across in enumerate(cells):
        plane = np.eye(count) - np.outer(across, across) / (across @ across)
        block = slice(side * count, (side + 1) * count)
        covariance[block, block] = slope_variance * plane
    covariance[-2, -2] = offset_variance
    covariance[-1, -1] = scale_variance
    return covariance


def checked_walk(name: str, walk: float, bound: float) -> float:
    """Return the variance that a state gains in a step.

    Raises:
        ModelError: If it is not from 0 to below the bound of that variance.
    """
    if not 0.0 <= walk < bound:
        message = f"the walk of {name} is from 0 to below its bound of {bound:g}, got {walk:g}"
        raise ModelError(message)
    return walk
