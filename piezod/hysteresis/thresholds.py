"""Thresholds of a model: evenly spaced, denser at both ends, or placed by a fit.

With M thresholds a side, a major branch is a line of M + 1 straight pieces. The response of a piezo
bends most just after a reversal, and again near the full width of a loop. Thresholds that are
denser at both ends therefore fit clearly better than evenly spaced ones.
"""

import numpy as np

from piezod.errors import ModelError
from piezod.hysteresis.bank import THRESHOLDS, new_bank
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.slopes import cells, to_slopes

GRADE = 2.5
"""Exponent of the grading towards both ends; 1 gives evenly spaced thresholds."""
_DENSITY_FLOOR = 0.25  # density if a branch is straight; √|ds/dr| is 1 to 10 at the ends


def even_thresholds(order: int) -> FloatArray:
    """Return r_j = j / (M + 1) for j = 1 … M, shape (M,), as in section 3 of the paper.

    Raises:
        ModelError: If the order M is not an integer of at least 1.
    """
    if order < 1 or order != int(order):
        message = f"the number of operators must be an integer of at least 1, got {order}"
        raise ModelError(message)
    return np.arange(1, order + 1, dtype=np.float64) / (order + 1)


def graded_thresholds(order: int) -> FloatArray:
    """Return thresholds that are dense at both ends, symmetric about 1/2, shape (M,).

    r_j = (2 t)^p / 2 for t = j / (M + 1) up to 1/2, and mirrored above; p is `GRADE`.

    Raises:
        ModelError: If the order M is not an integer of at least 1.
    """
    even = even_thresholds(order)
    from_nearest_end = 0.5 * (2.0 * np.minimum(even, 1.0 - even)) ** GRADE
    return np.where(even < 0.5, from_nearest_end, 1.0 - from_nearest_end)


def has_even_thresholds(bank: FloatArray) -> bool:
    """Return whether both sides of a bank have even thresholds."""
    even = even_thresholds(bank.shape[1] // 2)
    return bool(np.allclose(bank[THRESHOLDS].reshape(2, -1), even, rtol=0.0, atol=1e-9))


def placed_thresholds(bank: FloatArray, weights: FloatArray, order: int) -> FloatArray:
    """Return a bank whose thresholds are dense where a fitted model bends, shape (2, 2 order).

    A straight piece of width h misses a branch φ by at most h² |φ''| / 8. All pieces miss it
    equally if their density is proportional to √|φ''|. Each piece gets an equal share of ∫
    (√|ds/dr| + floor) dr.

    Args:
        bank: Thresholds and gains of the fit, from `new_bank`; more of them than `order`.
        weights: (2 M,) weights of the fit.
        order: Number of operators on each side of the new bank.

    Raises:
        ModelError: If the order is not an integer of at least 1.
    """
    shares = even_thresholds(order)
    left, right = (
        _placed(slopes, widths, shares)
        for slopes, widths in zip(to_slopes(bank, weights), cells(bank), strict=True)
    )
    return new_bank(left, right)


def _placed(slopes: FloatArray, widths: FloatArray, shares: FloatArray) -> FloatArray:
    """Return the points at which the integral of the density reaches the given shares of the whole.

    Each slope holds in the middle of its cell; between the middles it changes linearly.
    """
    # ds/dr is the second derivative of the branch, from differences between neighbouring cells.
    middles = np.cumsum(widths) - 0.5 * widths
    density = np.sqrt(np.abs(np.diff(slopes) / np.diff(middles))) + _DENSITY_FLOOR
    points = np.concatenate(([0.0], middles[1:-1], [1.0]))
    integral = np.concatenate(([0.0], np.cumsum(density * np.diff(points))))
    return np.interp(shares * integral[-1], integral, points)
