"""Regressors of creep: what each lag adds to a displacement, and to its other regressors."""

import numpy as np

from piezod.control.law.creep import TIME_CONSTANTS_S
from piezod.hysteresis.memory import FloatArray
from piezod.jit import compiled


def with_creep(
    values: FloatArray, weights: FloatArray, period_s: float, *, from_rest: bool
) -> FloatArray:
    """Return values over time with the creep that follows them, shape (n, p).

    Creep is linear: that of a sum is the sum of the creeps. It therefore acts on each regressor.

    Args:
        values: (n, p) values, evenly in time.
        weights: (K,) weight of each lag.
        period_s: Sample period, in s.
        from_rest: Whether the lags start at the first values; otherwise at the mean ones.
    """
    crept = np.ascontiguousarray(values).copy()
    for weight, gain in zip(weights, _gains(period_s), strict=True):
        if weight:
            _add_lag(values, gain, weight, _start(values, from_rest=from_rest), crept)
    return crept


def lags_of(values: FloatArray, period_s: float, *, from_rest: bool) -> FloatArray:
    """Return all lags of the creep that follow one value over time, shape (n, K).

    Args:
        values: (n,) value, evenly in time.
        period_s: Sample period, in s.
        from_rest: Whether the lags start at the first value; otherwise at the mean one.
    """
    column = np.ascontiguousarray(values)[:, np.newaxis]
    lags = np.zeros((TIME_CONSTANTS_S.size, values.size, 1))
    for k, gain in enumerate(_gains(period_s)):
        _add_lag(column, gain, 1.0, _start(column, from_rest=from_rest), lags[k])
    return lags[:, :, 0].T


def _gains(period_s: float) -> FloatArray:
    return -np.expm1(-period_s / TIME_CONSTANTS_S)


def _start(values: FloatArray, *, from_rest: bool) -> FloatArray:
    return np.ascontiguousarray(values[0] if from_rest else np.mean(values, axis=0))


@compiled
def _add_lag(
    values: FloatArray, gain: float, weight: float, start: FloatArray, total: FloatArray
) -> None:
    # As `advance_creep`: a lag follows the value of the sample before.
    for j in range(start.size):
        lag = start[j]
        total[0, j] += weight * lag
        for k in range(1, values.shape[0]):
            lag += gain * (values[k - 1, j] - lag)
            total[k, j] += weight * lag
