"""Where the thresholds of a model lie: evenly, closer at both ends, or where data ask for them.

With M thresholds a side the major branch is a line of M + 1 straight pieces. Just after a reversal
the response of a piezo bends most, and near full width it bends again: thresholds at both ends
fit clearly better than as many even ones.
"""

import numpy as np

from piezod.errors import ModelError
from piezod.hysteresis.bank import new_bank
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.slopes import cells, to_slopes

GRADE = 2.5
"""How quickly graded thresholds close up towards both ends; 1 would be even."""
_FLOOR = 0.25  # density where a branch is straight; it bends by 1 to 10 at the ends


def even_thresholds(order: int) -> FloatArray:
    """Return the paper's thresholds r_j = j / (M + 1) for j = 1 … M, shape (order,).

    Raises:
        ModelError: If the order M is not a whole number from 1 on.
    """
    if order < 1 or order != int(order):
        message = f"the number of operators is a whole one from 1 on, got {order}"
        raise ModelError(message)
    return np.arange(1, order + 1, dtype=np.float64) / (order + 1)


def graded_thresholds(order: int) -> FloatArray:
    """Return thresholds that are dense at both ends, symmetric about 1/2, shape (order,).

    r_j = (2 t)^p / 2 for t = j / (M + 1) up to 1/2, and mirrored above; p is `GRADE`.

    Raises:
        ModelError: If the order M is not a whole number from 1 on.
    """
    even = even_thresholds(order)
    from_the_end = 0.5 * (2.0 * np.minimum(even, 1.0 - even)) ** GRADE
    return np.where(even < 0.5, from_the_end, 1.0 - from_the_end)


def placed_thresholds(bank: FloatArray, weights: FloatArray, order: int) -> FloatArray:
    """Return a bank with thresholds where a fitted model has its bends, shape (2, 2 order).

    A straight piece of width h misses a branch φ by h² |φ''| / 8 at most, so pieces miss it alike
    where their density is as √|φ''|. Each gets an equal share of ∫ (√|ds/dr| + floor) dr.

    Args:
        bank: Thresholds and gains of the fit, from `new_bank`; more of them than are asked for.
        weights: (2 M,) weights of the fit.
        order: Number of operators on each side of the new bank.

    Raises:
        ModelError: If the order is not a whole number from 1 on.
    """
    shares = even_thresholds(order)
    left, right = (
        _placed(slopes, widths, shares)
        for slopes, widths in zip(to_slopes(bank, weights), cells(bank), strict=True)
    )
    return new_bank(left, right)


def _placed(slopes: FloatArray, widths: FloatArray, shares: FloatArray) -> FloatArray:
    """Return the points at which the integral of the density reaches given shares of the whole.

    Slopes are taken to hold in the middles of their cells, and to change evenly in between.
    """
    middles = np.cumsum(widths) - 0.5 * widths
    density = np.sqrt(np.abs(np.diff(slopes) / np.diff(middles))) + _FLOOR
    points = np.concatenate(([0.0], middles[1:-1], [1.0]))
    integral = np.concatenate(([0.0], np.cumsum(density * np.diff(points))))
    return np.interp(shares * integral[-1], integral, points)
