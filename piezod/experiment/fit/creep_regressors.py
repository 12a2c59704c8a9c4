"""Regressors of creep: what each lag adds to a displacement, and to its other regressors."""

import numpy as np

from piezod.control.law.creep import TIME_CONSTANTS_S
from piezod.hysteresis.memory import FloatArray
from piezod.jit import compiled


def with_creep(values: FloatArray, weights: FloatArray, period_s: float) -> FloatArray:
    """Return values over time with the creep that follows them from zero, shape (n, p).

    Creep is linear: that of a sum is the sum of the creeps. It therefore acts on each regressor.

    Args:
        values: (n, p) values, evenly in time.
        weights: (K,) weight of each lag.
        period_s: Sample period, in s.
    """
    crept = np.ascontiguousarray(values).copy()
    for weight, gain in zip(weights, _gains(period_s), strict=True):
        if weight:
            _add_lag(values, gain, weight, crept)
    return crept


def lags_of(values: FloatArray, period_s: float) -> FloatArray:
    """Return all lags of the creep that follow one value over time from zero, shape (n, K).

    Args:
        values: (n,) value, evenly in time.
        period_s: Sample period, in s.
    """
    column = np.ascontiguousarray(values)[:, np.newaxis]
    lags = np.zeros((TIME_CONSTANTS_S.size, values.size, 1))
    for k, gain in enumerate(_gains(period_s)):
        _add_lag(column, gain, 1.0, lags[k])
    return lags[:, :, 0].T


def decays(n_samples: int, period_s: float) -> FloatArray:
    """Return the decay of all lags from one, shape (n, K)."""
    times_s = np.arange(n_samples) * period_s
    return np.exp(-times_s[:, np.newaxis] / TIME_CONSTANTS_S)


def _gains(period_s: float) -> FloatArray:
    return -np.expm1(-period_s / TIME_CONSTANTS_S)


@compiled
def _add_lag(values: FloatArray, gain: float, weight: float, total: FloatArray) -> None:
    # As `advance_creep`: a lag follows the value of the sample before.
    for j in range(values.shape[1]):
        lag = 0.0
        for k in range(1, values.shape[0]):
            lag += gain * (values[k - 1, j] - lag)
            total[k, j] += weight * lag
