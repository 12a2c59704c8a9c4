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
    values = np.ascontiguousarray(values)
    crept = values.copy()
    if weights.any():
        lags = np.zeros((weights.size, values.shape[1]))
        _add_lags(values, _gains(period_s), weights, lags, crept)
    return crept


def lags_of(values: FloatArray, period_s: float) -> FloatArray:
    """Return all lags of the creep that follow one value over time from zero, shape (n, K).

    Args:
        values: (n,) value, evenly in time.
        period_s: Sample period, in s.
    """
    lags = np.zeros((values.size, TIME_CONSTANTS_S.size))
    _fill_lags(np.ascontiguousarray(values), _gains(period_s), lags)
    return lags


def decays(n_samples: int, period_s: float) -> FloatArray:
    """Return the decay of all lags from one, shape (n, K)."""
    times_s = np.arange(n_samples) * period_s
    return np.exp(-times_s[:, np.newaxis] / TIME_CONSTANTS_S)


def _gains(period_s: float) -> FloatArray:
    return -np.expm1(-period_s / TIME_CONSTANTS_S)


# As `advance_creep`: a lag follows the value of the sample before.


@compiled
def _fill_lags(values: FloatArray, gains: FloatArray, lags: FloatArray) -> None:
    for k in range(1, values.size):
        for i in range(gains.size):
            lags[k, i] = lags[k - 1, i] + gains[i] * (values[k - 1] - lags[k - 1, i])


@compiled
def _add_lags(
    values: FloatArray, gains: FloatArray, weights: FloatArray, lags: FloatArray, total: FloatArray
) -> None:
    """Add the weighted lags of (n, p) values to (n, p) totals; the (K, p) lags advance in place."""
    for k in range(1, values.shape[0]):
        for i in range(gains.size):
            for j in range(values.shape[1]):
                lags[i, j] += gains[i] * (values[k - 1, j] - lags[i, j])
                total[k, j] += weights[i] * lags[i, j]
